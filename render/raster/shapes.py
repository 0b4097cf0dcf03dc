"""The inputs of a quick preview: shapes, the stage with its lights, and the projection of a camera."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.post.view import ACES, ColourView
from render.raster.kernels.projection import project
from render.scene.camera import Camera
from render.scene.lights import LightRig
from render.scene.materials import Diffuse, Material
from render.scene.stage import Mesh, Stage, StagePlacement

Floats = NDArray[np.float64]


class Shape(NamedTuple):
    """A surface: vertices (V, 3), normals (V, 3), faces (F, 3) and its material.

    colours (V, 3) replace the material's colour (see `render.scene.vertex_colours`). Of a closed surface only
    faces towards the camera are drawn, which is faster.
    """

    vertices: NDArray[np.floating]
    normals: NDArray[np.floating]
    faces: NDArray[np.int32]
    material: Material
    colours: Floats | None = None
    closed: bool = False

    def for_kernels(self) -> Shape:
        """Return the shape in single precision and C order."""
        vertices, normals = (np.ascontiguousarray(a, np.float32) for a in (self.vertices, self.normals))
        faces = np.ascontiguousarray(self.faces, np.int32)
        return self._replace(vertices=vertices, normals=normals, faces=faces)


@dataclass(frozen=True)
class StageSetup:
    """The lights, the stage and their placement, and the colour view."""

    lights: LightRig
    stage: Stage
    placement: StagePlacement
    view: ColourView = ACES


class ScreenProjection(NamedTuple):
    """A camera for kernels: its position, its axes over half of the view at depth 1, and its near
    distance.
    """

    origin: Floats
    axes: Floats
    near: float

    @classmethod
    def of(cls, camera: Camera, aspect: float) -> ScreenProjection:
        """Return the projection of a camera. aspect: width over height"""
        half = math.tan(camera.field_of_view / 2.0)
        return cls(np.array(camera.origin), camera.axes() / [[half], [half / aspect], [1.0]], camera.near)

    def project(self, vertices: NDArray[np.float32], rows: int, columns: int) -> NDArray[np.float32]:
        """Return screen coordinates (V, 3), as the kernel `project`."""
        screen = np.empty((len(vertices), 3), np.float32)
        project(vertices, *self, rows, columns, screen)
        return screen


@lru_cache(maxsize=4)
def stage_shape(stage: Stage, placement: StagePlacement) -> Shape:
    """Return the whole stage in scene units."""
    return _placed(stage.mesh(), stage, placement)


@lru_cache(maxsize=4)
def plinth_shape(stage: Stage, placement: StagePlacement) -> Shape:
    """Return the plinth in scene units."""
    return _placed(stage.plinth(), stage, placement)


def _placed(mesh: Mesh, stage: Stage, placement: StagePlacement) -> Shape:
    vertices, normals, faces = mesh
    matrix = placement.matrix()
    turned = normals @ matrix[:3, :3].T / placement.size
    placed = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return Shape(placed, turned, faces, Diffuse(stage.colour)).for_kernels()
