"""The camera of a shot over time, and its shutter. Angles are radians, lenses in millimetres."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from random import Random
from typing import NamedTuple

from flowsculpt.pipeline.flow.keyframes import elapsed
from flowsculpt.pipeline.flow.parameters import Curve, Number, Vector, VectorParameter, number_at, vector_at
from flowsculpt.render.base.serialise import OMIT_DEFAULT
from flowsculpt.render.scene.render_camera import PERSPECTIVE, Projection

FULL_FRAME = 36.0
"""Width of a full-frame sensor, millimetres."""

TURN = 2.0 * math.pi

EYE_DISTANCE = 64.0
"""Distance between the eyes of a stereo camera, millimetres: about the mean of adults."""


class Lens(NamedTuple):
    """A lens with depth of field.

    focal_length  millimetres
    aperture      f-number: the focal length over the diameter of the opening
    unit          millimetres in a scene unit; None derives it from the sculpture's size
    focus         what is sharp: None, the target; "front", the nearest point of the sculpture; the name of a
                  subject, its nearest point; a distance along the lens, scene units; or a place
    """

    focal_length: float
    aperture: float
    unit: float | None = None
    focus: float | Vector | str | None = None


class WideLens(NamedTuple):
    """A wide projection in place of a lens; plain data, since views are part of keys.

    kind, angle   as of `Projection`
    eye_distance  millimetres; 0 for one eye
    unit          millimetres in a scene unit; None derives it from the sculpture's size
    lift          angle from the target up to the middle of the picture, radians
    """

    kind: str
    angle: float
    eye_distance: float
    unit: float | None = None
    lift: float = 0.0

    @property
    def projection(self) -> Projection:
        return Projection(self.kind, self.angle)


class Between(NamedTuple):
    """A place between the middles of two of several subjects: `share` of the way."""

    subject: str
    other: str
    share: float


class View(NamedTuple):
    """The camera at one time. Angles in radians; azimuth 0 looks from +z, a quarter turn from +x.

    field_of_view  horizontal; of a wide projection, the angle into which framing fits the sculpture
    margin    the fraction of the picture's width or height kept free at every side
    roll      about the lens, clockwise as the camera looks
    orbit     how far the camera has gone around from the azimuth, which the stage faces
    dolly     factor on the distance that framing finds
    distance  from the target, scene units; None lets framing find it
    target    the point that the camera looks at, maybe between subjects; None lets framing find it
    position  of the camera; None derives it from the other values
    """

    azimuth: float
    elevation: float
    field_of_view: float
    margin: float
    roll: float = 0.0
    orbit: float = 0.0
    dolly: float = 1.0
    distance: float | None = None
    target: Vector | Between | None = None
    position: Vector | None = None
    lens: Lens | WideLens | None = None

    @property
    def fixed_target(self) -> Vector | None:
        """The target, if it is a place."""
        return None if isinstance(self.target, Between) else self.target

    @property
    def wide(self) -> WideLens | None:
        """The wide projection; None for a perspective."""
        return self.lens if isinstance(self.lens, WideLens) else None

    @property
    def blur(self) -> Lens | None:
        """The lens with depth of field; None where everything is sharp."""
        return self.lens if isinstance(self.lens, Lens) else None


LOWEST = math.radians(2.0)
"""Elevation below which no move leads: the camera stays above the floor."""

SWAYS = ((0.31, 0.5), (0.73, 0.3), (1.27, 0.2))
"""Frequencies, Hz, and weights of the sines of a hand's sway; the weights add up to 1."""


@dataclass(frozen=True)
class CameraMove:
    """A move of the camera, relative to what the shot and framing find; in its middle it is as without.

    progress  from 0 to 1
    push      share of the distance by which the camera comes nearer, half of it before the middle
    arc       radians that it goes around the set, which stands still
    crane     radians that it rises
    reveal    share of the distance by which it is nearer at the beginning, and none at the end
    track     the subjects at which the camera looks, one after another
    handheld  greatest sway, in widths of the picture
    seed      another one sways differently
    """

    progress: Curve
    push: float = 0.0
    arc: float = 0.0
    crane: float = 0.0
    reveal: float = 0.0
    handheld: float = 0.0
    track: tuple[str, ...] = ()
    seed: int = 0

    def apply(self, view: View, time: float) -> View:
        """Return a view at a time in seconds as the move changes it."""
        passed = self.progress.at(time)[0]
        off_middle = passed - 0.5
        nearer = (1.0 - off_middle * self.push) * (1.0 - (1.0 - passed) * self.reveal)
        sideways, upwards, around = (
            self.handheld * view.field_of_view * self._sway(time, axis) for axis in range(3)
        )
        raised = view.elevation + off_middle * self.crane
        return view._replace(
            orbit=view.orbit + off_middle * self.arc + sideways,
            elevation=max(raised, min(view.elevation, LOWEST)) + upwards,
            roll=view.roll + around,
            dolly=view.dolly * nearer,
            distance=None if view.distance is None else view.distance * nearer,
            target=self._target(passed) if self.track else view.target,
        )

    def _target(self, passed: float) -> Between:
        """Return where between two subjects the camera looks."""
        way = passed * (len(self.track) - 1)
        i = min(max(math.floor(way), 0), len(self.track) - 2)
        return Between(self.track[i], self.track[i + 1], way - i)

    def _sway(self, time: float, axis: int) -> float:
        """Return a smooth noise from −1 to 1."""
        phases = Random(f"{self.seed} {axis}")
        return sum(weight * math.sin(TURN * (rate * time + phases.random())) for rate, weight in SWAYS)


