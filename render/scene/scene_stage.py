"""Stages: the floor and wall around the subject, in stage units, and their placement in the scene."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import OMIT_DEFAULT, Colour, Triple
from flowsculpt.render.scene.fog import Fog
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.room_shapes import BEVEL, HIGH, ROOMS, Mesh, joined, props, room_backdrop
from flowsculpt.render.scene.surface_detail import FINISHES

RINGS, SIDES = 33, 64
"""Triangles of a cyclorama, outwards and around. Its normals are exact: more triangles change no picture."""

WITH_REFERENCES = "turntable"
"""The kind of a stage with reference balls and a colour chart."""

KINDS = ("cyclorama", "ground", "plinth", *ROOMS, "stair", "table", "fog", WITH_REFERENCES, "none")

CYCLORAMAS = ("cyclorama", "plinth", "stair", "table", "fog", WITH_REFERENCES)
"""Kinds whose backdrop is a cyclorama."""

PLINTH = (0.56, 0.555, 0.545)
"""Reflectance of a plinth, linear Rec.709: a white one would outshine the subject."""

FLAT_RADIUS, HORIZON_RADIUS, HORIZON_HEIGHT = 40.0, 400.0, 4.0
"""The ground: radius to which it is flat, its outer radius, and its height there, stage units."""

_OBJECTS = {
    **dict.fromkeys(("plinth", "stair", "table", "shelf"), ("stage", "plinth")),
    WITH_REFERENCES: ("stage", "grey", "chrome", "chart"),
    "none": (),
}
"""Objects of the kinds that are not a stage alone."""

_CAMERA_MOVES = {"plinth": (1.14, 0.13), WITH_REFERENCES: (1.08, 0.04)}
"""Camera distance as a multiple of the distance for the subject alone, and stage units to lower the
camera."""

_IN_VIEW = 0.98
"""The smallest distance factor of a lowered camera is this plus the lowering, as a share of half the height
of the picture at the target: the subject stays in the picture, also with a wide lens close to it."""

_WIDE, _AROUND, _FARTHEST = 16 / 9, 1.06, 2.0
"""Width to height from which on a picture shows all of a plinth; the width that it needs over that of the
plinth; and the factor on the distance at which wider ones are cut off."""


@dataclass(frozen=True)
class StagePlacement:
    """The transform of stage and lights: scale by `size`, turn by `turn`, then move to `origin`.

    origin  scene point under the subject's middle
    size    half the subject's size, scene units. An enlarged sculpture with an enlarged placement gives the
            same picture
    turn    radians about the vertical, from +z towards +x
    """

    origin: Triple = (0.0, 0.0, 0.0)
    size: float = 1.0
    turn: float = 0.0

    def __post_init__(self) -> None:
        if not (self.size > 0.0 and all(math.isfinite(x) for x in (*self.origin, self.size, self.turn))):
            raise BadInputError(
                f"placement has origin {self.origin} and size {self.size}; finite and size above 0 needed"
            )

    def matrix(self) -> NDArray[np.float64]:
        """Return the transform (4, 4) from stage units to scene units."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        transform = np.eye(4)
        transform[:3, :3] = self.size * np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        transform[:3, 3] = self.origin
        return transform

    def placed(self, mesh: Mesh) -> Mesh:
        """Return a mesh of the stage in scene units."""
        vertices, normals, faces = mesh
        matrix = self.matrix()
        points = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        turned = normals @ matrix[:3, :3].T / self.size
        return points.astype(np.float32), turned.astype(np.float32), faces

    def moved(self, points: NDArray[np.floating], to: StagePlacement) -> NDArray[np.float64]:
        """Return points (…, 3) of the stage after the stage has moved from this placement to `to`."""
        change = to.matrix() @ np.linalg.inv(self.matrix())
        return np.asarray(points @ change[:3, :3].T + change[:3, 3])


