"""A lattice is one closed surface with as many holes as its grid has meshes, and knows its true surface."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import ShotError, UsageError
from flowsculpt.pipeline.mesh import TriangleMesh, dihedral_angles, validate
from flowsculpt.pipeline.mesh.analytic_surfaces import MAX_CROSSINGS, BarLattice, lattice
from flowsculpt.pipeline.shot import Solid, read_shot

counts = st.tuples(*[st.integers(1, 4)] * 3)


def of(bars: tuple[int, int, int], pitch: float = 0.6, thickness: float = 0.15) -> BarLattice:
    x, y, z = (pitch * (n - 1) + thickness if n > 1 else thickness for n in bars)
    return BarLattice((x, y, z), pitch, thickness)


def meshed(shape: BarLattice, edge_length: float | None = None) -> TriangleMesh:
    return lattice(shape.size, shape.spacing, shape.thickness, edge_length)


def struts(bars: tuple[int, int, int]) -> int:
    return sum((n - 1) * math.prod(bars) // n for n in bars)


def holes(bars: tuple[int, int, int]) -> int:
    """Return the genus of the surface around a connected grid: its independent circuits."""
    return struts(bars) - math.prod(bars) + 1


def volume(mesh: TriangleMesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@given(bars=counts, edge_length=st.sampled_from([None, 0.2, 0.07]))
@settings(max_examples=25, deadline=None)
def test_it_is_closed_and_oriented_with_a_hole_for_each_circuit(
    bars: tuple[int, int, int], edge_length: float | None
) -> None:
    shape = of(bars)
    assert shape.crossings == bars
    mesh = meshed(shape, edge_length)
    validate(mesh).require(closed=True)
    edges = len(mesh.faces) * 3 // 2
    assert len(mesh.vertices) - edges + len(mesh.faces) == 2 - 2 * holes(bars)
    bar, gap = shape.thickness, 0.6 - shape.thickness
    assert volume(mesh) == pytest.approx(math.prod(bars) * bar**3 + struts(bars) * bar**2 * gap)


def test_its_sides_are_flat_its_edges_right_angled_and_its_triangles_as_small_as_asked() -> None:
    mesh = meshed(of((3, 3, 2)), 0.08)
    assert np.allclose(np.abs(mesh.face_normals).max(axis=1), 1)
    turns = np.abs(dihedral_angles(mesh))
    assert (np.isclose(turns, 0) | np.isclose(turns, math.pi / 2)).all() and (turns > 1).any()
    ends = mesh.vertices[mesh.faces]
    sides = np.linalg.norm(ends - np.roll(ends, 1, axis=1), axis=2)
    assert sides.max() <= 0.08 * math.sqrt(2) + 1e-12
    assert sides.min() >= 0.04


def test_spacing_gives_way_so_that_the_outer_bars_end_where_the_size_does() -> None:
    shape = BarLattice((2.0, 1.0, 0.1), 0.4, 0.1)
    assert shape.crossings == (6, 3, 1)
    assert np.allclose(shape.pitch, (0.38, 0.45, 0.0))
    assert np.allclose(meshed(shape).bounds, [(-1, -0.5, -0.05), (1, 0.5, 0.05)])


def test_bars_never_meet_however_the_spacing_gives_way() -> None:
    shape = BarLattice((2.5, 1.0, 1.0), 1.0, 0.9 / 2)
    assert (shape.pitch > shape.thickness).all()
    validate(meshed(shape)).require(closed=True)


@settings(max_examples=20, deadline=None)
@given(bars=counts, seed=st.integers(0, 2**32 - 1))
def test_no_point_of_the_mesh_is_nearer_than_the_nearest(bars: tuple[int, int, int], seed: int) -> None:
    shape = of(bars)
    mesh = meshed(shape, 0.05)
    points = np.random.default_rng(seed).uniform(-1.3, 1.3, (30, 3))
    on = shape(points)
    distance = np.linalg.norm(on - points, axis=1)
    to_mesh = np.linalg.norm(mesh.vertices[None] - points[:, None], axis=2).min(axis=1)
    assert (distance <= to_mesh + 1e-12).all()
    assert (to_mesh - distance < 0.05).all()
    assert np.array_equal(shape(on), on)


@pytest.mark.parametrize("bars", [(2, 3, 1), (2, 2, 2)])
def test_what_it_encloses_is_as_much_as_its_mesh_holds(bars: tuple[int, int, int]) -> None:
    shape = of(bars)
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (200_000, 3)) * shape.size
    mesh = meshed(shape)
    assert shape.encloses(points).mean() * math.prod(shape.size) == pytest.approx(volume(mesh), rel=0.02)
    middles, out = mesh.vertices[mesh.faces].mean(axis=1), 1e-6 * mesh.face_normals
    assert shape.encloses(middles - out).all() and not shape.encloses(middles + out).any()


def test_vertices_stay_bit_for_bit_and_normals_are_the_faces_own() -> None:
    shape = of((3, 2, 1))
    mesh = meshed(shape, 0.05)
    assert np.abs(shape(mesh.vertices) - mesh.vertices).max() < 1e-15
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    assert np.allclose(shape.normals(middles), mesh.face_normals)
    on_crease = np.array([[shape.pitch[0] / 2, -0.3 - 0.075, 0.075]])
    assert not shape.normals(on_crease).any()


@pytest.mark.parametrize(
    ("size", "spacing", "thickness", "fact"),
    [
        ((2.0, 2.0, 2.0), 0.1, 0.2, "bars touch"),
        ((2.0, 2.0, 0.15), 0.6, 0.1, "more than twice"),
        ((2.0, 2.0, 0.05), 0.6, 0.1, "more than twice"),
        ((2.0, 2.0, math.nan), 0.6, 0.1, "positive"),
        ((1e12, 1e12, 1e12), 1e-3, 1e-4, f"{MAX_CROSSINGS} are the most"),
    ],
)
def test_bars_that_cannot_be_are_refused(
    size: tuple[float, float, float], spacing: float, thickness: float, fact: str
) -> None:
    with pytest.raises(UsageError, match=fact):
        BarLattice(size, spacing, thickness)


def test_a_shot_may_name_it_and_is_told_where_its_bars_meet(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    text = "title: A\nframes: 1-2\nresample: {max_edge_length: 0.1}\nsubject: "
    file.write_text(text + "{solid: lattice, size: [2, 2, 0.1], spacing: 0.5, thickness: 0.1}\n")
    assert read_shot(file).motion.subject == Solid.of(
        "lattice", {"size": [2, 2, 0.1], "spacing": 0.5, "thickness": 0.1}
    )
    file.write_text(text + "{solid: lattice, spacing: 0.1, thickness: 0.2}\n")
    with pytest.raises(ShotError, match=r"a\.yaml:4:1: spacing 0\.1 must be above thickness"):
        read_shot(file)
