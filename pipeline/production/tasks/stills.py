"""From pictures to files that any program shows: each frame seen through the view."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pipeline.production.store import readers
from pipeline.production.tasks.job import Context
from render.post.colour import quantise, to_display
from render.post.image import write_jpeg, write_png


def png(context: Context) -> bool:
    """PNG of 8 bits."""
    return _stills(context, "png", 8, write_png)


def png16(context: Context) -> bool:
    """PNG of 16 bits, for grading on a display's terms."""
    return _stills(context, "png16", 16, write_png)


def jpeg(context: Context) -> bool:
    """JPEG, for mail and pages."""
    return _stills(context, "jpeg", 8, write_jpeg)


def _stills(context: Context, form: str, bits: int, write_still: Callable[..., None]) -> bool:
    request = context.request
    keys = context.picture_keys(request)
    picture = request.shot.picture

    def work(number: int) -> bool:
        frame = request.place("frame", number)
        key = request.still_key(form, keys[number].frame)

        def write(path: Path) -> None:
            whole = readers.picture(keys[number].frame, request.quality.rendered_size)
            layers, _ = context.read("frame", keys[number].frame, frame, whole)
            shown = to_display(layers["beauty"], picture.lights.exposure, "srgb", picture.view)
            write_still(path, quantise(shown, bits), {"shot": request.name, "frame": number, "key": key})

        return context.make(form, key, request.place(form, number), write)

    return context.each(context.job.frames, work)
