"""A contact sheet of a shot over time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.frames import FrameRange
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.store import Store
from pipeline.production.versions.wedge import shown_picture
from render.graphics.contact_sheet import ContactSheet, columns_for, reduction
from render.post.image import write_png

DEFAULT_FRAMES = 12
"""Most frames of a sheet where none are requested."""


def spread(request: RenderRequest) -> RenderRequest:
    """Return a request for at most DEFAULT_FRAMES frames at equal distances."""
    numbers = sorted(request.angles)
    return replace(request, requested=tuple(numbers[:: -(-len(numbers) // DEFAULT_FRAMES)]))


@dataclass(frozen=True)
class ShotSheet:
    """A sheet of the requested frames; by default `columns` give it about the aspect of a screen."""

    request: RenderRequest
    store: Store
    columns: int | None = None

    @property
    def place(self) -> Path:
        """The path of the sheet, relative to the root."""
        frames = FrameRange.of(self.request.requested)
        return (
            self.request.folders.home / self.request.quality_name / f"{self.request.name}.sheet.{frames}.png"
        )

    def write(self, path: Path) -> None:
        """Write the sheet as PNG; missing frames are shown as missing. Raises MachineError."""
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
