"""Pictures from files: how they are read and lie on the sculpture, and what of them reaches a picture."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import from_plain, to_plain
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS, Relief
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.rgb_spaces import linear_of_srgb
from flowsculpt.render.scene.surface import Surface
from flowsculpt.render.scene.texture_projection import MODEL, PROJECTIONS, TextureProjection, project_texture
from flowsculpt.render.scene.textures import Texture

Rendered = Callable[..., RenderedFrame]

RED, GREEN, BLUE, WHITE = (0.7, 0.05, 0.05), (0.05, 0.7, 0.05), (0.05, 0.05, 0.7), (0.7, 0.7, 0.7)
FRONT = Camera((0.0, 1.0, 9.0), (0.0, 1.0, 0.0))


def write(path: Path, pixels: np.ndarray, kind: str = "float") -> Texture:
    """A picture; its content stands for its digest."""
    pixels = np.asarray(pixels, np.float32)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind))
    out.write_image(pixels)
    out.close()
    return Texture(hashlib.sha256(path.read_bytes()).hexdigest(), None, str(path))


def quarters(path: Path) -> Texture:
    """Red and green above, blue and white below."""
    pixels = np.zeros((64, 64, 3))
    pixels[:32, :32], pixels[:32, 32:], pixels[32:, :32], pixels[32:, 32:] = RED, GREEN, BLUE, WHITE
    return write(path, pixels)


def looked(sphere: Surface) -> Surface:
    return replace(sphere, rest=sphere.vertices)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind", "space", "of_half"),
    [
        ("a.exr", "half", None, 0.5),
        ("a.png", "uint8", None, linear_of_srgb(np.array(0.5))),
        ("a.png", "uint16", "linear", 0.5),
        ("a.tif", "uint16", None, linear_of_srgb(np.array(0.5))),
        ("a.tif", "float", None, 0.5),
        ("a.jpg", "uint8", "data", 0.5),
        ("a.exr", "float", "srgb_texture", linear_of_srgb(np.array(0.5))),
        ("a.exr", "float", "ACEScg", 0.5),
    ],
)
def test_pixels_become_linear_by_what_the_file_is_or_says(
    name: str, kind: str, space: str | None, of_half: float, tmp_path: Path
) -> None:
    texture = replace(write(tmp_path / name, np.full((8, 8, 3), 0.5), kind), space=space)
    assert texture.pixels() == pytest.approx(np.full((8, 8, 3), of_half), abs=0.004)


def test_reflectances_are_cut_and_numbers_are_not(tmp_path: Path) -> None:
    texture = write(tmp_path / "a.exr", np.full((2, 2, 3), 3.0))
    assert texture.pixels().max() == 1.0 and texture.numbers() == pytest.approx(np.full((2, 2, 1), 3.0))


def test_one_channel_is_grey_and_alpha_is_left_out(tmp_path: Path) -> None:
    assert write(tmp_path / "a.exr", np.full((2, 2, 1), 0.25)).pixels() == pytest.approx(
        np.full((2, 2, 3), 0.25)
    )
    clear = np.concatenate([np.full((2, 2, 3), 1.0), np.full((2, 2, 1), 0.25)], axis=2)
    assert write(tmp_path / "b.png", clear, "uint8").pixels() == pytest.approx(np.ones((2, 2, 3)))


def test_what_is_no_picture_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("none")
    with pytest.raises(BadInputError, match=r"a.png: it cannot be read as a picture"):
        Texture("1", None, str(tmp_path / "a.png")).pixels()
    with pytest.raises(BadInputError, match="not finite"):
        write(tmp_path / "b.exr", np.full((2, 2, 3), math.nan)).pixels()
    with pytest.raises(BadInputError, match="Did you mean"):
        replace(write(tmp_path / "c.exr", np.ones((2, 2, 3))), space="sRBG").pixels()


@pytest.mark.parametrize("kind", [kind for kind in PROJECTIONS if kind != MODEL])
def test_corners_of_a_triangle_lie_close_together_in_the_picture(kind: str, sphere: Surface) -> None:
    split, places = project_texture(
        looked(sphere), sphere.vertices, TextureProjection(kind, centre=(0.0, 1.0, 0.0))
    )
    assert np.abs(split.vertices[split.faces] - sphere.vertices[sphere.faces]).max() == 0.0
    across = places[split.faces]
    assert np.ptp(across, axis=1).max() < 0.2
    assert len(split.vertices) - len(sphere.vertices) < (6 if kind == "planar" else 300)


def test_a_picture_around_an_axis_has_its_middle_in_front_and_goes_to_the_right() -> None:
    points = np.float64([[0, 0.5, 2], [2, 0, 0.1], [0.1, 0, 2]])
    places, _ = TextureProjection("cylindrical", scale=2.0).coordinates(points, np.int32([[0, 1, 2]]))
    assert places[0, 0] == pytest.approx((0.0, 0.25)) and 0.2 < places[0, 1, 0] < 0.25
    turned, _ = TextureProjection("cylindrical", turn=math.pi / 2.0, scale=2.0).coordinates(
        points, np.int32([[0, 1, 2]])
    )
    assert turned[0, 0, 0] == pytest.approx(-0.25)


def test_a_slide_lies_upright_and_moves_with_the_material(
    rendered: Rendered, sphere: Surface, tmp_path: Path
) -> None:
    slide = TextureProjection("planar", centre=(0.0, 1.0, 0.0), scale=4.0)
    look = replace(LOOKS["clay"], colour_texture=quarters(tmp_path / "a.exr"), projection=slide)
    layers = rendered(surface=looked(sphere), look=look, camera=FRONT)
    x, y, inside = layers["position"][..., 0], layers["position"][..., 1] - 1.0, layers["matte"] == 1.0
    for right, up, colour in ((-1, 1, RED), (1, 1, GREEN), (-1, -1, BLUE), (1, -1, WHITE)):
        albedo = layers["albedo"][inside & (right * x > 0.2) & (up * y > 0.2)]
        assert len(albedo) > 5 and albedo.mean(axis=0) == pytest.approx(colour, abs=0.02)
    moved = replace(looked(sphere), vertices=sphere.vertices + np.float32([0.3, 0, 0]))
    again = rendered(surface=moved, look=look, camera=FRONT)
    x = again["position"][..., 0] - 0.3
    albedo = again["albedo"][(again["matte"] == 1.0) & (x < -0.2) & (again["position"][..., 1] > 1.2)]
    assert albedo.mean(axis=0) == pytest.approx(RED, abs=0.02)
    shown = look.vertex_colours(looked(sphere))
    assert shown is not None
    white = shown[(sphere.vertices[:, 0] > 0.2) & (sphere.vertices[:, 1] < 0.8)]
    assert np.abs(white - WHITE).max() < 1e-6


def test_the_matte_is_as_it_was(
    rendered: Rendered, sphere: Surface, picture: RenderedFrame, tmp_path: Path
) -> None:
    look = replace(LOOKS["clay"], colour_texture=quarters(tmp_path / "a.exr"))
    found = rendered(surface=looked(sphere), look=look)["matte"]
    assert np.abs(found - picture["matte"]).max() < 0.004
    assert (found[picture["matte"] == 1.0] == 1.0).all()


@pytest.mark.parametrize("name", ["glaze", "chrome"])
def test_where_the_picture_is_light_the_coat_is_rough(
    name: str, rendered: Rendered, sphere: Surface, tmp_path: Path
) -> None:
    look = replace(LOOKS[name], colour=WHITE)
    shown = {}
    for rough in (0.05, 0.7):
        pixels = write(tmp_path / f"{rough}.exr", np.full((2, 2, 1), rough))
        shown[rough] = rendered(surface=looked(sphere), look=replace(look, roughness_texture=pixels))[
            "beauty"
        ]
    inside = rendered()["matte"] == 1.0
    assert shown[0.05][inside].max() > 1.5 * shown[0.7][inside].max()


def test_relief_is_as_strong_up_as_across(rendered: Rendered, sphere: Surface, tmp_path: Path) -> None:
    """Waves of one length and height tilt the light of a surface alike, whichever way they run."""
    wave = 0.5 + 0.5 * np.sin(np.linspace(0, 4 * math.pi, 64, endpoint=False))
    square = Surface(
        np.float32([[-1, 0, 0], [1, 0, 0], [1, 2, 0], [-1, 2, 0]]),
        np.float32([[0, 0, 1]] * 4),
        np.int32([[0, 1, 2], [0, 2, 3]]),
        rest=np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]),
    )
    plain = replace(LOOKS["clay"], projection=TextureProjection("planar"))
    flat = rendered(surface=square, look=plain, camera=FRONT)
    change = []
    for name, pixels in (("u.exr", np.tile(wave, (64, 1))), ("v.exr", np.tile(wave[:, None], (1, 64)))):
        relief = Relief(write(tmp_path / name, pixels[..., None]), 0.12)
        layers = rendered(surface=square, look=replace(plain, relief=relief), camera=FRONT)
        assert np.array_equal(layers["depth"], flat["depth"])
        inside = flat["matte"] == 1.0
        change.append(float(np.abs(layers["beauty"] / flat["beauty"] - 1.0)[inside].mean()))
    assert min(change) > 0.05 and max(change) < 4.0 * min(change)


def test_a_look_with_pictures_survives_but_for_where_they_lie(tmp_path: Path) -> None:
    texture = quarters(tmp_path / "a.exr")
    look = replace(
        LOOKS["glaze"],
        colour_texture=texture,
        roughness_texture=texture,
        relief=Relief(texture),
        projection=TextureProjection(),
    )
    bare = replace(texture, path="")
    assert from_plain(type(look), to_plain(look)) == replace(
        look, colour_texture=bare, roughness_texture=bare, relief=Relief(bare)
    )


@pytest.mark.parametrize(
    "part",
    [{"colour_texture": Texture("1")}, {"roughness_texture": Texture("1")}, {"relief": Relief(Texture("1"))}],
)
def test_pictures_that_a_material_cannot_have_are_told(part: dict[str, object]) -> None:
    with pytest.raises(BadInputError):
        LOOKS["glass"].with_values(**part)
