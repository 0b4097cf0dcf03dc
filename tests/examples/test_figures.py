"""The numbers behind the paper's figures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from examples import figure_a, figure_b, figure_c, figure_d, figure_e, figure_f
from examples.film import edge_lengths, sphericity
from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh, box, icosphere, validate

Cubes = tuple[TriangleMesh, TriangleMesh]
Sheets = tuple[PolygonMesh, PolygonMesh, TriangleMesh]


@pytest.fixture(scope="module")
def sheets() -> Sheets:
    return figure_b.three_versions()


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


def test_the_discs_of_figure_b_overlap_within_the_sheet() -> None:
    apart = math.dist(figure_b.SWELLING, figure_b.SHRINKING)
    assert figure_b.RADIUS < apart < 2 * figure_b.RADIUS
    assert max(figure_b.SWELLING) + figure_b.RADIUS < 1 and min(figure_b.SHRINKING) - figure_b.RADIUS > -1


def test_the_disc_of_expansion_gains_vertices_and_that_of_contraction_loses_them(sheets: Sheets) -> None:
    static, arbitrary, triangles = sheets
    for mesh in (arbitrary, triangles):
        for centre, gains in ((figure_b.SWELLING, True), (figure_b.SHRINKING, False)):
            before, after = (_within_half(m.vertices, centre) for m in (static, mesh))
            assert after > before + 30 if gains else after < 0.6 * before


def test_density_is_that_of_the_rest_of_the_sheet_in_both_discs(sheets: Sheets) -> None:
    for mesh in sheets[1:]:
        swollen, shrunk = (_within_half(mesh.vertices, c) for c in (figure_b.SWELLING, figure_b.SHRINKING))
        assert 0.4 < swollen / shrunk < 2.5
    static = sheets[0]
    assert 20 * _within_half(static.vertices, figure_b.SWELLING) < _within_half(
        static.vertices, figure_b.SHRINKING
    )


def test_no_edge_of_figure_b_is_over_the_maximum_but_in_the_static_mesh(sheets: Sheets) -> None:
    static, arbitrary, triangles = sheets
    assert edge_lengths(static).max() > 3 * figure_b.LONGEST
    assert edge_lengths(arbitrary).max() <= figure_b.LONGEST
    assert edge_lengths(triangles).max() <= figure_b.LONGEST


def _within_half(points: Points, centre: tuple[float, float, float]) -> int:
    """Count the vertices in the inner half of a disc."""
    return int((np.linalg.norm(points - centre, axis=1) < figure_b.RADIUS / 2).sum())


def test_the_bread_slicer_makes_as_few_parts_as_can_be_and_recursion_a_power_of_two() -> None:
    face = figure_c.loaf()
    length = float(face.extents[0])
    assert edge_lengths(face).max() < figure_c.LONGEST  # no edge is too long, but the face is (P19)
    assert len(figure_c.slice_face(face)) == math.ceil(length / figure_c.LONGEST) == 6
    assert len(figure_c.slice_face(face, "recurse")) == 8


def test_slices_of_a_concave_face_fill_it() -> None:
    face = figure_c.horseshoe()
    parts = figure_c.slice_face(face)
    validate(parts).require()
    assert parts.extents.max() <= figure_c.LONGEST
    assert parts.areas.sum() == pytest.approx(face.areas.sum())


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