@dataclass(frozen=True)
class CameraPath:
    """The camera over the course of a shot; framing finds what is None.

    azimuth, elevation  radians, constant or keyed: 0 looks along −z, positive azimuth from the right
    field_of_view       radians, across the longer side of the picture; used without a focal length.
                        Of a wide projection, the angle into which framing fits the sculpture
    margin              fraction of the picture, or of that angle, left empty on each side
    focal_length        millimetres, before a sensor whose longer side is `sensor_width` millimetres
    orbit               radians a second around the set; the azimuth turns the set along
    follow              1 goes along with the sculpture, 0 stands as the whole shot needs it
    aperture            f-number; None is sharp everywhere
    focus, unit         as in `Lens`
    projection          of all pictures; a wide one is sharp everywhere
    eye_distance        between the eyes of a stereo camera, millimetres
    lift                angle from the target up to the middle of a wide picture, radians
    move                applied to all of these; None for none
    aspect              width to height of the pictures; upright ones are of the camera turned on its side
    """

    azimuth: Number
    elevation: Number
    field_of_view: Number
    margin: Number
    focal_length: Number | None = None
    sensor_width: float = FULL_FRAME
    roll: Number = 0.0
    orbit: Number = 0.0
    dolly: Number = 1.0
    distance: Number | None = None
    target: VectorParameter | None = None
    position: VectorParameter | None = None
    follow: float = 1.0
    aperture: Number | None = None
    focus: Number | VectorParameter | str | None = None
    unit: float | None = None
    projection: Projection = PERSPECTIVE
    eye_distance: float = EYE_DISTANCE
    lift: float = 0.0
    aspect: float = 16 / 9
    move: CameraMove | None = field(default=None, metadata=OMIT_DEFAULT)

    def at(self, time: float) -> View:
        """Return the view at a time in seconds."""
        view = self._at(time)
        return view if self.move is None else self.move.apply(view, time)

    def _at(self, time: float) -> View:
        return View(
            number_at(self.azimuth, time),
            number_at(self.elevation, time),
            self._horizontal(self._field_of_view(time)),
            number_at(self.margin, time),
            roll=number_at(self.roll, time),
            orbit=elapsed(self.orbit, time),
            dolly=number_at(self.dolly, time),
            distance=None if self.distance is None else number_at(self.distance, time),
            target=None if self.target is None else vector_at(self.target, time),
            position=None if self.position is None else vector_at(self.position, time),
            lens=self._lens(time),
        )

    def _field_of_view(self, time: float) -> float:
        if self.focal_length is None:
            return number_at(self.field_of_view, time)
        return 2.0 * math.atan(self.sensor_width / 2.0 / number_at(self.focal_length, time))

    def _horizontal(self, angle: float) -> float:
        """Return the horizontal angle of one across the longer side of the picture."""
        if self.aspect >= 1.0 or self.projection.is_wide:
            return angle
        return 2.0 * math.atan(math.tan(angle / 2.0) * self.aspect)

    def _lens(self, time: float) -> Lens | WideLens | None:
        if (wide := self.projection).is_wide:
            eye_distance = self.eye_distance if wide.is_stereo else 0.0
            return WideLens(wide.kind, wide.angle, eye_distance, self.unit, self.lift)
        if self.aperture is None:
            return None
        if self.focal_length is None:
            focal_length = self.sensor_width / 2.0 / math.tan(number_at(self.field_of_view, time) / 2.0)
        else:
            focal_length = number_at(self.focal_length, time)
        return Lens(focal_length, number_at(self.aperture, time), self.unit, self._focus(time))

    def _focus(self, time: float) -> float | Vector | str | None:
        if self.focus is None or isinstance(self.focus, float | tuple | str):
            return self.focus
        values = self.focus.at(time)
        return values[0] if len(values) == 1 else vector_at(self.focus, time)


@dataclass(frozen=True)
class Shutter:
    """A rotating shutter, open for a part of each turn; a turn is a frame.

    angle  radians that it is open, 0 to 2π, constant or keyed; 0 shows one moment
    phase  radians from the moment of the frame at which it opens, -2π to 0; None opens half the angle before
    """

    angle: Number = 0.0
    phase: Number | None = None

    def open_at(self, time: float) -> tuple[float, float] | None:
        """Return opening and closing in frames from the frame at `time` seconds; None if it stays shut."""
        angle = number_at(self.angle, time)
        if not angle > 0.0:
            return None
        opens = -0.5 * angle if self.phase is None else number_at(self.phase, time)
        return max(opens / TURN, -1.0), min((opens + angle) / TURN, 1.0)
