"""Turntables: one mesh frame seen from all around, then in turning light."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pipeline.shot.camera_path import View

TURNS = ("object", "lights")
"""The turns of a turntable, in their order."""

MARGIN, WIDEST = 0.1, math.radians(40.0)
"""The least margin around the object, as in `View`, and the widest field of view of a turntable with balls
and chart: in a wider one what is near would hide them."""


@dataclass(frozen=True)
class TurntableAngle:
    """A mesh frame turned about the vertical by `spin` radians; pictures of a shot have 0.

    lights  turn of the lights about it, radians
    """

    mesh: int
    spin: float = 0.0
    lights: float = 0.0


@dataclass(frozen=True)
class Turntable:
    """A full turn of one mesh frame, and then one of the lights around it.

    The end of a turn, which equals its start, is left out. Numbers of pictures do not depend on the turns
    asked for.

    frames   pictures of a turn: the object's from 1 on, then the lights'
    of_file  True for a mesh file, whose files must not be confused with those of a shot of the same name
    look     the name of its look, if it is one of several with folders of their own
    """

    at: int
    frames: int
    of_file: bool = False
    look: str | None = None

    def numbers(self, turn: str) -> range:
        """Return the numbers of the pictures of one of TURNS."""
        first = 1 + TURNS.index(turn) * self.frames
        return range(first, first + self.frames)

    def angles(self) -> dict[int, TurntableAngle]:
        """Return the angles of all pictures, by number."""
        angles = [2.0 * math.pi * i / self.frames for i in range(self.frames)]
        turned = [TurntableAngle(self.at, spin=angle) for angle in angles]
        lit = [TurntableAngle(self.at, lights=angle) for angle in angles]
        return dict(enumerate(turned + lit, start=1))

    def step(self, number: int) -> float:
        """Return the turn of the object from a picture to the next, radians."""
        return 2.0 * math.pi / self.frames if number in self.numbers("object") else 0.0

    def turn_of(self, numbers: Iterable[int]) -> str | None:
        """Return the one of TURNS that has exactly these pictures, or None."""
        known = {frozenset(self.numbers(turn)): turn for turn in TURNS}
        return known.get(frozenset(numbers))


def framed_whole(view: View) -> View:
    """Return the view from the same side that shows the whole object, with room for balls and chart.

    Distance, aim, roll and lens of the shot at that moment are dropped; so is a wide projection.
    """
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
