"""The frames of a turntable: a mesh frame from all around, then in turning light."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import ClassVar

from flowsculpt.api.frames import Folders, FrameRange, MeshAngle
from flowsculpt.api.shots import Shot

REFERENCES = "turntable"
"""The name of the stage with grey ball, chrome ball and colour chart."""

TURNS = ("object", "lights")
"""The turns of a turntable, in their order."""

MARGIN, WIDEST = 0.1, math.radians(40.0)
"""The least margin around the object, as in `View`, and the widest field of view of a turntable with balls
and chart: in a wider one what is near would hide them."""


@dataclass(frozen=True)
class Turntable:
    """A full turn of one mesh frame, and then one of the lights around it: a source of frames.

    The end of a turn, which equals its start, is left out. Numbers of pictures do not depend on the turns
    asked for. It is seen in perspective, and has no sound, overrides, loop, nor stages of plug-ins.

    at       the mesh frame
    frames   pictures of a turn: the object's from 1 on, then the lights'
    of_file  True for a mesh file, whose files must not be confused with those of a shot of the same name
    look     the name of its look, if it is one of several with folders of their own
    """

    kind: ClassVar[str] = "turntable"
    is_turned: ClassVar[bool] = True

    at: int
    frames: int
    of_file: bool = False
    look: str | None = None

    def numbers(self, turn: str) -> range:
        """Return the numbers of the pictures of one of TURNS."""
        first = 1 + TURNS.index(turn) * self.frames
        return range(first, first + self.frames)

    def angles(self, frames: Iterable[int] = ()) -> dict[int, MeshAngle]:
        """Return the angles of all pictures, by number."""
        angles = [2.0 * math.pi * i / self.frames for i in range(self.frames)]
        turned = [MeshAngle(self.at, spin=angle) for angle in angles]
        lit = [MeshAngle(self.at, lights=angle) for angle in angles]
        return dict(enumerate(turned + lit, start=1))

    def turn(self, number: int) -> float:
        """Return the turn of the object from a picture to the next, radians."""
        return 2.0 * math.pi / self.frames if number in self.numbers("object") else 0.0

    def adapt_shot(self, shot: Shot) -> Shot:
        """Return the shot with a camera that stands still; the reference objects need the whole object."""
        if shot.picture.camera.projection.is_wide or shot.picture.stage.kind == REFERENCES:
            shot = _seen_whole(shot, shot.motion.clock.time(self.at))
        camera = replace(shot.picture.camera, follow=0.0)
        return replace(shot, picture=replace(shot.picture, camera=camera, overrides=()))

    def mesh_folders(self, name: str) -> Folders:
        """Return the folders of the mesh frames: the shot's, or those of a mesh file."""
        return Folders.of_kind(self.kind, name) if self.of_file else Folders.of_shot(name)

    def picture_folders(self, meshes: Folders) -> Folders:
        """Return the folders of the pictures; one of several looks has a folder of its own."""
        frame = "" if self.of_file else f"{self.at:04d}"
        name = ".".join(filter(None, (meshes.name, frame, meshes.subject)))
        folders = Folders.of_kind(self.kind, name)
        return Folders(folders.home / self.look, name) if self.look else folders

    def part_name(self, numbers: FrameRange) -> str:
        """Return the one of TURNS that has exactly these pictures, or their range."""
        known = {frozenset(self.numbers(turn)): turn for turn in TURNS}
        return known.get(frozenset(numbers)) or str(numbers)


def _seen_whole(shot: Shot, time: float) -> Shot:
    """Return a shot in perspective, with a still camera that shows the whole object, and room for balls.

    It stands on the side from which the shot's camera sees the object at a time. Distance, aim, roll and lens
    of the shot at that moment are dropped; so is a wide projection.
    """
    view, picture = shot.picture.camera.at(time), shot.picture.in_perspective()
    azimuth, elevation = view.azimuth, view.elevation
    if view.position is not None and view.fixed_target is not None:
        x, y, z = (a - b for a, b in zip(view.position, view.fixed_target, strict=True))
        azimuth, elevation = math.atan2(x, z), math.atan2(y, math.hypot(x, z))
    still = replace(
        picture.camera,
        azimuth=azimuth,
        elevation=elevation,
        field_of_view=min(view.field_of_view, WIDEST),
        margin=max(view.margin, MARGIN),
        focal_length=None,
        roll=0.0,
        dolly=1.0,
        distance=None,
        target=None,
        position=None,
        move=None,
        aperture=None,
        aspect=1.0,  # the field of view is that across
    )
    return replace(shot, picture=replace(picture, camera=still))
