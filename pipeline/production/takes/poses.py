"""What single pictures show, and what a turntable is."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Pose:
    """What one picture shows: a mesh frame, turned about the vertical by `spin` radians."""

    mesh: int
    spin: float = 0.0


@dataclass(frozen=True)
class Turntable:
    """A full turn of one mesh frame; the end point, which equals the start, is left out.

    of_file  the mesh is a file's, and its frames must not be taken for a shot's of the same name
    """

    at: int
    frames: int
    of_file: bool = False
