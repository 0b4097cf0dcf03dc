"""Colour goes with the material: patterns, their rows of colours, and what of them reaches a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from render.base.render_errors import BadInputError
from render.base.serialise import from_plain, to_plain
from render.scene.aovs import RenderedFrame
from render.scene.materials import LOOKS
from render.scene.noise import fractal_noise
from render.scene.patterns import PATTERNS, TEXELS, Pigment
from render.scene.surface import Surface

Rendered = Callable[..., RenderedFrame]

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
@given(st.integers(0, 2**32 - 1), st.sampled_from(PATTERNS), st.floats(0.05, 5))
def test_neighbours_have_neighbouring_phases_so_that_faces_can_interpolate(
    seed: int, pattern: str, scale: float
) -> None:
    pigment = Pigment(pattern, (RED, BLUE), scale=scale, turbulence=0.7, octaves=3, seed=seed)
    points = np.random.default_rng(seed).uniform(-3, 3, (200, 3))
    steps = np.abs(pigment.phases(points + 1e-6 * scale) - pigment.phases(points))
    assert steps.max() < 1e-4


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
    ):
        with pytest.raises(BadInputError):
            Pigment(**{"pattern": "layers", "colours": (RED, BLUE), **wrong})
    with pytest.raises(BadInputError, match="one colour"):
        LOOKS["glass"].with_values(pigment=Pigment("layers", (RED, BLUE)))


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
