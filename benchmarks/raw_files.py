"""Rendered frames as `finish` reads them: from the file of a raw picture, with the header of a shot."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import ShotSource
from flowsculpt.render.post.image import read_exr, write_exr
from flowsculpt.render.scene.aovs import RenderedFrame

SHOT = "title: Header\nframes: 1-2\nsubject: {solid: box, size: [2, 2, 2]}\nresample: {max_edge_length: 1}\n"


def as_read(frame: RenderedFrame) -> RenderedFrame:
    """Return a frame after it was written to a file and read: in half floats, with its header as facts."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "raw.exr"
        write_exr(path, frame, {**_header(), "shutter": frame.facts.get("shutter")})
        return read_exr(path)[0]


@cache
def _header() -> dict[str, Any]:
    """Return the header of a shot's picture, without motion blur."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "R010_header.yaml"
        path.write_text(SHOT)
        request = RenderRequest(ShotSource(SHOT, path).with_inputs(), "draft", "none", (1, 2))
        return request.keys.header(1)
