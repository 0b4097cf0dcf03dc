"""What a quick preview is made from: a surface, what stands around it, and the lens that sees them."""

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
from render.scene.stage import Mesh, Placement, Stage

Floats = NDArray[np.float64]


class Shape(NamedTuple):
    """A surface: vertices (V, 3), normals (V, 3), faces (F, 3), and what it is made of.

    colours (V, 3) take the place of the material's, where it has more than one (see
    `render.scene.vertex_colours`). Of a closed surface only faces that look outwards are seen, which is
    quicker.
    """

    vertices: NDArray[np.floating]
    normals: NDArray[np.floating]
    faces: NDArray[np.int32]
    material: Material
    colours: Floats | None = None
    closed: bool = False

    def as_kernels_take_it(self) -> Shape:
        """The same in single precision, row after row."""
        vertices, normals = (np.ascontiguousarray(a, np.float32) for a in (self.vertices, self.normals))
        faces = np.ascontiguousarray(self.faces, np.int32)
        return self._replace(vertices=vertices, normals=normals, faces=faces)


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

    def project(self, vertices: NDArray[np.float32], rows: int, columns: int) -> NDArray[np.float32]:
        """(V, 3), as the kernel `project` says."""
        screen = np.empty((len(vertices), 3), np.float32)
        project(vertices, *self, rows, columns, screen)
        return screen


class Preview(NamedTuple):
    """picture: display values (H, W, 3), 0 … 1; nearness (H, W): one over the depth, 0 where nothing is."""

    picture: NDArray[np.float32]
    nearness: NDArray[np.float32]

    @property
    def depth(self) -> Floats:
        """(H, W) along the lens, next to the middle of pixels; infinite where nothing is."""
        with np.errstate(divide="ignore"):
            return 1.0 / self.nearness.astype(np.float64)


@lru_cache(maxsize=4)
def stage_shape(stage: Stage, placement: Placement) -> Shape:
    """The stage where it stands."""
    return _placed(stage.mesh(), stage, placement)


@lru_cache(maxsize=4)
def plinth_shape(stage: Stage, placement: Placement) -> Shape:
    """What the subject stands on, alone."""
    return _placed(stage.plinth(), stage, placement)


def _placed(mesh: Mesh, stage: Stage, placement: Placement) -> Shape:
    vertices, normals, faces = mesh
    matrix = placement.matrix()
    turned = normals @ matrix[:3, :3].T / placement.size
    placed = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return Shape(placed, turned, faces, Diffuse(stage.colour)).as_kernels_take_it()
