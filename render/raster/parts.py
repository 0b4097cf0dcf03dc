"""What a quick preview is made from: a surface, what stands around it, and the lens that sees them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.camera import Camera
from render.lights import LightRig
from render.look import Look
from render.raster._kernels_fill import project
from render.stage import Mesh, Placement, Stage
from render.view import ACES, ColourView

Floats = NDArray[np.float64]


class Shape(NamedTuple):
    """A surface: vertices (V, 3), normals (V, 3), faces (F, 3), and what it is made of.

    colours (V, 3) take the place of the look's, where it has more than one (see `render.dyes`). Of a closed
    surface only faces that look at the lens are seen, which is quicker.
    """

    vertices: NDArray[np.floating]
    normals: NDArray[np.floating]
    faces: NDArray[np.int32]
    look: Look
    colours: Floats | None = None
    closed: bool = False


@dataclass(frozen=True)
class Set:
    """What stands around the subject: the lights, the stage, and where both are; and how it is shown."""

    lights: LightRig
    stage: Stage
    placement: Placement
    view: ColourView = ACES


class Lens(NamedTuple):
    """A camera as kernels take it: where it is, and its axes over half of what it sees at a depth of 1."""

    origin: Floats
    axes: Floats
    near: float

    @classmethod
    def of(cls, camera: Camera, aspect: float) -> Lens:
        half = math.tan(camera.field_of_view / 2.0)
        return cls(np.array(camera.origin), camera.axes() / [[half], [half / aspect], [1.0]], camera.near)

    def project(self, vertices: NDArray[np.floating]) -> tuple[Floats, Floats]:
        """(V, 3) and (V, 3), as the kernel `project` says."""
        corners, screen = np.empty((len(vertices), 3)), np.empty((len(vertices), 3))
        project(vertices, *self, corners, screen)
        return corners, screen


def stage_shape(around: Set) -> Shape:
    """The stage where it stands."""
    vertices, normals, faces = _stage_mesh(around.stage)
    matrix = around.placement.matrix()
    turned = normals @ matrix[:3, :3].T / around.placement.size
    placed = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return Shape(placed, turned, faces, Look("diffuse", around.stage.colour))


@lru_cache(maxsize=4)
def _stage_mesh(stage: Stage) -> Mesh:
    return stage.mesh()
