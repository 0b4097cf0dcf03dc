"""Lighting of a quick preview: the light that vertices send to the camera, and the key light's shadow map."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from render.raster.kernels.shading import shade_vertices
from render.raster.kernels.shadow_map import (
    BLOCK,
    block_maxima,
    light_coordinates,
    light_visibility,
    move_halfway,
    render_depth,
)
from render.raster.shapes import Floats, ScreenProjection, Shape, StageSetup, plinth_shape
from render.scene.camera import Camera
from render.scene.lights import LightRig, Sky, Softbox, Sun
from render.scene.materials import Diffuse, Material

COAT = 0.05
"""Reflectance of a clear coat."""

SHARPNESS = (6.0, 160.0)
"""Least and greatest exponent of highlights: sharper ones would fall between vertices, and be dots."""

SHADOW_REACH = 2.6
"""Half the width of the shadow map, stage units at the subject."""

SUN_DISTANCE = 60.0
"""Distance from which the sun's shadow map is rendered, stage units."""


SHADOW_SIDE = 64 * BLOCK
"""Pixels along each side of the shadow map."""

SHADOW_LIFT = 0.06
"""Stage units above a surface at which its shadow is looked up, so that it does not shade itself."""


@dataclass(frozen=True, eq=False)
class Lighting:
    """The light on a scene, and the position it is seen from.

    ground  (3,), radiance of the unshaded stage upwards
    lights  (L, 10), as the kernel `shade_vertices` takes them
    """

    sky: Sky
    ground: Floats
    lights: Floats
    eye: Floats

    @classmethod
    def of(cls, setup: StageSetup, camera: Camera) -> Lighting:
        """Return the lighting of a stage."""
        sky, eye = setup.lights.sky, np.array(camera.origin)
        without_stage = cls(sky, np.array(sky.horizon), light_rows(setup), eye)
        if setup.stage.kind == "none":
            return without_stage
        origin, up = (np.array([v], np.float32) for v in (setup.placement.origin, (0.0, 1.0, 0.0)))
        floor = Shape(origin, up, np.empty((0, 3), np.int32), Diffuse(setup.stage.colour))
        light = without_stage.shade(floor, np.zeros(1, np.intp), 1)  # a floor faces up and sees no ground
        return replace(without_stage, ground=light[0, :3].astype(np.float64))

    def shade(self, shape: Shape, which: NDArray[np.intp], side: int) -> NDArray[np.float32]:
        """Return linear light (N, 6) of vertices with the key light (3) and without it (3).

        which  (N,), their indices
        side   as in the kernel
        """
        colours = np.array([shape.material.colour]) if shape.colours is None else shape.colours
        sharp = float(np.clip(2.0 / max(shape.material.roughness, 0.02) ** 2 - 2.0, *SHARPNESS))
        radiance = np.array([self.sky.horizon, self.sky.zenith, self.ground, (sharp, 0.0, 0.0)])
        out = np.empty((len(which), 6), np.float32)
        shade_vertices(
            shape.vertices,
            shape.normals,
            np.ascontiguousarray(colours, np.float64),
            which,
            side,
            self.eye,
            _reflection(shape.material),
            radiance,
            self.lights,
            out,
        )
        return out


def light_rows(setup: StageSetup) -> Floats:
    """Return the lights (L, 10), the key light first, as the kernel `shade_vertices` takes them."""
    rows = [_softbox_row(box, setup) for box in setup.lights.softboxes]
    rows += [_sun_row(sun) for sun in setup.lights.suns]
    return np.array(rows).reshape(-1, 10)


def key_camera(setup: StageSetup) -> Camera | None:
    """Return a camera at the key light, for a square shadow map, or None where there is no light."""
    rig, size = setup.lights, setup.placement.size
    if not (rig.softboxes or rig.suns):
        return None
    position, target = _key_position(rig, setup)
    distance = float(np.linalg.norm(target - position))
    x, y, z = position.tolist()
    a, b, c = target.tolist()
    up = (0.0, 1.0, 0.0) if np.hypot(a - x, c - z) > 1e-3 * distance else (0.0, 0.0, 1.0)
    angle = 2.0 * float(np.arctan(SHADOW_REACH * size / distance))
    return Camera((x, y, z), (a, b, c), up, angle, near=1e-3 * distance, far=1e3 * distance)


