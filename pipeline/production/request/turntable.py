"""What single pictures show, and what a turntable is."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pipeline.shot.camera import View

TURNS = ("object", "lights")
"""What a turntable turns, one after the other."""

MARGIN, WIDEST = 0.08, math.radians(40.0)
"""The least that a turntable with balls and chart keeps free around its object, as `View` has it, and the
widest lens it is seen by: what is near a wider one would hide them."""


@dataclass(frozen=True)
class TurntableAngle:
    """What one picture shows: a mesh frame, turned about the vertical by `spin` radians.

    lights  how far what shines is turned about it, radians the same way
    """

    mesh: int
    spin: float = 0.0
    lights: float = 0.0


@dataclass(frozen=True)
class Turntable:
    """A full turn of one mesh frame, and then one of the lights around it.

    The end point of a turn, which equals its start, is left out. The same picture has the same number
    whichever turns are asked for.

    frames   pictures of a turn: from 1 on the object's, and after these the lights'
    of_file  the mesh is a file's, and its frames must not be taken for a shot's of the same name
    look     the name of its look, where it is one of several and has a folder for itself
    """

    at: int
    frames: int
    of_file: bool = False
    look: str | None = None

    def numbers(self, turn: str) -> range:
        """The pictures of one of TURNS."""
        first = 1 + TURNS.index(turn) * self.frames
        return range(first, first + self.frames)

    def angles(self) -> dict[int, TurntableAngle]:
        """By number, all pictures."""
        angles = [2.0 * math.pi * i / self.frames for i in range(self.frames)]
        turned = [TurntableAngle(self.at, spin=angle) for angle in angles]
        lit = [TurntableAngle(self.at, lights=angle) for angle in angles]
        return dict(enumerate(turned + lit, start=1))

    def step(self, number: int) -> float:
        """By how many radians the object turns from a picture to the next."""
        return 2.0 * math.pi / self.frames if number in self.numbers("object") else 0.0

    def turn_of(self, numbers: Iterable[int]) -> str | None:
        """The one of TURNS whose pictures these are; None where they are others."""
        known = {frozenset(self.numbers(turn)): turn for turn in TURNS}
        return known.get(frozenset(numbers))


def framed_whole(view: View) -> View:
    """From the same side, at a distance that framing finds, with room for what stands beside: no close-up,
    nothing askew and nothing blurred, whatever the shot does at that moment."""
    azimuth, elevation = view.azimuth, view.elevation
    if view.position is not None and view.target is not None:
        x, y, z = (a - b for a, b in zip(view.position, view.target, strict=True))
        azimuth, elevation = math.atan2(x, z), math.atan2(y, math.hypot(x, z))
    return view._replace(
        azimuth=azimuth,
        elevation=elevation,
        field_of_view=min(view.field_of_view, WIDEST),
        margin=max(view.margin, MARGIN),
        roll=0.0,
        dolly=1.0,
        distance=None,
        target=None,
        position=None,
        lens=None,
    )
