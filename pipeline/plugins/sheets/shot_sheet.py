"""A shot on one page: a contact sheet of its frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.frames import FrameRange
from pipeline.production.picture_sequences import shown_picture
from pipeline.production.request.keys import picture_keys
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.store import Store
from render.graphics.contact_sheet import columns_for, fitted_sheet
from render.post.image import write_png

DEFAULT_FRAMES = 12  # most frames of a sheet where none are requested


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
        request, frames = self.request, FrameRange.of(self.request.requested)
        return request.folders.home / request.quality_name / f"{request.name}.sheet.{frames}.png"

    def write(self, path: Path) -> None:
        """Write the sheet as PNG; missing frames are shown as missing. Raises MachineError."""
        request, numbers = self.request, self.request.requested
        size = request.quality.rendered_size
        columns = min(len(numbers), self.columns or columns_for(len(numbers), size))
        rate = request.shot.rate
        seconds = [rate.seconds(number - request.shot.frames.first) for number in numbers]
        captions = [(("frame", f"{n}   {s:.2f} s"),) for n, s in zip(numbers, seconds, strict=True)]
        sheet, factor = fitted_sheet(request.shot.heading, captions, size, columns)
        keys = picture_keys(request, self.store)
        pictures = [shown_picture(request, keys, self.store, n, factor, 8, "srgb") for n in numbers]
        header = {"shot": request.name, "frames": str(FrameRange.of(numbers))}
        page = sheet.picture(pictures, request.quality_name)
        self.store.write(path, lambda draft: write_png(draft, page, header))
