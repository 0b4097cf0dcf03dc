"""The shadow map: depths of the subject and its plinth, seen from the key light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.raster.kernels.shadow_map import (
    BLOCK,
    block_maxima,
    light_coordinates,
    light_visibility,
    move_halfway,
    render_depth,
)
from render.raster.lighting import key_camera
from render.raster.shapes import ScreenProjection, Shape, StageSetup, plinth_shape

SIDE = 64 * BLOCK
"""Pixels along each side."""

LIFT = 0.06
"""Stage units above a surface at which its shadow is looked up, so that it does not shade itself."""


@dataclass(frozen=True, eq=False)
class ShadowMap:
    """A shadow map. Without a key light there is no projection, and arrays are empty.

    nearness  (SIDE, SIDE), one over the depth, 0 for no surface
    blocks    (SIDE / BLOCK, SIDE / BLOCK), as the kernel `block_maxima` computes them
    lift      LIFT in scene units
    """

    projection: ScreenProjection | None
    nearness: NDArray[np.float32]
    blocks: NDArray[np.float32]
    lift: float

    @classmethod
    def of(cls, subject: Shape, setup: StageSetup, side: int) -> ShadowMap:
        """Render a shadow map. side: as in the kernel `render_depth`"""
        camera, lift = key_camera(setup), LIFT * setup.placement.size
        if camera is None:
            return cls(None, np.zeros((0, 0), np.float32), np.zeros((0, 0), np.float32), lift)
        projection = ScreenProjection.of(camera, 1.0)
        layers = np.zeros((2, SIDE, SIDE), np.float32)
        blocks = np.empty((SIDE // BLOCK,) * 2, np.float32)
        render_depth(projection.project(subject.vertices, SIDE, SIDE), subject.faces, side, layers)
        if side:
            move_halfway(layers)
        if setup.stage.kind == "plinth":
            plinth = plinth_shape(setup.stage, setup.placement)
            render_depth(projection.project(plinth.vertices, SIDE, SIDE), plinth.faces, 0, layers)
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
