"""Numbers shown by colour: how they are measured, and what of them reaches a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import from_plain, to_plain
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.measured_colours import (
    KINDS,
    Measure,
    at_vertices,
    principal_stretches,
    values_at_vertices,
    with_known,
)
from flowsculpt.render.scene.palettes import COLOUR_MAPS, colour_map
from flowsculpt.render.scene.surface import Surface

Rendered = Callable[..., RenderedFrame]


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_principal_stretches_are_the_singular_values_of_what_deforms_a_triangle(seed: int) -> None:
    drawn = np.random.default_rng(seed)
    rest = drawn.uniform(-1, 1, (3, 3))
    deformed = drawn.uniform(-2, 2, (3, 3))
    longest, shortest = principal_stretches(rest, rest @ deformed.T, np.int32([[0, 1, 2]]))
    edges = np.stack([rest[1] - rest[0], rest[2] - rest[0]], axis=1)
    plane, _ = np.linalg.qr(edges)
    expected = np.linalg.svd(deformed @ plane, compute_uv=False)
    assert (longest[0], shortest[0]) == pytest.approx(tuple(expected), rel=1e-6, abs=1e-6)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_nothing_principal_stretches_that_only_moves_and_turns(seed: int) -> None:
    drawn = np.random.default_rng(seed)
    rest, (turned, _) = drawn.uniform(-1, 1, (30, 3)), np.linalg.qr(drawn.normal(size=(3, 3)))
    faces = np.int32([[3 * i, 3 * i + 1, 3 * i + 2] for i in range(10)])
    longest, shortest = principal_stretches(rest, rest @ turned + drawn.normal(size=3), faces)
    assert longest == pytest.approx(np.ones(10), abs=1e-5) and shortest == pytest.approx(
        np.ones(10), abs=1e-5
    )


def test_triangles_without_area_at_rest_count_for_nothing(sphere: Surface) -> None:
    flat = np.float32([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    assert [part[0] for part in principal_stretches(flat, 3.0 * flat, np.int32([[0, 1, 2]]))] == [1.0, 1.0]
    grown = replace(sphere, rest=(sphere.vertices / 3.0).astype(np.float32))  # its poles are flat ones
    longest, shortest = principal_stretches(grown.rest, grown.vertices, grown.faces)
    assert at_vertices(longest * shortest, grown) == pytest.approx(
        np.full(len(sphere.vertices), 9.0), rel=1e-4
    )


def test_what_has_grown_threefold_is_shown_as_that(sphere: Surface) -> None:
    grown = replace(sphere, rest=(sphere.vertices / 2.0).astype(np.float32))
    assert Measure("stretch").phases(grown) == pytest.approx(np.full(len(sphere.vertices), 0.5), abs=1e-4)
    assert Measure("area").phases(grown) == pytest.approx(np.full(len(sphere.vertices), 1.0), abs=1e-4)
    assert Measure("area", low=1.0, high=16.0).phases(grown) == pytest.approx(0.5, abs=1e-4)


def test_the_same_speed_has_the_same_colour_whatever_else_moves(sphere: Surface) -> None:
    speeds = np.linspace(0.0, 9.0, len(sphere.vertices), dtype=np.float32)[:, None]
    shown = LOOKS["speed"].vertex_colours(replace(sphere, attributes={"speed": speeds}))
    slower = LOOKS["speed"].vertex_colours(replace(sphere, attributes={"speed": np.minimum(speeds, 1.0)}))
    assert shown is not None and slower is not None
    same = speeds[:, 0] <= 1.0
    assert np.array_equal(shown[same], slower[same])
    assert np.array_equal(shown[-1], colour_map("viridis")[-1])  # beyond the range its end goes on


def test_speeds_reach_the_picture(rendered: Rendered, sphere: Surface) -> None:
    up = (sphere.vertices[:, 1:2] > 1.0).astype(np.float32) * 4.0
    layers = rendered(surface=replace(sphere, attributes={"speed": up}), look=LOOKS["speed"])
    inside, height = layers["matte"] == 1.0, layers["position"][..., 1]
    for part, colour in ((height > 1.4, colour_map("viridis")[-1]), (height < 0.6, colour_map("viridis")[0])):
        albedo = layers["albedo"][inside & part]
        assert len(albedo) > 8
        assert albedo.mean(axis=0) == pytest.approx(colour, abs=0.1)


def test_places_without_a_value_are_neutral_and_no_colour_of_the_palette_is_between(
    rendered: Rendered, sphere: Surface
) -> None:
    values = np.where(sphere.vertices[:, 1] > 1.0, np.nan, 3.0)  # its upper half has none
    look = LOOKS["clay"].with_values(measure=Measure("values", "viridis", 1.0, 3.0, missing=(0.9, 0.1, 0.1)))
    layers = rendered(surface=replace(sphere, attributes={"values": with_known(values)}), look=look)
    inside, height, albedo = layers["matte"] == 1.0, layers["position"][..., 1], layers["albedo"]
    high, missing = colour_map("viridis")[-1], np.float32([0.9, 0.1, 0.1])
    for part, colour in ((height > 1.1, missing), (height < 0.8, high)):
        assert albedo[inside & part].mean(axis=0) == pytest.approx(colour, abs=0.02)
    mixed = albedo[inside] - missing
    along = (mixed @ (high - missing)) / ((high - missing) @ (high - missing))
    assert (
        np.abs(mixed - along[:, None] * (high - missing)).max() < 0.02
    )  # pixels of a border mix the two alone


def test_what_is_between_vertices_has_the_value_of_those_that_are_known() -> None:
    attribute = with_known([4.0, np.nan, 0.0])
    middles = 0.5 * (attribute + np.roll(attribute, -1, axis=0))
    shown = Surface(*np.zeros((2, 3, 3), np.float32), np.zeros((0, 3), np.int32), {"values": middles})
    assert values_at_vertices(shown)[[0, 1]] == pytest.approx([np.nan, np.nan], nan_ok=True)
    assert values_at_vertices(shown)[2] == pytest.approx(2.0)


@settings(deadline=None, max_examples=100)
@given(st.floats(-50, 50), st.floats(0.1, 80), st.one_of(st.none(), st.floats(-60, 60)), st.booleans())
def test_a_range_about_a_centre_is_even_and_holds_all(
    low: float, size: float, centre: Any, is_diverging: bool
) -> None:
    measure = Measure(
        "values",
        "balance" if is_diverging else "viridis",
        shares=(0.0, 1.0),
        centre=centre,
        quantiles=lambda _: (low, low + size),
    )
    found = measure.range
    middle = centre if centre is not None else 0.0 if is_diverging else None
    assert found[0] <= low + 1e-9 and found[1] >= low + size - 1e-9
    if middle is None:
        assert found == pytest.approx((low, low + size))
    else:
        assert 0.5 * sum(found) == pytest.approx(middle, abs=1e-9)


@pytest.mark.parametrize("name", COLOUR_MAPS)
def test_colour_maps_are_reflectances(name: str) -> None:
    row = colour_map(name)
    assert row.shape == (256, 3) and row.min() >= 0.0 and row.max() <= 1.0


@pytest.mark.parametrize("name", ["viridis", "plasma", "inferno", "magma", "cividis"])
def test_perceptual_maps_grow_lighter_all_the_way(name: str) -> None:
    light = np.cbrt(colour_map(name) @ np.array([0.2126, 0.7152, 0.0722]))
    assert (np.diff(light) > -1e-3).all() and light[-1] > light[0] + 0.4


def test_what_cannot_be_measured_is_told(sphere: Surface) -> None:
    with pytest.raises(BadInputError, match="the surface has no velocities"):
        Measure("speed").phases(sphere)
    with pytest.raises(BadInputError, match="has no rest positions"):
        Measure("stretch").phases(sphere)
    for wrong in ({"of": "heat"}, {"colours": "jet"}, {"low": 5.0}, {"of": "area", "low": 0.0}):
        with pytest.raises(BadInputError):
            Measure(**{"of": "speed", **wrong})
    with pytest.raises(BadInputError, match="one colour"):
        LOOKS["glass"].with_values(measure=Measure("speed"))


def test_a_palette_that_is_not_installed_is_refused_when_the_shot_is_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("flowsculpt.render.scene.palettes.find_spec", lambda _: None)
    with pytest.raises(BadInputError, match=r"Install flowsculpt\[fields\] or take one of viridis"):
        Measure("values", "thermal")
    Measure("values", "viridis")


@pytest.mark.parametrize("of", KINDS)
def test_a_measure_survives_being_written_down(of: str) -> None:
    look = replace(LOOKS["clay"], measure=Measure(of, "turbo", 1.0, 2.0))
    assert from_plain(type(look), to_plain(look)) == look
