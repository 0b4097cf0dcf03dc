"""Small shots, refined to one mesh each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import ShotSource

BOX = "{solid: box, size: [2, 2, 2]}"
SHEET = "{solid: sheet, size: [2, 2]}"
BALL = "{solid: icosphere, radius: 1}"
TWIST = "twist: {axis: y, amount: {ease: linear, keys: {1: 0, %d: %g}}}"


def request_of(
    folder: Path, subject: str, flow: str, resample: str = "{max_edge_length: 0.5}", frames: str = "1-6"
) -> RenderRequest:
    """Return the request of all frames of a shot, whose file may lie in a folder; code may run."""
    text = f"title: Refined\nframes: {frames}\nsubject: {subject}\nresample: {resample}\nflows: [{flow}]\n"
    return of_text(folder, text)


def of_text(folder: Path, text: str) -> RenderRequest:
    """Return the request of all frames of a shot file's text."""
    source = ShotSource(text, folder / "T010_refined.yaml", allow_code=True)
    return RenderRequest(source, "draft", "none", tuple(source.manifest.frames))


def up_to(request: RenderRequest, last: int) -> RenderRequest:
    """Return the request of its frames up to one."""
    return replace(request, requested=tuple(n for n in request.requested if n <= last))
