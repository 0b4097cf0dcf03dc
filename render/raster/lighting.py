"""Lighting of a quick preview: the light that vertices send to the camera.

Tables hold the light that stage and sky send to a subject, by direction, on an octahedron that is unfolded to
a square (Engelhardt and Dachsbacher 2008). They are those of a stage, whatever its size and place, so that a
shot needs them once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.raster.preview_sky import facing_stage, radiance
from flowsculpt.render.raster.raster_shapes import (
    SHARPNESS,
    Array,
    Floats,
    Shape,
    StageSetup,
    body_colours,
    fast,
    reflectance_of,
)
from flowsculpt.render.raster.shadows import CELL, REACH, ContactShadow, open_at, placed_softbox
from flowsculpt.render.scene.materials import Diffuse
from flowsculpt.render.scene.render_camera import unit
from flowsculpt.render.scene.room_shapes import ROOMS, WINDOWS, shelf_opening
from flowsculpt.render.scene.scene_lights import LightRig, Softbox
from flowsculpt.render.scene.scene_stage import CYCLORAMAS, Stage, StagePlacement

SIDE = 33  # directions along each side of a table: about 8° apart
EYE_HEIGHT = 0.8  # height over the floor from which the surroundings are seen, stage units

Table = NDArray[np.float32]

FloorLight = Callable[[NDArray[np.float32], NDArray[np.float32]], NDArray[np.float32]]
"""Returns the radiance (N, 3) of points (N, 3) of the stage with normals (N, 3), stage units."""


class Surroundings(NamedTuple):
    """Tables (SIDE, SIDE, 3): what a mirror shows of a direction, and what a matt white surface sends that
    faces it.
    """

    mirrored: Table
    matt: Table


def surroundings_of(seen: NDArray[np.float64], roughness: float) -> Surroundings:
    """Return tables of the radiance that is seen (SIDE², 3) of directions. roughness: of the mirror"""
    exponent = _exponent(roughness)
    mirrored = seen if exponent is None else _lobe(exponent) @ seen
    return Surroundings(_grid(mirrored), _grid(_lobe(1.0) @ seen))


def stage_radiance(stage: Stage, sky: NDArray[np.float64], light: FloorLight) -> NDArray[np.float64]:
    """Return the radiance (SIDE², 3) of the stage and of the sky over it, seen from above its middle.

    sky  (SIDE², 3), radiance of the sky alone
    """
    if stage.kind in ROOMS:
        return _room_radiance(stage, sky, light)
    profile, slopes = stage.profile()
    seen_at = np.arctan2(profile[:, 1] - EYE_HEIGHT, profile[:, 0])
    towards = directions()
    elevation = np.arcsin(np.clip(towards[:, 1], -1.0, 1.0))
    columns = (np.interp(elevation, seen_at, column) for column in (*profile.T, *slopes.T))
    radius, height, inward, upward = columns
    on_floor = height == 0.0
    radius[on_floor] = EYE_HEIGHT / np.tan(np.maximum(-elevation[on_floor], 1e-3))
    level = np.hypot(towards[:, 0], towards[:, 2])
    x, z = (towards[:, k] / np.maximum(level, 1e-12) for k in (0, 2))
    points = np.stack([radius * x, height, radius * z], axis=1).astype(np.float32)
    normals = np.stack([inward * x, upward, inward * z], axis=1).astype(np.float32)
    hidden = (elevation > seen_at[-1])[:, None]
    return np.where(hidden, sky, light(points, normals))


def _room_radiance(stage: Stage, sky: NDArray[np.float64], light: FloorLight) -> NDArray[np.float64]:
    """Return the radiance (SIDE², 3) of a room's flat walls and of the sky, seen from over its middle.

    Rays are intersected with the triangles of the backdrop (Möller and Trumbore 1997).
    """
    vertices, normals, faces = stage.backdrop()
    eye, towards = np.array([0.0, EYE_HEIGHT, 0.0]), directions()
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    facing = np.cross(b - a, c - a)
    nearest, hit = np.full(len(towards), np.inf), np.zeros((len(towards), 3))
    for row, way in enumerate(towards):
        across = facing @ way
        with np.errstate(divide="ignore", invalid="ignore"):  # of faces along the ray
            away = np.einsum("fk,fk->f", facing, a - eye) / across
            turned = np.cross(eye - a, way)
            u = np.einsum("fk,fk->f", c - a, turned) / -across
            v = np.einsum("fk,fk->f", b - a, turned) / across
            inside = (across < 0.0) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (away > 0.0)
        if inside.any():
            face = np.flatnonzero(inside)[away[inside].argmin()]
            nearest[row], hit[row] = away[face], normals[faces[face, 0]]
    seen = np.isfinite(nearest)
    radiance_seen = sky.copy()
    points = (eye + nearest[seen, None] * towards[seen]).astype(np.float32)
    radiance_seen[seen] = light(points, hit[seen].astype(np.float32))
    return radiance_seen


@lru_cache(maxsize=1)
def directions() -> NDArray[np.float64]:
    """Return the unit directions (SIDE², 3) of a table, in its order."""
    points = _octahedron()
    return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))


def _octahedron() -> NDArray[np.float64]:
    across = np.linspace(-1.0, 1.0, SIDE)
    x, z = (part.ravel() for part in np.meshgrid(across, across, indexing="ij"))
    y = 1.0 - np.abs(x) - np.abs(z)
    below = y < 0.0
    folded_x, folded_z = (1.0 - np.abs(z)) * np.sign(x), (1.0 - np.abs(x)) * np.sign(z)
    return np.stack([np.where(below, folded_x, x), y, np.where(below, folded_z, z)], axis=1)


@lru_cache(maxsize=8)
def _lobe(exponent: float) -> NDArray[np.float64]:
    """Return weights (SIDE², SIDE²) that average radiance over a cosine lobe around each direction."""
    edges = np.full(SIDE, 1.0)
    edges[[0, -1]] = 0.5
    solid_angle = np.outer(edges, edges).ravel() / np.linalg.norm(_octahedron(), axis=1) ** 3
    weights = np.maximum(directions() @ directions().T, 0.0) ** exponent * solid_angle
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _exponent(roughness: float) -> float | None:
    """Return the exponent of the lobe that a rough mirror reflects, or None for less than a table's step."""
    exponent = 0.5 / max(roughness, 1e-3) ** 2
    return None if exponent > 200.0 else max(1.0, round(exponent, 1))


