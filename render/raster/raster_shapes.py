"""Inputs of a quick preview: shapes, the stage with its lights, and what a camera may see of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.post.view import ACES, ColourView
from render.raster.raster_projection import CLOCKWISE, project, sort_faces
from render.scene.materials import Diffuse, Material
from render.scene.render_camera import Camera
from render.scene.scene_lights import LightRig
from render.scene.scene_stage import Stage, StagePlacement

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
    """The lights, the stage and their placement, and the colour view.

    fades  True if the stage fades into the dark (`Stage.fading`)
    """

    lights: LightRig
    stage: Stage
    placement: StagePlacement
    view: ColourView = ACES
    fades: bool = False


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
def stage_shape(stage: Stage, placement: StagePlacement, fades: bool = False) -> Shape:
    """Return the whole stage in scene units. fades: as of `StageSetup`"""
    shape = Shape(*placement.placed(stage.mesh()), Diffuse(stage.colour)).for_kernels()
    if stage.kind != "plinth" and not fades:
        return shape
    colours = np.tile(stage.colour, (len(shape.vertices), 1))
    backdrop = len(stage.backdrop()[0])
    if fades:
        colours[:backdrop] *= stage.fading()[:, None]
    colours[backdrop:] = stage.plinth_colour
    return shape._replace(colours=colours)


@lru_cache(maxsize=4)
def plinth_shape(stage: Stage, placement: StagePlacement) -> Shape:
    """Return the plinth in scene units."""
    return Shape(*placement.placed(stage.plinth()), Diffuse(stage.plinth_colour)).for_kernels()


@dataclass(frozen=True, eq=False)
class VisibleFaces:
    """A shape in a picture.

    screen    (V, 3), screen coordinates, as the kernel `project` computes them
    orders    arrays of indices of the faces that may be visible
    corners   (V,), bits SMALL and LARGE: which triangles a vertex is a corner of
    outwards  1 where faces that run counter-clockwise on the screen are the outer side of a closed surface,
              -1 where they are the inner side, 0 where both sides may be visible
    """

    shape: Shape
    screen: NDArray[np.float32]
    orders: tuple[NDArray[np.int32], ...]
    corners: NDArray[np.uint8]
    outwards: int

    @classmethod
    def of(cls, shape: Shape, projection: ScreenProjection, size: tuple[int, int]) -> VisibleFaces:
        """Find the faces of a shape that may be visible. size: rows and columns of the picture"""
        screen = projection.project(shape.vertices, *size)
        order, corners = np.empty(len(shape.faces), np.int32), np.zeros(len(screen), np.uint8)
        front, back, volume, is_whole = sort_faces(screen, shape.faces, *size, order, corners)
        counter_clockwise, clockwise = order[:front], order[len(order) - back :]
        if not (shape.closed and is_whole):
            both = corners | corners >> np.uint8(CLOCKWISE)
            return cls(shape, screen, (counter_clockwise, clockwise), both, 0)
        if volume > 0.0:
            return cls(shape, screen, (counter_clockwise,), corners, 1)
        return cls(shape, screen, (clockwise,), corners >> np.uint8(CLOCKWISE), -1)

    def corners_of(self, kind: int) -> NDArray[np.intp]:
        """Return the vertices (N,) that are corners of SMALL or LARGE triangles."""
        return np.flatnonzero(self.corners & kind)
