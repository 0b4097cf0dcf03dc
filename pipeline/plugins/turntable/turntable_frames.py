"""The frames of a turntable: a mesh frame from all around, then in turning light."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, fields, replace
from typing import ClassVar

from flowsculpt.api.frames import Folders, FrameRange, MeshAngle
from flowsculpt.api.options import QUALITIES
from flowsculpt.api.shots import Shot
from flowsculpt.pipeline.production.request.manifest import ShotManifest
from flowsculpt.pipeline.production.store.paths import RENDERS
from flowsculpt.pipeline.shot.camera_path import CameraPath, View
from flowsculpt.render.scene.render_camera import PERSPECTIVE
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_stage import WITH_REFERENCES

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
        picture, camera = shot.picture, shot.picture.camera
        is_wide = camera.projection.is_wide
        if is_wide or picture.stage.kind == WITH_REFERENCES:
            own = {each.name: getattr(camera, each.name) for each in fields(camera)}
            still: CameraPath = _WholeView(**own | {"follow": 0.0, "projection": PERSPECTIVE}, path=camera)
        else:
            still = replace(camera, follow=0.0)
        qualities = _flat(picture.qualities) if is_wide else picture.qualities
        return replace(shot, picture=replace(picture, camera=still, qualities=qualities, overrides=()))

    def adapt_manifest(self, manifest: ShotManifest) -> ShotManifest:
        """Return the manifest of a shot that is only turned."""
        return replace(
            manifest,
            sounds=(),
            projection=astuple(PERSPECTIVE),
            qualities=_flat(manifest.qualities) if manifest.is_wide else manifest.qualities,
            overrides=(),
            restyled=(),
            stages={},
            loop=None,
        )

    def mesh_folders(self, name: str) -> Folders:
        """Return the folders of the mesh frames: the shot's, or those of a mesh file."""
        return Folders(RENDERS / self.kind / name, name) if self.of_file else Folders.of_shot(name)

    def picture_folders(self, meshes: Folders) -> Folders:
        """Return the folders of the pictures; one of several looks has a folder of its own."""
        frame = "" if self.of_file else f"{self.at:04d}"
        name = ".".join(filter(None, (meshes.name, frame, meshes.subject)))
        home = RENDERS / self.kind / name
        return Folders(home / self.look if self.look else home, name)

    def part_name(self, numbers: FrameRange) -> str:
        """Return the one of TURNS that has exactly these pictures, or their range."""
        known = {frozenset(self.numbers(turn)): turn for turn in TURNS}
        return known.get(frozenset(numbers)) or str(numbers)


@dataclass(frozen=True)
class _WholeView(CameraPath):
    """A camera that shows the whole object from the side from which a path sees it."""

    path: CameraPath | None = None

    def at(self, time: float) -> View:
        """Return the view at a time in seconds."""
        assert self.path is not None, "it is made of a path"
        return framed_whole(self.path.at(time))


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


def _flat(qualities: Mapping[str, Quality]) -> dict[str, Quality]:
    """Return qualities of pictures in perspective."""
    return {
        name: replace(quality, width=QUALITIES[name].width, height=QUALITIES[name].height)
        for name, quality in qualities.items()
    }