def _grid(seen: NDArray[np.float64]) -> Table:
    return np.ascontiguousarray(seen.reshape(SIDE, SIDE, 3), np.float32)


@fast
def table_place(x: float, y: float, z: float) -> tuple[int, int, float, float]:
    """Return the row and column of a unit direction in a table, and the weights of the next ones."""
    scale = 1.0 / (math.fabs(x) + math.fabs(y) + math.fabs(z))
    u, v = x * scale, z * scale
    if y < 0.0:
        u, v = math.copysign(1.0 - math.fabs(v), u), math.copysign(1.0 - math.fabs(u), v)
    u, v = (0.5 + 0.5 * u) * (SIDE - 1), (0.5 + 0.5 * v) * (SIDE - 1)
    row, column = min(max(int(u), 0), SIDE - 2), min(max(int(v), 0), SIDE - 2)
    return row, column, u - row, v - column


@fast
def table_value(table: Array, row: int, column: int, down: float, right: float, k: int) -> float:
    """Return channel k of a table between four of its directions."""
    near = table[row, column, k] + right * (table[row, column + 1, k] - table[row, column, k])
    far = table[row + 1, column, k] + right * (table[row + 1, column + 1, k] - table[row + 1, column, k])
    return float(near + down * (far - near))


_BOARDS_LIT = 0.5
"""Light of a shelf's boards, from below and above, over that of a board in the light of the key."""

_FAINT = 1e-5  # part of a highlight's brightness below which it is left out


