"""Faults that models come with are repaired and told; sound surfaces stay as they are."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh, icosphere, torus, validate
from flowsculpt.pipeline.mesh.face_soup import merge_coincident
from flowsculpt.pipeline.mesh.mesh_formats import FileSurface
from flowsculpt.pipeline.mesh.read import ModelFile, RepairedSurface, repair_surface
from tests.needed_plugins import needs_plugins

CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
BALL = icosphere(4)


def surface(points: AnyArray, *faces: Sequence[Sequence[int]] | AnyArray) -> FileSurface:
    every = [list(face) for part in faces for face in part]
    return FileSurface.of(np.asarray(points, float), every, base=1)


def repaired(points: AnyArray, *faces: Sequence[Sequence[int]] | AnyArray) -> RepairedSurface:
    result = repair_surface(surface(points, *faces))
    validate(result.mesh).require()
    validate(result.mesh.triangulated()).require()
    return result


def volume(mesh: PolygonMesh) -> float:
    first = mesh.vertices[mesh.corners[mesh.offsets[:-1]]]
    return float(np.einsum("ij,ij->", first, mesh.area_vectors) / 3.0)


def pieces(mesh: PolygonMesh) -> int:
    """Return the number of closed pieces with the topology of a sphere."""
    return validate(mesh).require(closed=True).euler // 2


def shifted(along: Sequence[float]) -> AnyArray:
    """Return a second cube's faces and all 16 points, those in common merged by their positions."""
    return np.concatenate([CUBE, CUBE + np.asarray(along, float)])


def test_a_vertex_shared_by_two_parts_is_split() -> None:
    result = repaired(shifted((1, 1, 1)), QUADS, QUADS + 8)
    assert pieces(result.mesh) == 2
    assert len(result.mesh.vertices) == 16
    assert result.repairs[-1] == "1 vertex joins two parts by a point only, at (1, 1, 1), vertex 8: split"


def test_solids_that_share_an_edge_are_separated_there_and_stay_closed() -> None:
    result = repaired(shifted((1, 1, 0)), QUADS, QUADS + 8)
    assert pieces(result.mesh) == 2
    assert volume(result.mesh) == pytest.approx(2.0)
    assert any("1 edge has more than two faces, at (1, 1, " in line for line in result.repairs)


def test_the_wall_between_two_solids_is_dropped() -> None:
    result = repaired(shifted((1, 0, 0)), QUADS, QUADS + 8)
    assert pieces(result.mesh) == 1
    assert volume(result.mesh) == pytest.approx(2.0)
    assert any("2 faces are part of walls inside" in line for line in result.repairs)


def test_solids_whose_common_wall_is_cut_differently_are_both_closed() -> None:
    one = [*QUADS[[0, 2, 3, 4, 5]].tolist(), [4, 6, 7], [4, 7, 5]]
    other = [*(QUADS[1:] + 8).tolist(), [8, 9, 10], [9, 11, 10]]
    result = repaired(shifted((1, 0, 0)), one, other)
    assert pieces(result.mesh) == 2
    assert volume(result.mesh) == pytest.approx(2.0)


def test_a_small_face_that_hangs_at_an_edge_is_dropped_and_a_larger_one_separated() -> None:
    points = np.vstack([BALL.vertices, 1.01 * BALL.vertices[BALL.faces[0, 0]], (0, 5, 0)])
    small, large = ([[*BALL.faces[0, :2].tolist(), len(BALL.vertices) + k]] for k in (0, 1))
    dropped = repaired(points[:-1], BALL.faces, small)
    assert len(dropped.mesh) == len(BALL.faces)
    assert "1 face hangs at an edge of two others" in dropped.repairs[0]
    separated = repaired(points, BALL.faces, large)
    assert len(separated.mesh) == len(BALL.faces) + 1
    assert validate(separated.mesh).boundary_edges == 3


@pytest.mark.parametrize("solid", [BALL, torus()], ids=["ball", "torus"])
def test_mixed_winding_is_made_consistent_and_outward(solid: TriangleMesh) -> None:
    faces = np.where(np.arange(len(solid.faces))[:, None] % 3, solid.faces[:, ::-1], solid.faces)
    result = repaired(solid.vertices, faces)
    assert validate(result.mesh).require(closed=True).faces == len(faces)
    assert volume(result.mesh) > 0
    assert "wound against their neighbours" in result.repairs[0]


def test_a_mirrored_solid_is_turned_outwards_and_a_cavity_stays_one() -> None:
    hollow = np.concatenate([CUBE, 0.25 + 0.5 * CUBE])
    sound = repaired(hollow, QUADS, QUADS[:, ::-1] + 8)
    assert sound.repairs == ()
    mirrored = repaired(hollow * (-1, 1, 1), QUADS, QUADS[:, ::-1] + 8)
    assert volume(mirrored.mesh) == pytest.approx(volume(sound.mesh)) == pytest.approx(1 - 0.125)
    assert mirrored.repairs[0].startswith("12 faces of closed surfaces face inwards")
    apart = repaired(shifted((3, 0, 0)), QUADS, QUADS[:, ::-1] + 8)
    assert volume(apart.mesh) == pytest.approx(2.0)


