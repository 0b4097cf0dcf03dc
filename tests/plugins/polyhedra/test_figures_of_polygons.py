"""The numbers behind the paper's figures of polygons."""

from __future__ import annotations

import math

import numpy as np
import pytest

from examples import drift, figure_b, figure_c
from examples.film import edge_lengths
from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh, validate

Sheets = tuple[PolygonMesh, PolygonMesh, TriangleMesh]


@pytest.fixture(scope="module")
def sheets() -> Sheets:
    return figure_b.three_versions()


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


def test_faces_drift_toward_triangles() -> None:
    rows = drift.shares(frames=40)
    assert rows[0, 1] == 1.0
    assert rows[-1, 0] > 0.25 and np.allclose(rows.sum(axis=1), 1.0)
