"""Paint on a surface: each material of a model on its own faces, in pictures and at vertices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.mitsuba.texture_coordinates import MIRRORED, TEXTURE_TANGENT, texture_coordinates
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import Diffuse, Painted, Satin
from flowsculpt.render.scene.painted_faces import PaintedFaces
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_lights import LightRig, Softbox
from flowsculpt.render.scene.scene_stage import STAGES
from flowsculpt.render.scene.surface import Surface
from flowsculpt.render.scene.texture_projection import MODEL, TextureProjection
from flowsculpt.render.scene.textures import Texture
from tests.render.test_textures import BLUE, GREEN, RED, WHITE, quarters, write

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
    return pixel_at(layers, "albedo", x, y)


def pixel_at(layers: RenderedFrame, name: str, x: float, y: float) -> np.ndarray:
    """A layer's value at a point of the square, in the plane of the picture."""
    height, width = layers["albedo"].shape[:2]
    scale = 0.5 * width / (9.0 * np.tan(FRONT.field_of_view / 2.0))
    row, column = round(height / 2 - scale * (y - 1.0)), round(width / 2 + scale * x)
    return np.asarray(layers[name][row, column])


def test_a_texture_lies_by_the_coordinates_of_the_model(tmp_path: Path, rendered: Rendered) -> None:
    look = Painted(
        WHITE, parts=(Diffuse(WHITE, colour_texture=quarters(tmp_path / "a.exr"), projection=PLACED),)
    )
    layers = rendered(surface=square((0, 0)), look=look, camera=FRONT, quality=Quality(96, 54, 4, depth=2))
    for x, y, colour in ((-0.5, 1.5, RED), (0.5, 1.5, GREEN), (-0.5, 0.5, BLUE), (0.5, 0.5, WHITE)):
        assert albedo_at(layers, x, y) == pytest.approx(colour, abs=0.02)


def test_each_material_is_on_its_own_faces(tmp_path: Path, rendered: Rendered) -> None:
    textured = Diffuse(WHITE, colour_texture=quarters(tmp_path / "a.exr"), projection=PLACED)
    dyed = Satin(WHITE, roughness=0.5, coat=0.0, colour_from=PaintedFaces.COLOURS)
    look = Painted(WHITE, parts=(textured, Diffuse(BLUE), dyed))
    surface = square((2, 0), coloured=True)
    layers = rendered(surface=surface, look=look, camera=FRONT, quality=Quality(96, 54, 4, depth=2))
    assert albedo_at(layers, -0.5, 1.5) == pytest.approx(RED, abs=0.02)
    assert albedo_at(layers, 0.5, 0.5) == pytest.approx(GREEN, abs=0.02)
    colours = look.vertex_colours(surface)
    assert colours is not None
    assert colours[1] == pytest.approx(GREEN) and colours[3] == pytest.approx(RED, abs=0.01)


LIT_FROM = {"right": (9.0, 0.0), "above": (0.0, 9.0), "left": (-9.0, 0.0), "below": (0.0, -9.0)}
OPPOSITE = {"right": "left", "above": "below", "left": "right", "below": "above"}


def lit(rendered: Rendered, surface: Surface, look: Painted, side: str) -> list[float]:
    """The light of the lower right face and of the upper left one, lit from a side."""
    x, y = LIT_FROM[side]
    layers = rendered(
        surface=surface,
        look=look,
        lights=LightRig((Softbox((x, 1.0 + y, 9.0), 1.0, 1.0, (50.0, 50.0, 50.0)),)),
        stage=STAGES["none"],
        camera=FRONT,
        quality=Quality(96, 54, 4, depth=2),
    )
    return [float(pixel_at(layers, "beauty", *place).mean()) for place in ((0.5, 0.5), (-0.5, 1.5))]


def leaning(path: Path, right: float, up: float) -> Texture:
    """A normal map that leans everywhere by 45 degrees."""
    return write(path, np.full((2, 2, 3), (0.5 + 0.5 * right, 0.5 + 0.5 * up, 1.0)))