def test_a_one_sided_band_is_cut_open_once() -> None:
    turns = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    out = np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
    across = np.column_stack([np.cos(turns / 2)[:, None] * out[:, :2], np.sin(turns / 2)])
    points = np.concatenate([2 * out + across / 2, 2 * out - across / 2])
    faces = [[k, k + 1, k + 13, k + 12] for k in range(11)] + [[11, 12, 0, 23]]
    result = repaired(points, faces)
    assert [line.split(", ")[0] for line in result.repairs] == ["1 edge closes a one-sided surface"]
    assert len(result.mesh) == 12


def test_a_sheet_with_a_back_becomes_one_sheet() -> None:
    sheet = [[0, 1, 4, 3], [1, 2, 5, 4]]
    points = [(x, y, 0) for y in (0, 1) for x in (0, 1, 2)]
    result = repaired(np.array(points), sheet, [face[::-1] for face in sheet])
    assert len(result.mesh) == 2
    assert result.repairs == (
        "2 faces cover others that face the other way, the first at (0, 1, 0), vertex 4: "
        "one of each pair kept",
    )


def test_duplicates_repeats_and_leftovers_are_removed_and_told() -> None:
    bow = [[8, 9, 10, 8, 11, 12]]
    more = [(5, 0, 0), (6, 0, 0), (6, 1, 0), (4, 0, 0), (4, 1, 0), (9, 9, 9)]
    points = np.concatenate([CUBE, more, CUBE[:1]])
    result = repaired(points, QUADS[1:], [[14, 1, 3, 2]], QUADS[:1], bow, [[1, 1, 3]])
    told = [line.split(", ")[0] for line in result.repairs]
    assert told == [
        "1 vertex lies on another",
        "1 vertex belongs to no face",
        "1 face has fewer than three different corners",
        "1 face names a vertex twice",
        "1 face is in the file twice",
        "1 vertex joins two parts by a point only",
    ]
    assert len(result.mesh) == 6 + 2


def test_creases_and_polygons_survive_repair() -> None:
    wrong = [face[::-1] if k == 1 else face for k, face in enumerate(QUADS.tolist())]
    mesh = repair_surface(FileSurface.of(CUBE, wrong, [0, 0, 0, 1, 0, 0], [(0, 1)], base=1)).mesh
    assert mesh.sides.tolist() == [4] * 6
    assert mesh.creases.tolist() == [[0, 1], [2, 3], [2, 6], [3, 7], [6, 7]]


@needs_plugins("interchange")
def test_repair_off_refuses_with_the_files_own_numbers_and_the_remedy(tmp_path: Path) -> None:
    lines = [f"v {x:g} {y:g} {z:g}" for x, y, z in shifted((1, 1, 1))[[*range(8), *range(9, 16)]]]
    second = [[7 if v == 0 else v + 7 for v in face] for face in QUADS.tolist()]
    lines += ["f " + " ".join(str(v + 1) for v in face) for face in QUADS.tolist() + second]
    (tmp_path / "two.obj").write_text("\n".join(lines))
    assert len(ModelFile(tmp_path / "two.obj").surface().repairs) == 1
    with pytest.raises(MeshError, match=r"point only, at \(1, 1, 1\), vertex 8\. Write repair: on") as error:
        ModelFile(tmp_path / "two.obj").surface(repair=False)
    assert str(error.value).startswith(str(tmp_path / "two.obj"))


@pytest.mark.parametrize(("size", "offset"), [(1e-3, 0), (1e4, 0), (1, 1e5), (1e-3, 1e5), (1e4, 1e5)])
def test_small_large_and_distant_models_are_not_merged_too_far(size: float, offset: float) -> None:
    points = size * BALL.vertices + offset
    result = repaired(points[BALL.faces].reshape(-1, 3), np.arange(BALL.faces.size).reshape(-1, 3))
    assert len(result.mesh.vertices) == len(BALL.vertices)
    assert validate(result.mesh).require(closed=True).euler == 2


@st.composite
def soups(draw: st.DrawFn) -> FileSurface:
    """Any faces over a few points; most are no surface."""
    count = draw(st.integers(3, 9))
    points = draw(st.lists(st.tuples(*[st.integers(-1, 1)] * 3), min_size=count, max_size=count))
    face = st.lists(st.integers(0, count - 1), min_size=2, max_size=5)
    faces = draw(st.lists(face, min_size=1, max_size=12))
    groups = draw(st.lists(st.integers(0, 2), min_size=len(faces), max_size=len(faces)))
    return FileSurface.of(np.array(points, float), faces, groups, [(0, 1), (1, 2)], base=1)


@settings(max_examples=150, deadline=None)
@given(soups())
def test_any_faces_become_a_sound_surface_or_are_refused(soup: FileSurface) -> None:
    try:
        result = repair_surface(soup)
    except MeshError as error:
        assert "degenerate" in str(error)
        return
    validate(result.mesh).require()
    validate(result.mesh.triangulated()).require()
    plain, _ = merge_coincident(soup).soup.to_mesh()
    if validate(plain).sound and not any("face inwards" in line for line in result.repairs):
        assert np.array_equal(plain.vertices, result.mesh.vertices)
        assert np.array_equal(plain.corners, result.mesh.corners)
    else:
        assert result.repairs
