"""The command `simulate`: mesh frames of shots."""

from __future__ import annotations

from pipeline.cli.execution import make
from pipeline.cli.options import AllowCode, Common, Frames, Settings, Shots
from pipeline.cli.projects import project_of


def simulate(
    common: Common,
    shots: Shots,
    frames: Frames = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Simulate shots: move and resample their surfaces, frame by frame.

    Mesh frames appear in renders/SHOT/meshes. After an edit a simulation goes on from the last frame that
    the edit left valid. Vertices are numbered for life in them, and new ones name their parents; those of
    method polyhedra are not.
    """
    project = project_of(common, settings, allow_code)
    make(common, lambda: project.meshes(shots, frames))
