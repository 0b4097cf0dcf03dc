"""Paint on a surface: each material of a model on its own faces, in pictures and at vertices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from render.base.render_errors import BadInputError
from render.scene.aovs import RenderedFrame
from render.scene.materials import Diffuse, Painted, Satin
from render.scene.painted_faces import VERTEX_COLOURS, PaintedFaces
from render.scene.render_camera import Camera
from render.scene.render_quality import Quality
from render.scene.surface import Surface
from render.scene.texture_projection import MODEL, TextureProjection
from render.scene.vertex_colours import vertex_colours
from tests.render.test_textures import BLUE, GREEN, RED, WHITE, quarters

Rendered = Callable[..., RenderedFrame]

FRONT = Camera((0.0, 1.0, 9.0), (0.0, 1.0, 0.0))
PLACED = TextureProjection(MODEL)


def square(materials: tuple[int, int], coloured: bool = False) -> Surface:
    """A square before the camera, of a lower right and an upper left face with materials of their own."""
    vertices = np.float32([[-1, 0, 0], [1, 0, 0], [1, 2, 0], [-1, 2, 0]])
    faces = np.int32([[0, 1, 2], [0, 2, 3]])
    coordinates = 0.5 * (vertices[faces][..., :2] + (1, 0)).astype(np.float64)
    colours = np.broadcast_to(np.float32(GREEN), (2, 3, 3)).copy() if coloured else None
    paint = PaintedFaces(coordinates, np.array(materials), np.array(materials), colours)
    return Surface(vertices, np.float32([[0, 0, 1]] * 4), faces, rest=vertices, paint=paint)


def albedo_at(layers: RenderedFrame, x: float, y: float) -> np.ndarray:
    """The albedo at a point of the square, in the plane of the picture."""
    height, width = layers["albedo"].shape[:2]
    scale = 0.5 * width / (9.0 * np.tan(FRONT.field_of_view / 2.0))
    row, column = round(height / 2 - scale * (y - 1.0)), round(width / 2 + scale * x)
    return np.asarray(layers["albedo"][row, column])


def test_a_texture_lies_by_the_coordinates_of_the_model(tmp_path: Path, rendered: Rendered) -> None:
    look = Painted(
        WHITE, parts=(Diffuse(WHITE, colour_texture=quarters(tmp_path / "a.exr"), projection=PLACED),)
    )
    layers = rendered(surface=square((0, 0)), look=look, camera=FRONT, quality=Quality(96, 54, 4, depth=2))
    for x, y, colour in ((-0.5, 1.5, RED), (0.5, 1.5, GREEN), (-0.5, 0.5, BLUE), (0.5, 0.5, WHITE)):
        assert albedo_at(layers, x, y) == pytest.approx(colour, abs=0.02)


def test_each_material_is_on_its_own_faces(tmp_path: Path, rendered: Rendered) -> None:
    textured = Diffuse(WHITE, colour_texture=quarters(tmp_path / "a.exr"), projection=PLACED)
    dyed = Satin(WHITE, roughness=0.5, coat=0.0, colour_from=VERTEX_COLOURS)
    look = Painted(WHITE, parts=(textured, Diffuse(BLUE), dyed))
    surface = square((2, 0), coloured=True)
    layers = rendered(surface=surface, look=look, camera=FRONT, quality=Quality(96, 54, 4, depth=2))
    assert albedo_at(layers, -0.5, 1.5) == pytest.approx(RED, abs=0.02)
    assert albedo_at(layers, 0.5, 0.5) == pytest.approx(GREEN, abs=0.02)
    colours = vertex_colours(surface, look)
    assert colours is not None
    assert colours[1] == pytest.approx(GREEN) and colours[3] == pytest.approx(RED, abs=0.01)


def test_a_surface_without_paint_is_refused_by_name(tmp_path: Path, rendered: Rendered) -> None:
    look = Diffuse(WHITE, colour_texture=quarters(tmp_path / "a.exr"), projection=PLACED)
    with pytest.raises(BadInputError, match="add paint: on"):
        rendered(surface=replace(square((0, 0)), paint=None), look=look)


def test_a_chart_begins_in_the_first_of_repeated_textures() -> None:
    paint = square((0, 1)).paint
    assert paint is not None
    far = replace(paint, coordinates=paint.coordinates + np.float64([[[7, -3]], [[0, 12]]]))
    assert far.near_origin() == pytest.approx(paint.coordinates)
