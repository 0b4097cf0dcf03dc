"""Looks keep what light has: none reflects more than it gets, and what is absorbed follows the distance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import from_plain, to_plain
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS, Absorption, BrushedMetal, Diffuse, Glass
from flowsculpt.render.scene.patterns import Pigment
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_lights import LightRig, Sky
from flowsculpt.render.scene.scene_stage import STAGES
from flowsculpt.render.scene.surface import Surface

Rendered = Callable[..., RenderedFrame]

WHITE = (1.0, 1.0, 1.0)
FURNACE = {"lights": LightRig(sky=Sky(WHITE, WHITE, WHITE, visible=True)), "stage": STAGES["none"]}
"""The same light from everywhere: what reflects all of it cannot be told from the sky."""


def middle(layers: RenderedFrame) -> np.ndarray:
    """(3,) light of the picture's middle."""
    height, width = layers["matte"].shape
    part = layers["beauty"][height // 2 - 2 : height // 2 + 2, width // 2 - 2 : width // 2 + 2]
    return np.asarray(part.mean(axis=(0, 1)))


@pytest.fixture(scope="module")
def at_rest(sphere: Surface) -> Surface:
    slow = np.full((len(sphere.vertices), 1), 2.0, np.float32)
    return replace(sphere, rest=sphere.vertices - np.float32([0, 1, 0]), attributes={"speed": slow})


@pytest.mark.parametrize("name", [name for name, look in LOOKS.items() if look.model != "gouraud"])
def test_no_look_reflects_more_than_it_gets(name: str, rendered: Rendered, at_rest: Surface) -> None:
    layers = rendered(surface=at_rest, look=LOOKS[name], quality=Quality(32, 18, 16, depth=6), **FURNACE)
    inside = layers["matte"] >= 0.999
    light = layers["beauty"][inside]
    assert np.isfinite(light).all() and light.mean() > 0.02
    assert light.mean(axis=0).max() <= 1.01


def test_rough_glass_keeps_all_light(rendered: Rendered, sphere: Surface, engine: Engine) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("the plain variant leaves out light between microfacets")
    layers = rendered(look=Glass(WHITE, roughness=0.28), quality=Quality(32, 18, 64, depth=20), **FURNACE)
    assert layers["beauty"][layers["matte"] >= 0.999].mean() == pytest.approx(1.0, abs=0.02)


SLAB = Absorption((0.5, 0.25, 0.9), depth=0.5)


def block(half: float) -> Surface:
    """A wall across the view, of that half thickness."""
    corners = np.array([[x, y, z] for x in (-4, 4) for y in (-4, 4) for z in (-half, half)], dtype=np.float32)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    vertices = corners[np.array(quads)].reshape(-1, 3)
    sides = vertices.reshape(-1, 4, 3)
    across = np.cross(sides[:, 1] - sides[:, 0], sides[:, 3] - sides[:, 0])
    normals = np.repeat(across / np.linalg.norm(across, axis=1, keepdims=True), 4, axis=0)
    first = 4 * np.arange(6)[:, None]
    faces = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    return Surface(vertices, normals.astype(np.float32), faces.astype(np.int32))


@pytest.mark.parametrize("half", [0.125, 0.5])
@pytest.mark.parametrize("medium", [False, True], ids=["as computed", "by chance"])
def test_light_through_a_slab_is_what_beer_lambert_and_fresnel_say(
    half: float, medium: bool, rendered: Rendered, monkeypatch: pytest.MonkeyPatch, engine: Engine
) -> None:
    if not medium and engine.variant == "scalar_rgb":
        pytest.skip("the plain variant draws free paths")
    if medium:
        monkeypatch.setattr("flowsculpt.render.mitsuba.materials.is_compiled", lambda: False)
    look = Glass(WHITE, refraction=1.5, absorption=SLAB)
    camera = Camera((0.0, 0.0, 30.0), (0.0, 0.0, 0.0), field_of_view=np.radians(2.0))
    quality = Quality(16, 16, 64 if medium else 16, depth=10)
    layers = rendered(surface=block(half), look=look, camera=camera, quality=quality, **FURNACE)
    # The sky is 1 on both sides: reflected r, and through it once, thrice, …, and reflected within.
    left = np.array(SLAB.colour) ** (2.0 * half / SLAB.depth)
    r = ((1.5 - 1.0) / (1.5 + 1.0)) ** 2
    expected = r + (1.0 - r) ** 2 * left * (1.0 + r * left) / (1.0 - (r * left) ** 2)
    assert layers["beauty"].mean(axis=(0, 1)) == pytest.approx(expected, abs=0.03 if medium else 2e-3)


def test_absorption_is_of_the_subject_not_of_its_size(rendered: Rendered, sphere: Surface) -> None:
    from flowsculpt.render.scene.scene_stage import StagePlacement

    small = rendered(look=LOOKS["honey"], **FURNACE)
    vertices = (sphere.vertices * 5.0).astype(np.float32)
    camera = Camera((16.0, 14.5, 44.0), (0.0, 4.75, 0.0))
    large = rendered(
        surface=replace(sphere, vertices=vertices),
        look=LOOKS["honey"],
        camera=camera,
        placement=StagePlacement(size=5.0),
        **FURNACE,
    )
    assert large["beauty"].mean(axis=(0, 1)) == pytest.approx(small["beauty"].mean(axis=(0, 1)), abs=0.01)


def test_scratches_draw_a_highlight_out_across_them(rendered: Rendered, at_rest: Surface) -> None:
    """Lit by a small lamp, a ball scratched along its parallels shows a streak from pole to pole."""
    from flowsculpt.render.scene.scene_lights import Softbox

    lamp = LightRig((Softbox((0.0, 1.0, 20.0), 1.0, 1.0, (900.0, 900.0, 900.0)),))
    view = {"camera": Camera((0.0, 1.0, 9.0), (0.0, 1.0, 0.0)), "lights": lamp, "stage": STAGES["none"]}
    spreads = []
    for grain in ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0)):
        layers = rendered(surface=at_rest, look=replace(LOOKS["brushed"], grain=grain), **view)
        light = layers["beauty"].sum(axis=2)
        y, x = np.mgrid[: light.shape[0], : light.shape[1]]
        along, across = (
            np.sqrt(np.average((c - np.average(c, weights=light)) ** 2, weights=light)) for c in (y, x)
        )
        spreads.append(along / across)
    assert spreads[0] > 1.5 and spreads[1] < 1.0 / 1.5


