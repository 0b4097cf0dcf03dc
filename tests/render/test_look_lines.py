"""Edges drawn over a surface, and pictures drawn without following light."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.mesh.normals import split_at_creases, tessellate
from flowsculpt.pipeline.mesh.solids import box
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.mitsuba.shapes import BACKGROUND
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.patterns import Pigment
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.shaded_colours import shaded_colours
from flowsculpt.render.scene.surface import Surface, Wireframe, outlines, ribbons

Rendered = Callable[..., RenderedFrame]

TRIANGLE = Surface(
    np.float32([[-1, 0, 0], [1, 0, 0], [0, 1.5, 0]]), np.float32([[0, 0, 1]] * 3), np.int32([[0, 1, 2]])
)


def pairs(edges: np.ndarray) -> set[tuple[int, int]]:
    return {(min(a, b), max(a, b)) for a, b in edges.tolist()}


@pytest.mark.parametrize("pieces", [1, 2, 3, 5])
def test_the_mesh_that_was_resampled_shows_however_finely_it_is_cut(pieces: int) -> None:
    split = split_at_creases(box((1.0, 1.0, 1.0), 0.6))
    fine = tessellate(split, pieces)
    shown = outlines(fine.faces, pieces)
    assert pieces > 1 or pairs(shown) == pairs(split.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2))
    # Every piece of an edge joins two points on the line between two corners of the mesh.
    before = {frozenset(edge) for edge in pairs(split.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2))}
    assert len(shown) == len(before) * pieces
    length = np.linalg.norm(np.diff(fine.vertices[shown], axis=1), axis=2).sum()
    whole = sum(math.dist(*split.vertices[list(edge)]) for edge in before)
    assert length == pytest.approx(whole, rel=1e-6)


@given(
    width=st.floats(0.3, 8.0),
    pixels=st.integers(100, 4000),
    away=st.floats(3.0, 50.0),
    side=st.floats(-1.2, 1.2),
)
def test_lines_are_as_wide_in_the_picture_as_was_said(
    width: float, pixels: int, away: float, side: float
) -> None:
    camera = Camera((away * math.sin(side), 0.7, away * math.cos(side)), (0.0, 0.7, 0.0))
    lines = ribbons(TRIANGLE, Wireframe(width=width), camera, pixels)
    assert len(lines.faces) == 6
    x, y, _ = (camera.project(lines.vertices, 1.0) * pixels / 2.0).T
    at = np.stack([x, y], axis=1).reshape(3, 2, 2, 2)  # edge, end, side
    along = at.mean(axis=2)
    along = (along[:, 1] - along[:, 0]) / np.linalg.norm(along[:, 1] - along[:, 0], axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    wide = np.abs(np.einsum("esk,ek->es", at[:, :, 1] - at[:, :, 0], across))
    # The ribbon lies before the surface, which makes it larger by that share of the distance.
    assert wide == pytest.approx(np.full((3, 2), width), rel=0.05 + 2.0 * width / pixels)


def test_a_crease_is_one_line_though_its_sides_have_vertices_of_their_own() -> None:
    split = split_at_creases(box((1.0, 1.0, 1.0), 5.0))
    shape = Surface(split.vertices.astype(np.float32), split.normals.astype(np.float32), split.faces)
    lines = ribbons(shape, Wireframe(), Camera((3.0, 2.0, 8.0), (0.0, 0.0, 0.0)), 480)
    assert len(split.vertices) == 24 and len(lines.faces) == 2 * 18


def test_lines_show_in_the_picture_and_in_what_guides_the_denoiser(
    rendered: Rendered, picture: RenderedFrame
) -> None:
    look = replace(LOOKS["clay"], wireframe=Wireframe((0.0, 0.0, 0.0), width=2.0))
    drawn = rendered(look=look)
    inside = picture["matte"] == 1.0
    assert drawn["albedo"][inside].mean() < 0.8 * picture["albedo"][inside].mean()
    assert drawn["beauty"][inside].mean() < 0.9 * picture["beauty"][inside].mean()
    assert np.abs(drawn["matte"] - picture["matte"])[13, 24] == 0.0


def test_lines_lie_on_glass_too(rendered: Rendered) -> None:
    drawn = rendered(look=replace(LOOKS["glass"], wireframe=Wireframe(width=2.0)))
    clear = rendered(look=LOOKS["glass"])
    inside = clear["matte"] == 1.0
    assert drawn["albedo"][inside].mean() < 0.9 * clear["albedo"][inside].mean()


def test_edges_that_are_none_are_told(sphere: Surface) -> None:
    with pytest.raises(BadInputError, match="name some of its"):
        replace(sphere, edges=np.int32([[0, len(sphere.vertices)]])).check()


@pytest.mark.parametrize("wrong", [{"width": 0.0}, {"width": 101.0}, {"colour": (0.0, 0.0, 1.5)}])
def test_lines_that_no_picture_can_show_are_told(wrong: dict[str, object]) -> None:
    with pytest.raises(BadInputError, match="wireframe has"):
        Wireframe(**wrong)


HOMAGE = LOOKS["symbolics_1990"]


def test_a_drawn_picture_has_the_colours_of_its_vertices_and_no_noise(
    rendered: Rendered, sphere: Surface
) -> None:
    drawn = rendered(look=HOMAGE, seed=1)
    inside = drawn["matte"] == 1.0
    camera = Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0))
    colours = shaded_colours(sphere, HOMAGE, StagePlacement(), camera)
    assert np.abs(drawn["beauty"] - drawn["albedo"])[inside].mean() < 0.01
    assert drawn["beauty"][inside].max() <= colours.max() + 1e-3
    assert drawn["beauty"][inside].min() >= colours.min() - 1e-3
    other = rendered(look=HOMAGE, seed=2)
    assert np.abs(other["beauty"] - drawn["beauty"])[inside].mean() < 0.01


def test_a_drawn_picture_heeds_neither_lamps_nor_stage(rendered: Rendered) -> None:
    one = rendered(look=HOMAGE)
    other = rendered(look=HOMAGE, lights=LIGHTS["gallery"], stage=STAGES["none"])
    assert np.array_equal(one["beauty"], other["beauty"])


def test_the_ground_fills_the_picture_and_goes_from_its_top_to_its_bottom(rendered: Rendered) -> None:
    drawn = rendered(look=HOMAGE, quality=Quality(48, 27, samples=4, depth=3, auxiliary_samples=4))
    assert (drawn["depth"] > 0.0).all()
    assert drawn["beauty"][0].mean(axis=0) == pytest.approx(np.array(BACKGROUND[0]), abs=0.02)
    assert drawn["beauty"][-1].mean(axis=0) == pytest.approx(np.array(BACKGROUND[-1]), abs=0.05)


def test_both_sides_of_an_open_sheet_are_drawn() -> None:
    front = shaded_colours(TRIANGLE, HOMAGE, StagePlacement(), Camera((0.0, 0.7, 9.0), (0.0, 0.7, 0.0)))
    back = replace(TRIANGLE, normals=-TRIANGLE.normals)
    turned = shaded_colours(back, HOMAGE, StagePlacement(), Camera((0.0, 0.7, 9.0), (0.0, 0.7, 0.0)))
    assert np.array_equal(front, turned)


def test_a_drawn_look_takes_a_pigment() -> None:
    pigment = Pigment("gradient", ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), scale=2.0)
    there = replace(TRIANGLE, rest=np.float32([[0, -1, 0], [0, 1, 0], [0, -1, 0]]))
    camera = Camera((0.0, 0.7, 9.0), (0.0, 0.7, 0.0))
    red, blue, again = shaded_colours(there, replace(HOMAGE, pigment=pigment), StagePlacement(), camera)
    assert red[0] > 2.0 * red[2] and blue[2] > 2.0 * blue[0]
    assert again[0] > 2.0 * again[2]