@dataclass(frozen=True, eq=False)
class Lighting:
    """The light on a scene, and the position it is seen from.

    lights  (L, 10), as the kernel `shade_vertices` takes them
    eye     (3,), scene units
    """

    setup: StageSetup
    contact: ContactShadow
    lights: Floats
    eye: Floats

    @classmethod
    def of(cls, setup: StageSetup, contact: ContactShadow, eye: Floats) -> Lighting:
        """Return the lighting of a stage."""
        return cls(setup, contact, _light_rows(setup), eye)

    @classmethod
    def of_stage(cls, rig: LightRig, stage: Stage) -> Lighting:
        """Return the lighting of a stage alone, seen from above its middle, in stage units."""
        setup = StageSetup(rig, stage, StagePlacement())
        contact = ContactShadow.of(np.empty((0, 3), np.float32), setup.placement, has_floor=False)
        return cls.of(setup, contact, np.array([0.0, EYE_HEIGHT, 0.0]))

    def shade(
        self,
        shape: Shape,
        which: NDArray[np.intp],
        side: int,
        is_stage: bool = False,
        sharpness: tuple[float, float] = SHARPNESS,
        sees_sky_alone: bool = False,
    ) -> NDArray[np.float32]:
        """Return linear light (N, 6) of vertices with the key light (3) and without it (3).

        which           (N,), their indices
        side            as in the kernel
        is_stage        True for the stage; ground sees the sky alone, others their own walls too
        sharpness       the least and greatest exponent of highlights
        sees_sky_alone  True for no light of the stage
        """
        colours = np.array([shape.material.colour]) if shape.colours is None else shape.colours
        colours = body_colours(shape.material, np.asarray(colours, np.float64))
        sees_sky_alone = sees_sky_alone or (is_stage and self.setup.stage.kind == "ground")
        around = _surroundings(self.setup, shape.material.roughness, sees_sky_alone)
        out = np.empty((len(which), 6), np.float32)
        shade_vertices(
            shape.vertices,
            shape.normals,
            np.ascontiguousarray(colours),
            which,
            side,
            self.eye,
            np.array(reflectance_of(shape.material, sharpness)),
            around,
            self.contact,
            self.lights,
            out,
        )
        if is_stage and self.setup.stage.kind == "shelf":
            self._hide_by_boards(shape.vertices[which], out)
        if self.setup.stage.kind in CYCLORAMAS and len(self.lights) and self.lights[0, 9] == 0.0:
            self._hide_by_rim(shape.vertices[which], out)
        if (in_beam := self.in_beam(shape.vertices[which])) is not None:
            out[~in_beam, :3] = out[~in_beam, 3:]
        return out

    def in_beam(self, points: NDArray[np.floating]) -> NDArray[np.bool_] | None:
        """Return which points (N, 3) are around the beam of a key light with a hood; None without one."""
        window, boxes = WINDOWS.get(self.setup.stage.kind), self.setup.lights.softboxes
        if (
            window is None
            or not window.has_hood
            or not boxes
            or math.dist(boxes[0].position, window.light) > 0.5
        ):
            return None
        matrix = self.setup.placement.matrix()
        axis = matrix[:3, :3] @ np.subtract(window.target, window.light)
        away = points - (matrix[:3, :3] @ np.array(window.light) + matrix[:3, 3])
        along = away @ axis / np.linalg.norm(axis)
        return np.asarray(np.linalg.norm(away, axis=1) < math.hypot(1.0, window.opening) * along)

    def _hide_by_rim(self, points: NDArray[np.float32], light: NDArray[np.float32]) -> None:
        """Take the key light, a sun, from light (N, 6) of points that are in the shadow of a cyclorama."""
        placement, (radius, height) = self.setup.placement, self.setup.stage.rim
        axes = placement.matrix()[:3, :3] / placement.size
        places = (points - placement.origin) @ axes / placement.size
        x, up, z = self.lights[0, :3] @ axes
        across = max(math.hypot(x, z), 1e-6)
        along = (places[:, 0] * x + places[:, 2] * z) / across
        inside = np.maximum(radius**2 - places[:, 0] ** 2 - places[:, 2] ** 2, 0.0)
        to_rim = np.sqrt(along**2 + inside) - along
        is_hidden = places[:, 1] + to_rim * up / across < height
        light[is_hidden, :3] = light[is_hidden, 3:]

    def _hide_by_boards(self, points: NDArray[np.float32], light: NDArray[np.float32]) -> None:
        """Change light (N, 6) of a shelf's wall: boards hide the room from it, and send it their own."""
        setup, stage, placement = self.setup, self.setup.stage, self.setup.placement
        places = (points - placement.origin) @ placement.matrix()[:3, :3] / placement.size**2
        seen = shelf_opening(places, stage.width, stage.height)
        on_wall = np.isfinite(seen)
        key, others = light[on_wall, :3] - light[on_wall, 3:], light[on_wall, 3:]
        boards = floor_light(setup.lights, replace(stage, kind="none", colour=stage.plinth_colour))[0]
        share = seen[on_wall, None]
        thrown = _BOARDS_LIT * (1.0 - share) * boards * np.array(stage.wall_colour or stage.colour)
        light[on_wall, 3:] = share * others + thrown
        light[on_wall, :3] = key + light[on_wall, 3:]

    def mirrored(self, roughness: float) -> Table:
        """Return what a mirror of this roughness shows of the surroundings, as in `Surroundings`."""
        return _surroundings(self.setup, roughness, False).mirrored