def test_the_matte_does_not_show_what_stands_beside_it(rendered: Rendered, at_rest: Surface) -> None:
    shown = rendered(surface=at_rest, look=LOOKS["brushed"])
    plain = rendered(surface=at_rest, look=LOOKS["clay"])
    assert shown["matte"] == pytest.approx(plain["matte"], abs=1.5e-3)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (lambda: Absorption((0.0, 1.0, 1.0)), "above 0"),
        (lambda: Absorption(WHITE, depth=0.0), "depth 0.0"),
        (lambda: Diffuse(WHITE).with_values(absorption=SLAB), "does not heed absorption"),
        (lambda: BrushedMetal(WHITE).with_values(pigment=Pigment("layers", (WHITE, WHITE))), "one colour"),
        (lambda: BrushedMetal(WHITE, grain=(0.0, 0.0, 0.0)), "an axis must not be zero"),
    ],
)
def test_what_no_look_can_be_is_told(wrong: Callable[[], object], told: str) -> None:
    with pytest.raises(BadInputError, match=told):
        wrong()


@pytest.mark.parametrize("name", LOOKS)
def test_a_look_comes_back_from_a_picture_header(name: str) -> None:
    assert from_plain(type(LOOKS[name]), to_plain(LOOKS[name])) == LOOKS[name]


def test_brushed_metal_needs_to_know_where_points_were(rendered: Rendered, sphere: Surface) -> None:
    with pytest.raises(BadInputError, match="has no rest positions"):
        rendered(surface=replace(sphere, rest=None), look=LOOKS["brushed"])
