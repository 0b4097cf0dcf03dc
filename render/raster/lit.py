"""What vertices send to the eye."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from render.raster.kernels.shading import light
from render.raster.lamps import lamps_of
from render.raster.parts import Floats, Set, Shape
from render.scene.camera import Camera
from render.scene.lights import Sky
from render.scene.materials import Diffuse, Material

COAT = 0.05
"""Reflectance of a clear coat."""

SHARPNESS = (6.0, 160.0)
"""Between which highlights are: sharper ones would fall between vertices, and be dots."""


@dataclass(frozen=True, eq=False)
class Lighting:
    """What lights a set, and from where that is seen.

    lamps   (L, 10), as the kernel `light` takes them
    ground  (3,): what the stage sends upwards, where nothing shades it
    """

    sky: Sky
    ground: Floats
    lamps: Floats
    eye: Floats

    @classmethod
    def of(cls, around: Set, camera: Camera) -> Lighting:
        sky, eye = around.lights.sky, np.array(camera.origin)
        alone = cls(sky, np.array(sky.horizon), lamps_of(around), eye)
        if around.stage.kind == "none":
            return alone
        place, up = (np.array([v], np.float32) for v in (around.placement.origin, (0.0, 1.0, 0.0)))
        floor = Shape(place, up, np.empty((0, 3), np.int32), Diffuse(around.stage.colour))
        sent = alone.sent(floor, np.zeros(1, np.intp), 1)  # what looks up sees no ground
        return replace(alone, ground=sent[0, :3].astype(np.float64))

    def sent(self, shape: Shape, which: NDArray[np.intp], side: int) -> NDArray[np.float32]:
        """(N, 6): linear light of vertices with the key light, and without it; `side` as of the kernel."""
        colours = np.array([shape.material.colour]) if shape.colours is None else shape.colours
        sharp = float(np.clip(2.0 / max(shape.material.roughness, 0.02) ** 2 - 2.0, *SHARPNESS))
        about = np.array([self.sky.horizon, self.sky.zenith, self.ground, (sharp, 0.0, 0.0)])
        out = np.empty((len(which), 6), np.float32)
        light(
            shape.vertices,
            shape.normals,
            np.ascontiguousarray(colours, np.float64),
            which,
            side,
            self.eye,
            _reflects(shape.material),
            about,
            self.lamps,
            out,
        )
        return out


def _reflects(material: Material) -> Floats:
    """(3,), as `light` takes it."""
    if not material.has_body:
        return np.array([0.0, 1.0, 0.0])
    return np.array([1.0, 0.0, COAT if material.has_coat else 0.0])
