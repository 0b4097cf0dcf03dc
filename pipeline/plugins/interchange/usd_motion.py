"""Moving meshes of USD stages, which usd-core reads in a process of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from flowsculpt.api.files import Parser
from flowsculpt.api.meshes import MovingSurface, ScenePart
from flowsculpt.pipeline.plugins.interchange.moving_files import MovingFile, answer_about
from flowsculpt.pipeline.plugins.interchange.usd_files import load_usd, stage_files

_MODULE = "flowsculpt.pipeline.plugins.interchange.usd_motion"


def open_usd(path: Path, part: ScenePart | None) -> MovingSurface:
    """Open the moving meshes of a stage: see `FileFormat.motion`. Raises MachineError without usd-core."""
    prim = part.prim or "" if part else ""
    return MovingFile.opened(path, _MODULE, stage_files(path), "usd-core", prim)


def begin(path: str, prim: str) -> Callable[[str], bytes]:
    """Return what answers about a stage."""
    load_usd()
    from flowsculpt.pipeline.plugins.interchange.usd_samples import StageSource

    return answer_about(lambda: StageSource(path, prim or None))


if __name__ == "__main__":
    Parser.serve_session(begin)
