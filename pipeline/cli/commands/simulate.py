"""The command `simulate`: mesh frames of shots."""

from __future__ import annotations

from pipeline.cli.execution import execute_and_report
from pipeline.cli.options import Common, Frames, ShotOptions, Shots


def simulate(common: Common, shots: Shots, options: ShotOptions, frames: Frames = None) -> None:
    """Simulate shots: move and resample their surfaces, frame by frame.

    `flowsculpt simulate A010_cube -f 1-24` writes 24 mesh frames to renders/A010_cube/meshes. After an edit
    of the shot, the simulation resumes at the last frame that is still valid.

    Vertices keep their numbers through the whole shot, and new vertices name their parents; method polyhedra
    numbers them anew.
    """
    project = options.project(common)
    execute_and_report(common, lambda: project.meshes(shots, frames))
