"""Colour goes with the material: patterns, their rows of colours, and what of them reaches a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import from_plain, to_plain
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.noise import fractal_noise
from flowsculpt.render.scene.patterns import CELLS, PATTERNS, TEXELS, Pigment
from flowsculpt.render.scene.surface import Surface

Rendered = Callable[..., RenderedFrame]

SMOOTH = [pattern for pattern in PATTERNS if pattern not in CELLS]
RED, BLUE = (0.7, 0.05, 0.05), (0.05, 0.05, 0.7)


def at(pigment: Pigment, *points: tuple[float, float, float]) -> np.ndarray:
    """The colours of points: what the texture shows."""
    phases = pigment.phases(np.array(points))
    phases = phases % 1.0 if pigment.repeats else np.clip(phases, 0.0, 1.0)
    return pigment.ramp()[np.minimum((phases * TEXELS).astype(int), TEXELS - 1)]


def test_layers_follow_one_another_and_begin_again() -> None:
    layers = Pigment("layers", (RED, BLUE), scale=0.5)
    shown = at(layers, (0, 0.25, 0), (3, 0.75, 1), (0, 1.25, 0), (0, -0.25, 0))
    assert shown == pytest.approx(np.array([RED, BLUE, RED, BLUE]), abs=1e-6)


def test_a_border_is_half_of_either_colour_and_as_wide_as_its_softness() -> None:
    layers = Pigment("layers", (RED, BLUE), scale=1.0, softness=0.2)
    mixed, before, after = at(layers, (0, 1.0, 0), (0, 0.89, 0), (0, 1.11, 0))
    assert mixed == pytest.approx(np.mean([RED, BLUE], axis=0), abs=0.01)
    assert before == pytest.approx(RED, abs=1e-6) and after == pytest.approx(BLUE, abs=1e-6)


def test_the_last_ring_goes_on_outwards() -> None:
    rings = Pigment("rings", (RED, BLUE), scale=0.5, centre=(1, 0, 0))
    shown = at(rings, (1, 9, 0), (1.4, 0, 0), (1, 0, 0.6), (7, 0, 0))
    assert shown == pytest.approx(np.array([RED, RED, BLUE, BLUE]), abs=1e-6)


def test_a_gradient_has_its_ends_at_half_its_length() -> None:
    gradient = Pigment("gradient", (RED, BLUE), scale=2.0, axis=(1, 0, 0))
    shown = at(gradient, (-5, 0, 0), (0, 0, 0), (5, 0, 0))
    assert shown == pytest.approx(np.array([RED, np.mean([RED, BLUE], axis=0), BLUE]), abs=1e-3)


@pytest.mark.parametrize("pattern", ["marble", "speckles"])
def test_what_is_on_the_ground_takes_more_of_it_with_a_larger_share(pattern: str) -> None:
    points = np.random.default_rng(1).uniform(-4, 4, (20000, 3))
    covers = []
    for share in (0.1, 0.3, 0.6):
        pigment = Pigment(pattern, ((0, 0, 0), (1, 1, 1)), scale=0.7, share=share, turbulence=0.8)
        covers.append(at(pigment, *points).mean())
    assert 0.0 < covers[0] < covers[1] < covers[2] < 0.8


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from(SMOOTH), st.floats(0.05, 5))
def test_neighbours_have_neighbouring_phases(seed: int, pattern: str, scale: float) -> None:
    pigment = Pigment(pattern, (RED, BLUE), scale=scale, turbulence=0.7, octaves=3, seed=seed)
    points = np.random.default_rng(seed).uniform(-3, 3, (200, 3))
    steps = np.abs(pigment.phases(points + 1e-6 * scale) - pigment.phases(points))
    assert steps.max() < 1e-4


@pytest.mark.parametrize("pattern", CELLS)
def test_a_spot_or_chip_has_one_colour_of_the_palette_and_all_are_used(pattern: str) -> None:
    palette = ((0.9, 0.9, 0.9), RED, BLUE, (0.1, 0.6, 0.1))
    pigment = Pigment(
        pattern, palette, scale=0.5, softness=0.0, gap=0.1, sizes=2 if pattern == "chips" else 1
    )
    points = np.random.default_rng(3).uniform(-4, 4, (4000, 3))
    shown = at(pigment, *points)
    off = np.abs(shown[:, None] - np.array(palette)).max(axis=2)
    assert (off.min(axis=1) < 1e-6).mean() > 0.995  # the others lie on borders
    kinds = off.argmin(axis=1)
    assert set(kinds) == {0, 1, 2, 3}
    beside = off_palette(at(pigment, *(points + 1e-3)), palette)
    changed = kinds != beside
    assert changed.mean() < 0.06
    assert ((kinds == 0) | (beside == 0))[changed].mean() > 0.9 or pattern == "spots"  # ground is between


def off_palette(shown: np.ndarray, palette: tuple[tuple[float, float, float], ...]) -> np.ndarray:
    """The number of the colour that each is."""
    return np.abs(shown[:, None] - np.array(palette)).max(axis=2).argmin(axis=1)


def test_smaller_chips_lie_in_the_gaps_of_larger_ones_and_leave_these_as_they_are() -> None:
    points = np.random.default_rng(5).uniform(-3, 3, (20000, 3))
    covers, before = [], np.zeros(len(points), bool)
    for sizes in (1, 2, 3):
        pigment = Pigment("chips", ((0, 0, 0), (1, 1, 1)), scale=0.8, share=0.8, softness=0.0, sizes=sizes)
        here = at(pigment, *points)[:, 0] > 0.5
        assert (before & ~here).mean() < 1e-3
        covers.append(here.mean())
        before = here
    assert covers[0] < covers[1] - 0.05 < covers[2] - 0.06


def test_shells_begin_at_the_centre_and_begin_again() -> None:
    radial = Pigment("radial", (RED, BLUE), scale=0.5, centre=(0, 1, 0))
    shown = at(radial, (0, 1, 0), (0.2, 1, 0), (0, 1.7, 0), (0, 1, 1.2), (0, 1, -1.7))
    assert shown == pytest.approx(np.array([RED, RED, BLUE, RED, BLUE]), abs=1e-6)


@pytest.mark.parametrize("pattern", PATTERNS[:-1])  # a palette has no places at rest
def test_a_sample_of_a_picture_shows_the_pattern_at_its_place_at_rest(pattern: str, engine: Engine) -> None:
    import mitsuba as mi

    from flowsculpt.render.mitsuba.pattern_textures import PLACE, pattern_texture, with_places
    from flowsculpt.render.mitsuba.shapes import mesh

    pigment = Pigment(pattern, (RED, BLUE, (0.1, 0.6, 0.1)), scale=0.3, turbulence=0.6, octaves=3, seed=4)
    rest = np.float32([[0, 0, 0], [2, 0, 0], [0, 2, 0]])
    moved = np.float32([[0, 0, 5], [3, 0, 5], [0, 1, 5]])  # stretched, squashed and away
    normals = np.tile(np.float32([0, 0, -1]), (3, 1))
    surface = Surface(moved, normals, np.int32([[0, 2, 1]]), rest=rest)
    bsdf = {"type": "diffuse", "reflectance": pattern_texture(pigment)}
    shape = mesh("plate", with_places(surface, pigment), bsdf, np.zeros(2))
    away = mi.ScalarTransform4f().translate([0, 0, 9])
    scene = mi.load_dict({"type": "scene", "plate": shape, "other": {"type": "sphere", "to_world": away}})
    u, v = np.random.default_rng(1).uniform(0.02, 0.48, (2, 500))
    ray = mi.Ray3f(mi.Point3f(mi.Float(3 * u), mi.Float(v), 0.0), mi.Vector3f(0.0, 0.0, 1.0))
    si = scene.ray_intersect(ray)
    place = np.array(si.shape.eval_attribute_3(f"vertex_{PLACE}", si))
    assert place == pytest.approx(np.stack([2 * u, 2 * v, 0 * u]), abs=1e-5)
    shown = np.array(si.bsdf().eval_diffuse_reflectance(si)).T  # called where the ray hits, as for pictures
    off = np.abs(shown - at(pigment, *np.stack([2 * u, 2 * v, 0 * u], axis=1))).max(axis=1)
    assert np.quantile(off, 0.97) < 0.02  # the others lie on borders


def test_a_pattern_too_fine_for_its_surface_is_refused(engine: Engine) -> None:
    from flowsculpt.render.mitsuba.pattern_textures import with_places

    points = np.float32([[0, 0, 0], [2, 0, 0], [0, 2, 0]])
    surface = Surface(points, np.zeros_like(points), np.int32([[0, 1, 2]]), rest=points)
    with_places(surface, Pigment("gradient", (RED, BLUE), scale=3e-6))
    with pytest.raises(BadInputError, match=r"reaches 2e\+09 scales from its centre; .* Raise scale"):
        with_places(surface, Pigment("gradient", (RED, BLUE), scale=1e-9))


@pytest.mark.parametrize("stretch", [1.0, 2.0])
def test_relief_is_as_steep_as_its_height_over_the_present_surface(stretch: float, engine: Engine) -> None:
    import mitsuba as mi

    from flowsculpt.render.mitsuba.pattern_textures import relief_normals, with_places
    from flowsculpt.render.mitsuba.shapes import mesh

    slope = Pigment("gradient", (RED, BLUE), scale=2.0, axis=(1, 0, 0), heights=(0.0, 0.4))
    rest = np.float32([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]])
    normals = np.tile(np.float32([0, 0, 1]), (4, 1))
    surface = Surface(
        rest * np.float32([stretch, 1, 1]), normals, np.int32([[0, 1, 3], [0, 3, 2]]), rest=rest
    )
    shape = mesh("plate", with_places(surface, slope), {"type": "diffuse"}, np.zeros(2))
    scene = mi.load_dict({"type": "scene", "plate": shape})
    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(0.1, 0.2, 3.0), mi.Vector3f(0.0, 0.0, -1.0)))
    local = mi.Vector3f(2.0 * relief_normals(slope).eval_3(si) - 1.0)
    x, _, z = np.array(si.sh_frame.to_world(local)).ravel()
    assert -x / z == pytest.approx(0.2 / stretch, rel=1e-2)


def test_relief_and_roughness_reach_the_beauty_and_no_other_layer(
    rendered: Rendered, sphere: Surface
) -> None:
    marked = replace(sphere, rest=sphere.vertices)
    flat = Pigment("layers", (RED, RED), scale=0.2, softness=1.0)
    plain, carved, dull = (
        rendered(surface=marked, look=replace(LOOKS["glaze"], pigment=pigment))
        for pigment in (flat, replace(flat, heights=(0.0, 0.05)), replace(flat, roughness=(0.5, 0.5)))
    )
    for name in ("matte", "normal", "depth", "position"):
        assert np.array_equal(plain[name], carved[name])
    assert plain["albedo"] == pytest.approx(carved["albedo"], abs=1e-4)
    inside = plain["matte"] == 1.0
    for other in (carved, dull):
        assert np.abs(other["beauty"] - plain["beauty"])[inside].mean() > 0.01


def test_noise_is_the_same_for_the_same_seed_and_keeps_its_bounds() -> None:
    points = np.random.default_rng(2).uniform(-50, 50, (20000, 3))
    noise = fractal_noise(points, 4, 5)
    assert np.array_equal(noise, fractal_noise(points, 4, 5))
    assert np.array_equal(noise[:7], fractal_noise(points[:7], 4, 5))  # whatever the neighbours
    assert np.abs(noise).max() <= 1.0 and np.abs(noise.mean(axis=0)).max() < 0.02
    assert not np.allclose(noise, fractal_noise(points, 4, 6))


def test_a_pigment_that_makes_no_sense_is_refused() -> None:
    for wrong in (
        {"pattern": "tartan"},
        {"colours": (RED,)},
        {"colours": (RED, (0, 0, 2))},
        {"scale": 0.0},
        {"axis": (0, 0, 0)},
        {"softness": 1.5},
        {"octaves": 0},
        {"heights": (0.1,)},
        {"roughness": (0.1, 1.2)},
    ):
        with pytest.raises(BadInputError):
            Pigment(**{"pattern": "layers", "colours": (RED, BLUE), **wrong})
    with pytest.raises(BadInputError, match="one colour"):
        LOOKS["glass"].with_values(pigment=Pigment("layers", (RED, BLUE)))
    with pytest.raises(BadInputError, match="no highlights"):
        LOOKS["clay"].with_values(pigment=Pigment("layers", (RED, BLUE), roughness=(0.1, 0.2)))


def test_a_look_with_a_pigment_survives_being_written_down() -> None:
    look = replace(LOOKS["glaze"], pigment=Pigment("marble", (RED, BLUE), seed=9))
    assert from_plain(type(look), to_plain(look)) == look


@pytest.mark.parametrize("name", ["clay", "glaze", "chrome", "taffy"])
def test_halves_reach_beauty_and_albedo_and_stay_when_the_surface_moves(
    name: str, rendered: Rendered, sphere: Surface
) -> None:
    look = replace(LOOKS[name], pigment=Pigment("layers", (RED, BLUE), scale=9.0, centre=(0, 1, 0)))
    marked = replace(sphere, rest=sphere.vertices)
    layers = rendered(surface=marked, look=look)
    inside = layers["matte"] == 1.0
    up = layers["position"][..., 1] > 1.0
    away = np.abs(layers["position"][..., 1] - 1.0) > 0.15
    for half, part in ((up, 0), (~up, 2)):
        albedo = layers["albedo"][inside & half & away]
        assert albedo[:, part].mean() > 3.0 * albedo[:, 2 - part].mean()
        beauty = layers["beauty"][inside & half & away].mean(axis=0)
        assert name == "chrome" or beauty[part] > 1.3 * beauty[2 - part]
    over = replace(marked, vertices=sphere.vertices * np.float32([1, -1, 1]) + np.float32([0, 2, 0]))
    over = replace(over, normals=sphere.normals * np.float32([1, -1, 1]), faces=sphere.faces[:, ::-1])
    turned = rendered(surface=over, look=look)
    assert (
        turned["albedo"][inside & up & away][:, 2].mean() > turned["albedo"][inside & up & away][:, 0].mean()
    )


def test_a_pigment_changes_no_other_layer(
    rendered: Rendered, sphere: Surface, picture: RenderedFrame
) -> None:
    look = replace(LOOKS["clay"], pigment=Pigment("speckles", (RED, BLUE), scale=0.4))
    layers = rendered(surface=replace(sphere, rest=sphere.vertices), look=look)
    for name in ("matte", "normal", "depth", "position"):
        assert np.array_equal(layers[name], picture[name])


def test_a_surface_without_places_at_rest_is_told(rendered: Rendered) -> None:
    look = replace(LOOKS["clay"], pigment=Pigment("layers", (RED, BLUE)))
    with pytest.raises(BadInputError, match="has no rest positions"):
        rendered(look=look)


@pytest.mark.parametrize("name", ["glass", "honey", "smoke"])
def test_light_goes_through_and_the_denoiser_is_told_a_colour(name: str, rendered: Rendered) -> None:
    look = LOOKS[name]
    layers = rendered(look=look)
    inside = layers["matte"] == 1.0
    told = np.array(look.auxiliary_colour)
    assert layers["albedo"][inside] == pytest.approx(np.tile(told, (inside.sum(), 1)), abs=1e-3)
    assert layers["beauty"][inside].mean() > 0.05


def test_thinner_smoke_hides_less(rendered: Rendered) -> None:
    clear, thin, thick = (
        rendered(look=replace(LOOKS["smoke"], density=density))["beauty"][10:17, 21:28].mean()
        for density in (1e-4, 0.05, 1.0)
    )
    assert abs(thin - clear) < abs(thick - clear)
