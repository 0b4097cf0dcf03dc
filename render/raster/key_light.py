"""The shadow map of a quick preview's key light: the first softbox, or where there is none the first sun."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.raster.raster_shapes import Floats, ScreenProjection, Shape, StageSetup, plinth_shape
from render.raster.reflectance import shadow_opacity
from render.raster.shadow_map import (
    BLOCK,
    block_maxima,
    light_coordinates,
    light_visibility,
    move_halfway,
    render_depth,
)
from render.scene.render_camera import Camera, unit
from render.scene.scene_lights import LightRig, Softbox

SHADOW_REACH = 2.6
"""Half the width of the shadow map, stage units at the subject."""

SUN_DISTANCE = 60.0
"""Distance from which the sun's shadow map is rendered, stage units."""

SHADOW_SIDE = 64 * BLOCK
"""Pixels along each side of the shadow map."""

SHADOW_LIFT = 0.06
"""Stage units above a surface at which its shadow is looked up, so that it does not shade itself."""


@dataclass(frozen=True, eq=False)
class ShadowMap:
    """A shadow map. Without a key light there is no projection, and arrays are empty.

    nearness  (SHADOW_SIDE, SHADOW_SIDE), one over the depth, 0 for no surface
    blocks    (SHADOW_SIDE / BLOCK, SHADOW_SIDE / BLOCK), as the kernel `block_maxima` computes them
    lift      SHADOW_LIFT in scene units
    opacity   the fraction of the key light that the shadow lacks
    """

    projection: ScreenProjection | None
    nearness: NDArray[np.float32]
    blocks: NDArray[np.float32]
    lift: float
    opacity: float

    @classmethod
    def of(cls, subject: Shape, setup: StageSetup, side: int) -> ShadowMap:
        """Render a shadow map. side: as in the kernel `render_depth`"""
        opacity = shadow_opacity(subject.material)
        camera, lift = _key_camera(setup), SHADOW_LIFT * setup.placement.size
        if camera is None:
            return cls(None, np.zeros((0, 0), np.float32), np.zeros((0, 0), np.float32), lift, 1.0)
        projection, square = ScreenProjection.of(camera, 1.0), (SHADOW_SIDE, SHADOW_SIDE)
        layers = np.zeros((2, *square), np.float32)
        blocks = np.empty((SHADOW_SIDE // BLOCK,) * 2, np.float32)
        render_depth(projection.project(subject.vertices, *square), subject.faces, side, layers)
        if side:
            move_halfway(layers)
        if setup.stage.kind == "plinth":
            plinth = plinth_shape(setup.stage, setup.placement)
            render_depth(projection.project(plinth.vertices, *square), plinth.faces, 0, layers)
        block_maxima(layers[0], blocks)
        return cls(projection, layers[0], blocks, lift, opacity)

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
        light_visibility(coordinates, self.nearness, self.blocks, self.opacity, fraction)
        return fraction


def _key_camera(setup: StageSetup) -> Camera | None:
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
        return placed_softbox(rig.softboxes[0], setup)
    target = np.add(setup.placement.origin, (0.0, setup.placement.size, 0.0))
    return target - SUN_DISTANCE * setup.placement.size * unit(np.array(rig.suns[0].direction)), target


def placed_softbox(box: Softbox, setup: StageSetup) -> tuple[Floats, Floats]:
    """Return the position of a softbox (3,) and its target (3,), scene units."""
    matrix = setup.placement.matrix()
    position, target = (matrix[:3, :3] @ np.array(at) + matrix[:3, 3] for at in (box.position, box.target))
    return position, target