@dataclass(frozen=True)
class Stage:
    """A stage, by default a cyclorama: a round floor that sweeps up into a wall without an edge.

    The cyclorama is a shallow dish, not a box. A lens 10–20° above the floor sees all of it, and light
    scattered upwards leaves at once, which makes pictures several times cheaper.

    kind           one of KINDS: "cyclorama", "ground" (level to the horizon), "plinth" (the subject stands
                   on one, in a cyclorama), "corner" (two walls), "window" (a wall that the light of a window
                   crosses), "shelf" (boards before a wall), "stair" (plinths of several heights) and "table"
                   in a cyclorama, "fog" (a beam of light in a cyclorama with hazy air), WITH_REFERENCES (a
                   cyclorama with reference balls and a colour chart in the lower corners of the picture), or
                   "none" for a subject before the sky
    colour         linear Rec.709 reflectance of floor and wall
    roughness      of a clear coat on them: 0.05 mirrors, 0.4 shimmers; None is matt
    floor          radius of the flat floor, stage units
    sweep          width of the ring in which the floor rises, stage units
    steepness      slope at the outer rim, radians
    width, height  of the plinth, stage units; of a shelf, between its uprights and boards; of a table, its
                   width, and the height of its top above the floor; of a corner, the height of its walls
    plinth_colour  linear Rec.709 reflectance of the plinth, of boards and of a table
    plinth_roughness  of a clear coat on the plinth; None is matt
    wall_colour    of flat walls, or at a cyclorama's rim, which the floor's changes to; None is the floor's
    halo_colour    of a soft spot on floor and wall behind the subject; None for none
    halo_size      distance from the middle of the spot at which half of its colour is left, stage units
    halo_distance  of its middle behind the subject's middle, stage units
    horizon_fade   height of the haze in which ground melts into the sky, radians; 0 for none
    finish         of floor and wall, one of FINISHES; "" for an even one
    plinth_finish  finish of the plinth, of boards and of a table
    round          True for a round plinth, False for a square one
    shadow_catcher True if floor and wall are not seen, but the shadows on them
    """

    kind: str = "cyclorama"
    colour: Colour = (0.36, 0.355, 0.35)
    floor: float = 7.0
    sweep: float = 14.0
    steepness: float = math.radians(55.0)
    roughness: float | None = None
    width: float = 1.7
    height: float = 1.6
    round: bool = False
    shadow_catcher: bool = False
    plinth_colour: Colour = field(default=PLINTH, metadata=OMIT_DEFAULT)
    plinth_roughness: float | None = field(default=None, metadata=OMIT_DEFAULT)
    wall_colour: Colour | None = field(default=None, metadata=OMIT_DEFAULT)
    halo_colour: Colour | None = field(default=None, metadata=OMIT_DEFAULT)
    halo_size: float = field(default=3.0, metadata=OMIT_DEFAULT)
    halo_distance: float = field(default=6.0, metadata=OMIT_DEFAULT)
    horizon_fade: float = field(default=0.0, metadata=OMIT_DEFAULT)
    finish: str = field(default="", metadata=OMIT_DEFAULT)
    plinth_finish: str = field(default="", metadata=OMIT_DEFAULT)

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise BadInputError(f"stage is {self.kind!r}; it can be {', '.join(KINDS)}")
        for finish in (self.finish, self.plinth_finish):
            if finish and finish not in FINISHES:
                raise BadInputError(f"stage has finish {finish!r}; it can be {', '.join(FINISHES)}")
        if self.shadow_catcher and self.kind in ("none", "fog"):
            what = "no floor" if self.kind == "none" else "light in its air, and no bare floor"
            raise BadInputError(f"stage {self.kind} has {what} to catch shadows; use ground or cyclorama")
        if min(self.floor, self.sweep) <= 0.0 or not 0.0 < self.steepness <= math.pi / 2.0:
            raise BadInputError("a cyclorama's floor and sweep must be above 0, its steepness in 0° … 90°")
        if not (self.width >= 8.0 * BEVEL and self.height >= 8.0 * BEVEL):
            raise BadInputError(
                f"a plinth is {self.width} wide and {self.height} high; both need {8 * BEVEL}"
            )
        for roughness in (self.roughness, self.plinth_roughness):
            if roughness is not None and not 0.0 <= roughness <= 1.0:
                raise BadInputError(f"stage has roughness {roughness}; it must lie between 0 and 1")
        if self.horizon_fade and (self.kind != "ground" or not 0.0 < self.horizon_fade < math.pi / 4.0):
            raise BadInputError("only ground fades at its horizon, over an angle above 0° and below 45°")
        if not self.halo_size > 0.0:
            raise BadInputError(f"a halo has the size {self.halo_size}; it must be above 0")

    @property
    def coat(self) -> float | None:
        """Roughness of the coat of floor and wall: their own, or that of their finish; None is matt."""
        return FINISHES[self.finish][0] if self.finish and self.roughness is None else self.roughness

    @property
    def plinth_coat(self) -> float | None:
        """Roughness of the coat of the plinth."""
        own = self.plinth_roughness
        return FINISHES[self.plinth_finish][0] if self.plinth_finish and own is None else own

    @property
    def objects(self) -> tuple[str, ...]:
        """The names of its objects."""
        return _OBJECTS.get(self.kind, ("stage",))

    def camera_move(self, aspect: float | None) -> tuple[float, ...] | None:
        """Return a factor on the camera's distance and stage units to lower it; None where it stays.

        In narrow pictures also the width that must be in the picture, stage units. `adjusted_camera` uses it.

        aspect  width to height of the picture; None where it is all around
        """
        move = _CAMERA_MOVES.get(self.kind)
        is_narrow = aspect is not None and aspect < _WIDE
        return (*move, self.width) if move and self.kind == "plinth" and is_narrow else move

    def adjusted_camera(self, camera: Camera, placement: StagePlacement, aspect: float | None) -> Camera:
        """Return the camera moved back and down where this stage needs space around the subject.

        aspect  as of `camera_move`
        """
        if (move := self.camera_move(aspect)) is None:
            return camera
        back, down, *widths = move
        if aspect is not None:
            half_height = (
                math.dist(camera.origin, camera.target) * math.tan(camera.field_of_view / 2.0) / aspect
            )
            back = max(back, _IN_VIEW + down * placement.size / half_height)
        for half in (width / 2.0 * placement.size for width in widths):
            needed = half + _AROUND * half / math.tan(camera.field_of_view / 2.0)
            back = min(max(back, needed / math.dist(camera.origin, camera.target)), _FARTHEST * back)
        x, y, z = camera.target
        away = [back * (a - b) for a, b in zip(camera.origin, camera.target, strict=True)]
        target = (x, y - down * placement.size, z)
        return replace(
            camera, target=target, origin=(target[0] + away[0], target[1] + away[1], target[2] + away[2])
        )

    def mesh(self) -> Mesh:
        """Return backdrop and plinth as one mesh, without reference objects."""
        return joined([self.backdrop(), *([] if (plinth := self.plinth()) is None else [plinth])])

    def backdrop(self) -> Mesh:
        """Return vertices (V, 3), normals (V, 3) and faces (F, 3) of floor and wall, seen from inside."""
        if self.kind in ROOMS:
            return room_backdrop(self.kind, self.height)
        vertices, normals, faces = _revolve(*self.profile(), 4 * SIDES if self.is_graded else SIDES)
        return vertices - np.array([0.0, self.floor_depth, 0.0], dtype=np.float32), normals, faces

    @property
    def floor_depth(self) -> float:
        """How far below the subject the floor of a cyclorama is, stage units."""
        return self.height if self.kind in ("plinth", "stair", "table") else 0.0

    @property
    def fog(self) -> Fog | None:
        """The air, where it scatters light."""
        return Fog() if self.kind == "fog" else None

    @property
    def wall_elevation(self) -> float:
        """Angle above the horizon, radians, up to which its wall hides the sky all around; 0 for none."""
        return math.atan2(*reversed(self.rim)) if self.kind in CYCLORAMAS else 0.0

    @property
    def rim(self) -> tuple[float, float]:
        """Radius of the outer rim of a cyclorama, and its height above the subject's base, stage units."""
        radius, height = self.profile()[0][-1].tolist()
        return radius, height - self.floor_depth

    @property
    def is_graded(self) -> bool:
        """True if floor and wall differ in colour."""
        return self.wall_colour is not None or self.halo_colour is not None

    def reflectances(self, fades: bool = False) -> NDArray[np.float32]:
        """Return the reflectance (V, 3) of the backdrop's vertices.

        fades  True to fade into the dark, down to 0 at the rim of a cyclorama, which would be a hard edge to
               the black above; ground, which ends at the horizon, does not fade
        """
        points, normals, _ = self.backdrop()
        points = points + np.array([0.0, self.floor_depth, 0.0], np.float32)
        colours = self.reflectance_at(points, normals)
        if fades and self.kind in CYCLORAMAS:
            colours *= np.float32(1.0) - self._rise(points).astype(np.float32)
        return colours

    def reflectance_at(
        self, points: NDArray[np.floating], normals: NDArray[np.floating]
    ) -> NDArray[np.float32]:
        """Return the reflectance (N, 3) of points (N, 3) on floor and wall, with the floor at y = 0.

        normals  (N, 3), of the surface there
        """
        colours = np.tile(np.array(self.colour, np.float32), (len(points), 1))
        if self.kind in ROOMS:
            colours[normals[:, 1] < 0.5] = self.wall_colour or self.colour
            return colours
        if self.wall_colour is not None:
            colours += self._rise(points) * (np.array(self.wall_colour) - self.colour)
        if self.halo_colour is not None:
            height = float(np.interp(self.halo_distance, *self.profile()[0].T))
            middle = [0.0, height, -self.halo_distance]
            away = np.linalg.norm(points - middle, axis=1, keepdims=True) / self.halo_size
            colours += 0.5 ** (away * away) * (np.array(self.halo_colour) - colours)
        return colours.astype(np.float32)

    def opacity_at(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return how much of the ground is there (N,) at points (N, 3), stage units: 1 near, 0 at its rim."""
        radius = np.hypot(points[:, 0], points[:, 2])
        t = _rising(np.clip((radius - FLAT_RADIUS) / (HORIZON_RADIUS - FLAT_RADIUS), 0.0, 1.0))
        return np.asarray((1.0 - t * t * (3.0 - 2.0 * t)) ** 2, np.float32)

    def _rise(self, points: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return how far points (N, 3) are from the floor to the rim of a cyclorama (N, 1), 0 to 1."""
        t = np.clip((np.hypot(points[:, :1], points[:, 2:]) - self.floor) / self.sweep, 0.0, 1.0)
        return np.asarray(t * t * (3.0 - 2.0 * t))

    def plinth(self) -> Mesh | None:
        """Return the mesh of what the subject stands on, its top at y = 0; None where that is the floor."""
        return props(self.kind, self.width, self.height, self.round)

    def profile(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points (N, 2) of radius and height, from the middle outwards, and their inward normals."""
        return self._level() if self.kind == "ground" else self._dish()

    def _level(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the profile of the ground and its normals: flat, then rising to the height of the eye.

        The horizon is at that height. Where it fades, the ground rises by the angle of its haze.
        """
        t = np.linspace(0.0, 1.0, RINGS)
        radius = FLAT_RADIUS + t * (HORIZON_RADIUS - FLAT_RADIUS)
        rise = _rising(t) * HORIZON_HEIGHT
        if self.horizon_fade:
            rise += _rising(t) * radius * math.tan(self.horizon_fade)
        slope = np.arctan2(np.gradient(rise), np.gradient(t * (HORIZON_RADIUS - FLAT_RADIUS)))
        curve = np.stack([radius, rise], axis=1)
        inwards = np.stack([-np.sin(slope), np.cos(slope)], axis=1)
        return np.concatenate([[[0.0, 0.0]], curve]), np.concatenate([[[0.0, 1.0]], inwards])

    def _dish(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the profile of a cyclorama and its normals.

        The slope follows a smoothstep: the curvature begins and ends at 0. Where an arc meets the floor, its
        jump of curvature would show as a line in reflections and gradients.
        """
        t = np.linspace(0.0, 1.0, RINGS)
        slope = self.steepness * _rising(t)
        steps = np.stack([np.cos(slope), np.sin(slope)], axis=1)
        curve = np.concatenate([[[0.0, 0.0]], np.cumsum((steps[1:] + steps[:-1]) / 2.0, axis=0)])
        curve = curve / curve[-1, 0] * self.sweep + [self.floor, 0.0]
        inwards = np.stack([-np.sin(slope), np.cos(slope)], axis=1)
        rings = 16 if self.is_graded else 2
        middle = np.stack([np.arange(rings) / rings * self.floor, np.zeros(rings)], axis=1)
        return np.concatenate([middle, curve]), np.concatenate([[[0.0, 1.0]] * rings, inwards])


def _rising(t: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return a step from 0 to 1 whose slope and curvature begin and end at 0."""
    return np.asarray(t**3 * (10.0 - 15.0 * t + 6.0 * t**2))


def _revolve(profile: NDArray[np.float64], normals: NDArray[np.float64], sides: int = SIDES) -> Mesh:
    """Return the mesh of a profile (N, 2) turned about the y axis; faces look towards the axis."""
    angle = np.linspace(0.0, 2.0 * math.pi, sides, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def turned(pairs: NDArray[np.float64]) -> NDArray[np.float32]:
        ring = np.empty((len(pairs), sides, 3), dtype=np.float32)
        ring[..., 0] = pairs[:, :1] * circle[:, 0]
        ring[..., 1] = pairs[:, 1:]
        ring[..., 2] = pairs[:, :1] * circle[:, 1]
        return ring.reshape(-1, 3)

    i = np.arange(len(profile) - 1)[:, None] * sides
    j = np.arange(sides)[None, :]
    k = (j + 1) % sides
    inner_j, inner_k, outer_j, outer_k = i + j, i + k, i + sides + j, i + sides + k
    first = np.stack([inner_j, outer_k, outer_j], axis=-1)
    second = np.stack([inner_j, inner_k, outer_k], axis=-1)[1:]  # without area at the middle
    faces = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)]).astype(np.int32)
    return turned(profile), turned(normals), faces


STAGES = {kind: Stage(kind) for kind in KINDS}
STAGES["corner"] = Stage("corner", height=HIGH)
STAGES["shelf"] = Stage("shelf", width=4.6, height=2.9)
STAGES["table"] = Stage("table", width=6.0, height=2.6)
STAGES[WITH_REFERENCES] = Stage(WITH_REFERENCES, colour=(0.32, 0.32, 0.32))
"""What a subject stands on or in, by the names of shot files."""