def _surroundings(setup: StageSetup, roughness: float, sees_sky_alone: bool) -> Surroundings:
    stage = None if sees_sky_alone or setup.stage.kind == "none" else replace(setup.stage, roughness=None)
    return _surroundings_of(facing_stage(setup.lights, setup.placement.turn), stage, roughness)


_THROUGH_WINDOW = 0.2
"""Share of floor and walls that the light of a window reaches."""


@lru_cache(maxsize=16)
def _surroundings_of(rig: LightRig, stage: Stage | None, roughness: float) -> Surroundings:
    """Return the tables of a stage, or those of the sky alone."""
    sky = radiance(rig, directions())
    if stage is None:
        return surroundings_of(sky, roughness)
    lighting = Lighting.of_stage(rig, stage)

    def light(points: NDArray[np.float32], normals: NDArray[np.float32]) -> NDArray[np.float32]:
        colours = stage.reflectance_at(points, normals).astype(float) if stage.is_graded else None
        floor = Shape(points, normals, np.empty((0, 3), np.int32), Diffuse(stage.colour), colours)
        lit = lighting.shade(floor, np.arange(len(points)), 1, is_stage=True, sees_sky_alone=True)
        share = _THROUGH_WINDOW if stage.kind in WINDOWS else 1.0
        return share * lit[:, :3] + (1.0 - share) * lit[:, 3:]

    return surroundings_of(stage_radiance(stage, sky, light), roughness)


def floor_light(rig: LightRig, stage: Stage) -> NDArray[np.float32]:
    """Return the linear light (2, 3) of the middle of a stage's floor, with the key light and without it."""
    lighting = Lighting.of_stage(rig, stage)
    middle, upwards = np.zeros((1, 3), np.float32), np.array([[0.0, 1.0, 0.0]], np.float32)
    floor = Shape(middle, upwards, np.empty((0, 3), np.int32), Diffuse(stage.colour))
    return lighting.shade(floor, np.arange(1), 1, is_stage=True).reshape(2, 3)


def _light_rows(setup: StageSetup) -> Floats:
    """Return the lights (L, 10), the key light first, as the kernel `shade_vertices` takes them."""
    rows = [_softbox_row(box, setup) for box in setup.lights.softboxes]
    rows += [
        np.array([*-unit(np.array(sun.direction)), 0.0, 0.0, 0.0, *sun.irradiance, 0.0])
        for sun in setup.lights.suns
    ]
    return np.array(rows).reshape(-1, 10)


def _softbox_row(box: Softbox, setup: StageSetup) -> Floats:
    position, target = placed_softbox(box, setup)
    area = box.width * box.height * setup.placement.size**2
    power = area * np.array(box.radiance)
    return np.array([*position, *unit(target - position), *power, np.sqrt(area) / 2.0])