@pytest.mark.parametrize("is_turned", [False, True], ids=["upright", "turned"])
@pytest.mark.parametrize("is_mirrored", [False, True], ids=["plain", "mirrored"])
@pytest.mark.parametrize("is_nested", [False, True], ids=["as computed", "nested"])
def test_a_normal_map_leans_to_where_its_texture_goes_right_and_up(
    is_turned: bool,
    is_mirrored: bool,
    is_nested: bool,
    tmp_path: Path,
    rendered: Rendered,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if is_nested:
        monkeypatch.setattr("flowsculpt.render.mitsuba.materials.is_compiled", lambda: False)
    maps = leaning(tmp_path / "right.exr", 1.0, 0.0), leaning(tmp_path / "up.exr", 0.0, 1.0)
    look = Painted(WHITE, parts=tuple(Diffuse(WHITE, normal_texture=m, projection=PLACED) for m in maps))
    surface = square((0, 1))
    assert surface.paint is not None
    coordinates = surface.paint.coordinates
    if is_turned:  # the texture goes right where the square goes up
        coordinates = coordinates @ np.array([[0.0, -1.0], [1.0, 0.0]])
    if is_mirrored:
        coordinates = coordinates * (-1, 1)
    surface = replace(surface, paint=replace(surface.paint, coordinates=coordinates))
    light = {side: lit(rendered, surface, look, side) for side in LIT_FROM}
    for face in (0, 1):
        towards = list(LIT_FROM)[face + is_turned]
        if is_mirrored and face == 0:
            towards = OPPOSITE[towards]
        brightest = max(light, key=lambda side: light[side][face])
        assert brightest == towards, light
        assert light[OPPOSITE[towards]][face] < 0.1 * light[towards][face]


def test_tangents_follow_the_deformed_surface_and_part_where_the_texture_is_mirrored() -> None:
    surface = square((0, 0))
    assert surface.paint is not None
    turned = surface.vertices @ np.float32([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # by a right angle
    coordinates = surface.paint.coordinates
    for mirrored in (False, True):
        if mirrored:  # across the edge that both faces have
            coordinates = np.stack([coordinates[0], coordinates[1][:, ::-1]])
        around = replace(surface, vertices=turned, paint=replace(surface.paint, coordinates=coordinates))
        look = Painted(WHITE, parts=(Diffuse(WHITE, normal_texture=Texture("0"), projection=PLACED),))
        split, placed = texture_coordinates(around, look)
        assert len(split.vertices) == len(placed.values) == (6 if mirrored else 4)
        tangents, is_mirrored = (split.attributes[name][split.faces] for name in (TEXTURE_TANGENT, MIRRORED))
        assert tangents[0] == pytest.approx(np.tile([0.0, 1.0, 0.0], (3, 1)), abs=1e-6)
        right = [-1.0, 0.0, 0.0] if mirrored else [0.0, 1.0, 0.0]
        assert tangents[1] == pytest.approx(np.tile(right, (3, 1)), abs=1e-6)
        assert (is_mirrored[0] == 0.0).all() and (is_mirrored[1] == mirrored).all()


def test_a_normal_map_has_no_normals_inwards(tmp_path: Path) -> None:
    normals = write(tmp_path / "a.exr", np.zeros((2, 2, 3))).normals()
    assert normals.dtype == np.float32 and normals[0, 0] == pytest.approx((-1.0, -1.0, 1e-3))


@pytest.mark.parametrize("is_nested", [False, True], ids=["as computed", "nested"])
@pytest.mark.parametrize("mapped", [0, 1])
def test_a_normal_map_changes_its_own_material_alone(
    mapped: int, is_nested: bool, tmp_path: Path, rendered: Rendered, monkeypatch: pytest.MonkeyPatch
) -> None:
    if is_nested:
        monkeypatch.setattr("flowsculpt.render.mitsuba.materials.is_compiled", lambda: False)
    plain = Diffuse(WHITE, projection=PLACED)
    parts = [plain, plain]
    parts[mapped] = replace(plain, normal_texture=leaning(tmp_path / "right.exr", 1.0, 0.0))
    before, after = (
        lit(rendered, square((0, 1)), Painted(WHITE, parts=tuple(each)), "right")
        for each in ((plain, plain), parts)
    )
    assert after[1 - mapped] == pytest.approx(before[1 - mapped], rel=0.02)
    x, y = ((0.5, 0.5), (-0.5, 1.5))[mapped]
    right, up, out = 9.0 - x, 1.0 - y, 9.0
    shadowed = 2.0 / (1.0 + (1.0 + 0.125 * (right**2 + up**2) / out**2) ** 0.5)  # Conty Estevez et al., 2019
    ratio = shadowed * (right + out) / (2.0**0.5 * out)
    assert after[mapped] == pytest.approx(ratio * before[mapped], rel=0.02)


def test_the_back_of_a_normal_map_is_its_front_turned_round(tmp_path: Path, rendered: Rendered) -> None:
    part = Diffuse(WHITE, normal_texture=leaning(tmp_path / "right.exr", 1.0, 0.0), projection=PLACED)
    surface = square((0, 0))
    seen_behind = replace(surface, normals=-surface.normals, faces=surface.faces[:, ::-1].copy())
    assert surface.paint is not None
    paint = replace(surface.paint, coordinates=surface.paint.coordinates[:, ::-1].copy())
    behind = replace(seen_behind, paint=paint)
    look = Painted(WHITE, parts=(part,))
    right, left = (lit(rendered, behind, look, side)[0] for side in ("right", "left"))
    assert right < 0.1 * left


def test_a_surface_without_paint_is_refused_by_name(tmp_path: Path, rendered: Rendered) -> None:
    look = Diffuse(WHITE, colour_texture=quarters(tmp_path / "a.exr"), projection=PLACED)
    with pytest.raises(BadInputError, match="a solid, or a model with paint: on"):
        rendered(surface=replace(square((0, 0)), paint=None), look=look)


def test_a_chart_begins_in_the_first_of_repeated_textures() -> None:
    paint = square((0, 1)).paint
    assert paint is not None
    far = replace(paint, coordinates=paint.coordinates + np.float64([[[7, -3]], [[0, 12]]]))
    assert far.near_origin() == pytest.approx(paint.coordinates)