def _key_position(rig: LightRig, setup: StageSetup) -> tuple[Floats, Floats]:
    """Return the position of the key light, and its target."""
    if rig.softboxes:
        return _placed(rig.softboxes[0], setup)
    target = np.add(setup.placement.origin, (0.0, setup.placement.size, 0.0))
    return target - SUN_DISTANCE * setup.placement.size * _unit(np.array(rig.suns[0].direction)), target


def _softbox_row(box: Softbox, setup: StageSetup) -> Floats:
    position, target = _placed(box, setup)
    area = box.width * box.height * setup.placement.size**2
    power = area * np.array(box.radiance)
    return np.array([*position, *_unit(target - position), *power, np.sqrt(area) / 2.0])


def _sun_row(sun: Sun) -> Floats:
    return np.array([*-_unit(np.array(sun.direction)), 0.0, 0.0, 0.0, *sun.irradiance, 0.0])


def _placed(box: Softbox, setup: StageSetup) -> tuple[Floats, Floats]:
    matrix = setup.placement.matrix()
    position, target = (matrix[:3, :3] @ np.array(at) + matrix[:3, 3] for at in (box.position, box.target))
    return position, target


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))


def _reflection(material: Material) -> Floats:
    """Return the weights of body and mirror colours, and of the coat, (3,)."""
    if not material.has_body:
        return np.array([0.0, 1.0, 0.0])
    return np.array([1.0, 0.0, COAT if material.has_coat else 0.0])


@dataclass(frozen=True, eq=False)
class ShadowMap:
    """A shadow map. Without a key light there is no projection, and arrays are empty.

    nearness  (SHADOW_SIDE, SHADOW_SIDE), one over the depth, 0 for no surface
    blocks    (SHADOW_SIDE / BLOCK, SHADOW_SIDE / BLOCK), as the kernel `block_maxima` computes them
    lift      SHADOW_LIFT in scene units
    """

    projection: ScreenProjection | None
    nearness: NDArray[np.float32]
    blocks: NDArray[np.float32]
    lift: float

    @classmethod
    def of(cls, subject: Shape, setup: StageSetup, side: int) -> ShadowMap:
        """Render a shadow map. side: as in the kernel `render_depth`"""
        camera, lift = key_camera(setup), SHADOW_LIFT * setup.placement.size
        if camera is None:
            return cls(None, np.zeros((0, 0), np.float32), np.zeros((0, 0), np.float32), lift)
        projection = ScreenProjection.of(camera, 1.0)
        layers = np.zeros((2, SHADOW_SIDE, SHADOW_SIDE), np.float32)
        blocks = np.empty((SHADOW_SIDE // BLOCK,) * 2, np.float32)
        render_depth(
            projection.project(subject.vertices, SHADOW_SIDE, SHADOW_SIDE), subject.faces, side, layers
        )
        if side:
            move_halfway(layers)
        if setup.stage.kind == "plinth":
            plinth = plinth_shape(setup.stage, setup.placement)
            render_depth(
                projection.project(plinth.vertices, SHADOW_SIDE, SHADOW_SIDE), plinth.faces, 0, layers
            )
        block_maxima(layers[0], blocks)
        return cls(projection, layers[0], blocks, lift)

    def coordinates(self, shape: Shape, which: NDArray[np.intp], outwards: int) -> NDArray[np.float32]:
        """Return coordinates (3, N) of vertices in the map. outwards: as in `VisibleFaces`"""
        result = np.zeros((3, len(which)), np.float32)
        lift = -self.lift if outwards < 0 else self.lift
        if self.projection is not None:
            origin, axes = self.projection.origin, self.projection.axes
            light_coordinates(shape.vertices, shape.normals, which, lift, origin, axes, result)
        return result

    def visibility(self, coordinates: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the visible fraction (N,) of the key light at coordinates (3, N)."""
        fraction = np.empty(coordinates.shape[1], np.float32)
        light_visibility(coordinates, self.nearness, self.blocks, fraction)
        return fraction