@fast
def shade_vertices(
    points: Array,
    normals: Array,
    colours: Array,
    which: Array,
    side: int,
    eye: Array,
    reflectance: Array,
    around: Surroundings,
    contact: ContactShadow,
    lights: Array,
    out: Array,
) -> None:
    """Compute the light of vertices with the first of the lights (3) and without it (3), into out (N, 6).

    points       (V, 3), as normals (V, 3), and colours (V, 3) or (1, 3)
    which        (N,), the vertices to shade
    side         0 if both sides may be visible: normals then turn to the eye. For a closed surface 1, or -1
                 if its normals point inwards; a vertex just behind its outline stays outside
    reflectance  (6,), as in `Reflectance`
    lights       (L, 10): for a softbox its position, the direction it faces, radiance times area, and half
                 its width; for a sun the direction to it, 0, 0, 0, irradiance, and 0
    """
    mirrored, matt = around
    frame, reached = contact
    body_weight, mirror_weight, coat = reflectance[0], reflectance[1], reflectance[2]
    grazing, exponent = reflectance[3] - coat, reflectance[4]
    least = _FAINT ** (1.0 / exponent)
    scale_to_stage, cosine_turn, sine_turn = 1.0 / frame[3], frame[4], frame[5]
    for row in range(which.shape[0]):
        v = which[row]
        ex, ey, ez = eye[0] - points[v, 0], eye[1] - points[v, 1], eye[2] - points[v, 2]
        scale = _inverse_length(ex * ex + ey * ey + ez * ez)
        ex, ey, ez = ex * scale, ey * scale, ez * scale
        nx, ny, nz = float(normals[v, 0]), float(normals[v, 1]), float(normals[v, 2])
        facing = nx * ex + ny * ey + nz * ez
        scale = _inverse_length(nx * nx + ny * ny + nz * nz)
        if side < 0 or (side == 0 and facing < 0.0):
            scale = -scale
        nx, ny, nz, facing = nx * scale, ny * scale, nz * scale, min(max(facing * scale, 0.0), 1.0)
        fresnel = coat + grazing * (1.0 - facing) ** 5
        left_to_body = body_weight * (1.0 - reflectance[5] * fresnel)
        open_below = 1.0
        if reached.shape[0] > 0 and ny < 0.99:  # the floor under a subject is dark, and lights it less
            x, z = (points[v, 0] - frame[0]) * scale_to_stage, (points[v, 2] - frame[2]) * scale_to_stage
            x, z = cosine_turn * x - sine_turn * z, sine_turn * x + cosine_turn * z
            height = min(max((points[v, 1] - frame[1]) * scale_to_stage, 0.0), 1.0)
            taken = 1.0 - open_at(reached, (x + REACH) / CELL - 0.5, (z + REACH) / CELL - 0.5)
            open_below = 1.0 - taken * (1.0 - height) * (0.5 - 0.5 * ny)
        x, y, z = 2.0 * facing * nx - ex, 2.0 * facing * ny - ey, 2.0 * facing * nz - ez
        x, z = cosine_turn * x - sine_turn * z, sine_turn * x + cosine_turn * z
        i, j, down, right = table_place(x, y, z)
        x, z = cosine_turn * nx - sine_turn * nz, sine_turn * nx + cosine_turn * nz
        m, n, matt_down, matt_right = table_place(x, ny, z)
        index = v if len(colours) > 1 else 0
        for k in range(3):
            body = left_to_body * colours[index, k]
            mirror = mirror_weight * colours[index, k] + fresnel
            ambient = body * table_value(matt, m, n, matt_down, matt_right, k)
            if mirror > 0.0:
                ambient += mirror * table_value(mirrored, i, j, down, right, k)
            out[row, k] = out[row, 3 + k] = open_below * ambient
        for i in range(lights.shape[0]):
            x, y, z, strength, half_width = lights[i, 0], lights[i, 1], lights[i, 2], 1.0, 0.0
            if lights[i, 9] > 0.0:
                x, y, z = x - points[v, 0], y - points[v, 1], z - points[v, 2]
                squared = x * x + y * y + z * z
                scale = _inverse_length(squared)
                x, y, z = x * scale, y * scale, z * scale
                emitter_cosine = -(x * lights[i, 3] + y * lights[i, 4] + z * lights[i, 5])
                strength, half_width = max(emitter_cosine, 0.0) / squared, lights[i, 9] * scale
            cosine = nx * x + ny * y + nz * z
            if cosine < half_width and half_width > 0.0:  # the softbox crosses the horizon of the surface
                cosine = max(cosine + half_width, 0.0) ** 2 / (4.0 * half_width)
            strength *= max(cosine, 0.0)
            if strength == 0.0:
                continue
            x, y, z = x + ex, y + ey, z + ez
            scale = _inverse_length(x * x + y * y + z * z)
            half = (nx * x + ny * y + nz * z) * scale
            highlight = (exponent + 8.0) / (8.0 * math.pi) * half**exponent if half > least else 0.0
            coated = coat + grazing * (1.0 - min((ex * x + ey * y + ez * z) * scale, 1.0)) ** 5
            for k in range(3):
                body = left_to_body * colours[index, k]
                mirror = mirror_weight * colours[index, k] + coated
                sent = strength * lights[i, 6 + k] * (body / math.pi + mirror * highlight)
                out[row, k] += sent
                if i > 0:
                    out[row, 3 + k] += sent


@fast
def _inverse_length(squared: float) -> float:
    """Return one over the length of a vector."""
    return 1.0 / math.sqrt(max(squared, 1e-300))


@fast
def apply_shadow(light: Array, visibility: Array, out: Array) -> None:
    """Mix light (N, 6) of `shade_vertices` by the visible fraction (N,) of the key light, into out (N, 3)."""
    for n in range(visibility.shape[0]):
        for k in range(3):
            out[n, k] = light[n, 3 + k] + visibility[n] * (light[n, k] - light[n, 3 + k])
