"""The shadow that the subject and its plinth cast: what the key light sees, as a picture of depths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.raster.kernels.shadow_map import BLOCK, cast, halve, largest, places, reaches
from render.raster.lamps import key_camera
from render.raster.parts import Lens, Set, Shape, plinth_shape

SIDE = 64 * BLOCK
"""Pixels of its picture along each side."""

LIFT = 0.06
"""Stage units above a surface at which its shadow is looked up: a surface must not shade itself."""


@dataclass(frozen=True, eq=False)
class Shadow:
    """What the key light sees; without a lens there is no key light, and pictures are empty.

    near    (S, S), one over the depth, 0 where nothing is
    blocks  (S / BLOCK, S / BLOCK), as the kernel `largest` finds them
    lift    scene units
    """

    lens: Lens | None
    near: NDArray[np.float32]
    blocks: NDArray[np.float32]
    lift: float

    @classmethod
    def of(cls, subject: Shape, around: Set, side: int) -> Shadow:
        """side  as the kernel `cast` takes it"""
        camera, lift = key_camera(around), LIFT * around.placement.size
        if camera is None:
            return cls(None, np.zeros((0, 0), np.float32), np.zeros((0, 0), np.float32), lift)
        lens = Lens.of(camera, 1.0)
        near, blocks = np.zeros((2, SIDE, SIDE), np.float32), np.empty((SIDE // BLOCK,) * 2, np.float32)
        cast(lens.project(subject.vertices, SIDE, SIDE), subject.faces, side, near)
        if side:
            halve(near)
        if around.stage.kind == "plinth":
            plinth = plinth_shape(around.stage, around.placement)
            cast(lens.project(plinth.vertices, SIDE, SIDE), plinth.faces, 0, near)
        largest(near[0], blocks)
        return cls(lens, near[0], blocks, lift)

    def places(self, shape: Shape, which: NDArray[np.intp], outwards: int) -> NDArray[np.float32]:
        """(3, N): where vertices are looked up in the picture; `outwards` as of `Sides`."""
        found = np.zeros((3, len(which)), np.float32)
        lift = -self.lift if outwards < 0 else self.lift
        if self.lens is not None:
            places(shape.vertices, shape.normals, which, lift, self.lens.origin, self.lens.axes, found)
        return found

    def reaches(self, places: NDArray[np.float32]) -> NDArray[np.float32]:
        """(N,): how much of the key light is seen from there, from 0 to 1."""
        share = np.empty(places.shape[1], np.float32)
        reaches(places, self.near, self.blocks, share)
        return share
