"""The numbers behind the paper's figures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from examples import figure_a, figure_d, figure_e, figure_f
from examples.film import edge_lengths, sphericity
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, validate

Cubes = tuple[TriangleMesh, TriangleMesh]


@pytest.fixture(scope="module")
def cubes() -> Cubes:
    return figure_a.with_and_without()


def test_resampling_holds_every_edge_of_figure_a_and_without_it_they_grow(cubes: Cubes) -> None:
    static, adaptive = cubes
    validate(adaptive).require()
    at_rest = edge_lengths(box(edge_length=figure_a.EDGE)).max()
    assert edge_lengths(adaptive).max() <= figure_a.LONGEST
    assert edge_lengths(static).max() > 2.5 * at_rest


def test_both_halves_of_figure_a_show_one_shape(cubes: Cubes) -> None:
    static, adaptive = cubes
    assert np.abs(static.bounds - adaptive.bounds).max() < figure_a.LONGEST / 2


def test_splitting_one_edge_makes_four_triangles_of_two() -> None:
    after, report = figure_d.split(figure_d.PAIR, 1.5)
    assert (report.splits, len(after.faces)) == (1, 4)
    assert after.vertices[-1] == pytest.approx(figure_d.PAIR.vertices[[0, 2]].mean(axis=0))


def test_splitting_goes_on_until_no_edge_is_long() -> None:
    after, report = figure_d.split(figure_d.STRETCHED, 0.3)
    assert edge_lengths(figure_d.STRETCHED).max() > 6 * 0.3
    assert edge_lengths(after).max() <= 0.3 and report.passes > 3


def test_a_collapsed_edge_leaves_one_vertex_at_its_middle() -> None:
    before = figure_e.flat()
    after = figure_e.collapse(before)
    assert len(after.vertices) == len(before.vertices) - 1 and len(after.faces) == len(before.faces) - 2
    middle = before.vertices[list(figure_e.SHORT)].mean(axis=0)
    assert figure_e.merged_vertex(before, after) == pytest.approx(middle)


def test_an_end_on_a_crease_keeps_its_place() -> None:
    before = figure_e.folded()
    after = figure_e.collapse(before)
    assert len(after.vertices) == len(before.vertices) - 1
    assert (figure_e.merged_vertex(before, after) == before.vertices[figure_e.SHORT[0]]).all()


def test_the_sculpture_of_figure_f_is_a_sound_closed_surface() -> None:
    mesh = figure_f.sculpture(frame=6)
    validate(mesh).require()
    assert sphericity(mesh) < 0.82


def test_sphericity_is_one_for_a_ball_and_that_of_a_cube_is_known() -> None:
    assert sphericity(icosphere(40)) == pytest.approx(1.0, abs=1e-3)
    assert sphericity(box(edge_length=0.5)) == pytest.approx((math.pi / 6) ** (1 / 3))
