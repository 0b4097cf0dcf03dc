"""The shadow that the subject casts: what the key light sees of it, as a picture of depths."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from render.raster._kernels_fill import fill, largest
from render.raster._kernels_pixels import BLOCK
from render.raster.lamps import key_camera
from render.raster.parts import Lens, Set, Shape

SIDE = 32 * BLOCK
"""Pixels of its picture along each side."""

LIFT = 0.06
"""Stage units above a surface at which its shadow is looked up: a surface must not shade itself."""


@dataclass(frozen=True, eq=False)
class Shadow:
    """What the key light sees: near (S, S) is one over the depth, 0 where nothing is; without a lens, (0, 0).

    lift  scene units
    """

    lens: Lens | None
    near: NDArray[np.float32]
    lift: float

    @classmethod
    def of(cls, subject: Shape, around: Set) -> Shadow:
        camera, lift = key_camera(around), LIFT * around.placement.size
        if camera is None:
            return cls(None, np.zeros((0, 0), np.float32), lift)
        lens = Lens.of(camera, 1.0)
        near, face = np.zeros((SIDE, SIDE), np.float32), np.empty((SIDE, SIDE), np.int32)
        seen = np.empty(len(subject.vertices), np.bool_)
        corners, screen = lens.project(subject.vertices)
        faces = np.ascontiguousarray(subject.faces, np.int32)
        fill(corners, screen, faces, 0, subject.closed, lens.near, near, face, seen)
        return cls(lens, near, lift)

    @cached_property
    def blocks(self) -> NDArray[np.float32]:
        """(S / BLOCK, S / BLOCK): the largest of each block and the eight around."""
        many = len(self.near) // BLOCK
        found = np.zeros((many, many), np.float32)
        largest(self.near, BLOCK, found)
        return found

    def places(self, shape: Shape, which: NDArray[np.intp]) -> NDArray[np.floating]:
        """(N, 3): where vertices are looked up in the picture, as the kernel `project` finds corners."""
        if self.lens is None:
            return np.zeros((len(which), 3))
        lifted = shape.vertices[which] + self.lift * shape.normals[which]
        return self.lens.project(np.ascontiguousarray(lifted))[0]
