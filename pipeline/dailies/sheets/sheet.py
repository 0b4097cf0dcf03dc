"""A contact sheet of a shot over time: frames in rows, numbered."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.frames import FrameRange
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.store import Store
from pipeline.production.versions.wedge import shown_picture
from render.graphics.contact_sheet import ContactSheet, columns_for, reduction
from render.post.image import write_png

USUAL = 12
"""Frames of a sheet where none are asked for, at most."""


def spread(request: RenderRequest) -> RenderRequest:
    """The same with so many frames asked for that they make a sheet, at equal distances from the first on."""
    numbers = sorted(request.angles)
    return replace(request, requested=tuple(numbers[:: -(-len(numbers) // USUAL)]))


@dataclass(frozen=True)
class Sheet:
    """Of the frames that a take asks for; `columns` by default as the sheet becomes most like a screen."""

    request: RenderRequest
    store: Store
    columns: int | None = None

    @property
    def place(self) -> Path:
        """Where it is put, relative to the root."""
        frames = FrameRange.of(self.request.requested)
        return (
            self.request.folders.home / self.request.quality_name / f"{self.request.name}.sheet.{frames}.png"
        )

    def write(self, path: Path) -> None:
        """Frames that are not there are told to be missing. Raises MachineError."""
        request, numbers = self.request, self.request.requested
        size = request.quality.rendered_size
        columns = min(len(numbers), self.columns or columns_for(len(numbers), size))
        factor = reduction(len(numbers), columns, size)
        width, height = (side // factor for side in size)
        rate = request.shot.rate
        captions = [
            (("frame", f"{number}   {rate.seconds(number - request.shot.frames.first):.2f} s"),)
            for number in numbers
        ]
        keys = request.picture_keys(self.store)
        pictures = [
            None if keys is None else shown_picture(request, keys, self.store, number, factor, 8, "srgb")
            for number in numbers
        ]
        sheet = ContactSheet(f"{request.name}: {request.shot.title}", captions, (width, height), columns)
        header = {"shot": request.name, "frames": str(FrameRange.of(numbers))}
        write_png(path, sheet.picture(pictures, request.quality_name), header)
