"""Claims of the paper about its first version, by number (P16-P22)."""

import math

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh import PolygonMesh, validate
from flowsculpt.pipeline.plugins.polyhedra.polyhedral_resampler import PolyhedralResampler
from flowsculpt.pipeline.plugins.polyhedra.polyhedron import (
    Cutting,
    LengthLimits,
    Polyhedron,
    PolyhedronEditor,
)
from flowsculpt.pipeline.plugins.polyhedra.subdivision import Slicer
from flowsculpt.pipeline.resample import Thresholds, edges_by_angle, edges_in_region

KINDS = ["cube", "ell", "comb", "star", "drum", "ring", "open box", "leaf", "tetrahedron", "ball", "cloth"]
COARSE = Thresholds(0.3)


def sliced(
    mesh: PolygonMesh, longest: float, cutting: Cutting = "slice"
) -> tuple[PolyhedronEditor, list[int]]:
    """The first face cut once round, its sides as they are."""
    editor = PolyhedronEditor(Polyhedron(mesh), LengthLimits(Thresholds(longest, 0.0), mesh))
    parts, _ = Slicer(editor, cutting).faces([0])
    return editor, parts


def leaf(*outline: tuple[float, float]) -> PolygonMesh:
    """One flat face that lies in the plane y = 0 and faces upwards."""
    return PolygonMesh([(x, 0, -z) for x, z in outline], [range(len(outline))])


def twisted(points: Points, frame: int) -> Points:
    """A few hundredths of a turn around y, more farther up, and a wave."""
    x, y, z = points.T
    turn = 0.05 * y * np.exp(-(x * x + z * z))
    return np.column_stack(
        [
            x * np.cos(turn) - z * np.sin(turn) + 0.012 * np.sin(2 * y),
            y + 0.02 * np.sin(3 * x + 0.1 * frame),
            x * np.sin(turn) + z * np.cos(turn),
        ]
    )


@pytest.mark.parametrize("cutting", ["slice", "recurse"])
@pytest.mark.parametrize("kind", KINDS)
def test_p16_any_polyhedron_is_subdivided_edges_and_faces(
    kind: str, cutting: Cutting, menagerie: dict[str, PolygonMesh]
) -> None:
    before = validate(menagerie[kind]).require()
    resampler = PolyhedralResampler(menagerie[kind], COARSE, cutting)
    report = resampler.resample()
    after = validate(resampler.mesh).require()
    assert (after.euler, after.closed) == (before.euler, before.closed)
    assert report.longest <= 0.3
    assert report.widest <= 0.3
    assert (report.vertices, report.faces, report.edges) == (after.vertices, after.faces, after.edges)


def test_p17_the_longest_dimension_is_cut_across() -> None:
    editor, parts = sliced(leaf((0, 0), (3, 0), (3, 2), (0, 2)), 2.0)
    assert len(parts) == 2
    chords = [editor.surface.mesh().vertices[4:]]
    assert sorted(map(tuple, chords[0].tolist())) == [(1.5, 0, -2), (1.5, 0, 0)]


def test_p18_figure_c_the_bread_slicer_makes_all_cuts_at_once() -> None:
    bread = leaf((0, 0), (7, 0), (7, 1), (0, 1))
    editor, parts = sliced(bread, 1.0, "slice")
    assert len(parts) == 7
    assert editor.surface.mesh().extents.tolist() == pytest.approx([1.0] * 7)
    assert len(sliced(bread, 1.0, "recurse")[1]) == 2, "the other way cuts in two, and comes back"


def test_p18_the_work_of_slicing_grows_little_faster_than_the_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    walked, loop = 0, Polyhedron.loop

    def counted(surface: Polyhedron, h: int) -> list[int]:
        nonlocal walked
        sides = loop(surface, h)
        walked += len(sides)
        return sides

    monkeypatch.setattr(Polyhedron, "loop", counted)
    work = []
    for length in (100, 400):
        walked = 0
        wavy = [(x, 0.2 * math.sin(x)) for x in range(length + 1)]
        face = leaf(*wavy, *((x, y + 0.9) for x, y in reversed(wavy)))
        report = PolyhedralResampler(face, Thresholds(1.5)).resample()
        assert report.faces > 0.6 * length
        work.append(walked)
    assert work[1] < 6 * work[0], "four times the slices and some, not sixteen"


def test_p18_both_ways_of_cutting_end_within_limits(menagerie: dict[str, PolygonMesh]) -> None:
    counts = {}
    for cutting in ("slice", "recurse"):
        resampler = PolyhedralResampler(menagerie["cube"], COARSE, cutting)  # type: ignore[arg-type]
        report = resampler.resample()
        assert max(report.longest, report.widest) <= 0.3
        counts[cutting] = report.faces
    assert counts == {"slice": 6 * 7**2, "recurse": 6 * 8**2}


def test_p19_a_large_face_of_many_short_edges_is_cut() -> None:
    outline = [(math.cos(2 * math.pi * k / 60), math.sin(2 * math.pi * k / 60)) for k in range(60)]
    disc = leaf(*outline)
    resampler = PolyhedralResampler(disc, Thresholds(0.3, 0.05))
    assert np.linalg.norm(disc.vertices[1] - disc.vertices[0]) < 0.3, "no edge is too long"
    report = resampler.resample()
    assert report.faces > 30
    assert report.widest <= 0.3
    assert resampler.mesh.areas.sum() == pytest.approx(disc.areas.sum())


def test_p20_a_cube_of_six_quads_is_meshed_on_the_first_frame(menagerie: dict[str, PolygonMesh]) -> None:
    resampler = PolyhedralResampler(menagerie["cube"], Thresholds(0.5))
    report = resampler.resample()
    assert (report.faces, report.average_sides) == (6 * 16, 4.0)
    assert resampler.mesh.areas == pytest.approx(0.25)


@pytest.mark.parametrize("kind", ["ell", "comb", "star"])
def test_p20_concave_faces_are_cut_within_themselves(kind: str, menagerie: dict[str, PolygonMesh]) -> None:
    whole = menagerie[kind]
    resampler = PolyhedralResampler(whole, Thresholds(0.4))
    resampler.resample()
    mesh = resampler.mesh
    for direction in np.vstack([np.eye(3), -np.eye(3)]):
        facing = mesh.normals @ direction > 0.999
        if facing.any():
            before = whole.areas[whole.normals @ direction > 0.999].sum()
            assert mesh.areas[facing].sum() == pytest.approx(before)
    assert validate(mesh.triangulated()).require(closed=True).euler == 2
    assert _volume(mesh) == pytest.approx(_volume(whole))


def _volume(mesh: PolygonMesh) -> float:
    triangles = mesh.triangulated()
    corners = triangles.vertices[triangles.faces]
    return float(np.linalg.det(corners).sum() / 6)


@pytest.mark.slow
def test_p21_faces_drift_toward_triangles(menagerie: dict[str, PolygonMesh]) -> None:
    resampler = PolyhedralResampler(menagerie["cube"], COARSE)
    sides = [resampler.resample().average_sides]
    for frame in range(80):
        resampler.vertices[:] = twisted(resampler.vertices, frame)
        sides.append(resampler.resample().average_sides)
    assert sides[0] == 4.0
    assert 3.0 <= sides[-1] < 3.75
    assert np.bincount(resampler.mesh.sides).argmax() == 3


def test_p22_small_faces_may_collapse_instead_of_short_edges(menagerie: dict[str, PolygonMesh]) -> None:
    """By area no face stays small without a reason; but short edges do, which is why it was abandoned."""
    short = {}
    for collapse in ("edges", "areas"):
        resampler = PolyhedralResampler(menagerie["ball"], COARSE, collapse=collapse)  # type: ignore[arg-type]
        done = 0
        for _ in range(8):
            resampler.vertices[:] *= [0.9, 0.9, 1.05]
            report = resampler.resample()
            done += report.collapses
            assert report.too_short == sum(report.refused.values())
        assert done > 20
        assert validate(resampler.mesh).require(closed=True).euler == 2
        short[collapse] = report.too_short / report.edges
    assert 3 * short["edges"] < short["areas"]


def test_p9_p27_short_edges_collapse_to_their_middle() -> None:
    points = [(0, 0, 0), (0.9, 0, 0), (1.1, 0, 0), (2, 0, 0), (2, 0, -1), (1, 0, -1), (0, 0, -1)]
    points += [(2, 0, 1), (1, 0, 1), (0, 0, 1)]
    flat = PolygonMesh(points, [(0, 1, 5, 6), (1, 2, 5), (2, 3, 4, 5), (2, 1, 8), (1, 0, 9, 8), (3, 2, 8, 7)])
    resampler = PolyhedralResampler(flat, Thresholds(1.6, 0.3))
    report = resampler.resample()
    assert report.collapses == 1
    assert report.faces == 4, "the two triangles on the edge are gone"
    assert [1.0, 0.0, 0.0] in resampler.vertices.tolist()


def test_p28_p30_a_cube_keeps_its_edges_while_it_is_crushed(menagerie: dict[str, PolygonMesh]) -> None:
    resampler = PolyhedralResampler(menagerie["cube"], COARSE)
    for _ in range(12):
        resampler.resample()
        resampler.vertices[:] *= 0.93
    report = resampler.resample()
    assert report.collapses > 0
    low, high = resampler.mesh.bounds
    assert high - low == pytest.approx(2 * 0.93**12)
    assert _volume(resampler.mesh) == pytest.approx(8 * 0.93**36), "not a corner has gone"


def test_p31_tagged_edges_are_preserved() -> None:
    """A ridge too blunt to be hard by its angle is kept where it is tagged, and lost where it is not."""
    outline = np.linspace(-1, 1, 21)
    points = [(x, 0.04 * (y == 0), y) for y in (-0.1, 0, 0.1) for x in outline]
    faces = [
        (r * 21 + k + 1, r * 21 + k, r * 21 + k + 21, r * 21 + k + 22) for r in range(2) for k in range(20)
    ]
    roof = PolygonMesh(points, [f[::-1] for f in faces])
    ridge = edges_in_region(roof, lambda points: (points[:, 1] >= 0.03) & (abs(points[:, 2]) <= 0.01))
    assert len(ridge) == 20
    heights = {}
    for name, creases in (("tagged", ridge), ("free", [])):
        resampler = PolyhedralResampler(roof.with_creases(creases), Thresholds(0.3, 0.14, math.radians(80)))
        resampler.resample()
        heights[name] = np.sort(resampler.vertices[:, 1])
        kept = resampler.mesh.creases
        if name == "tagged":
            ends = resampler.vertices[kept]
            assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(2.0)
            assert (ends[:, :, 1] == 0.04).all()
    assert (heights["tagged"] == 0.04).sum() >= 7
    assert ((heights["free"] > 0) & (heights["free"] < 0.04)).any() or (heights["free"] == 0.04).sum() < 7


def test_p31_edges_are_tagged_by_angle_and_by_region(menagerie: dict[str, PolygonMesh]) -> None:
    cube = menagerie["cube"]
    assert np.array_equal(edges_by_angle(cube, math.radians(40)), cube.edges)
    assert len(edges_by_angle(cube, math.radians(100))) == 0
    cut = cube.triangulated()
    assert np.array_equal(edges_by_angle(cut, math.radians(40)), cube.edges), "diagonals are flat"
    top = edges_in_region(cube, lambda points: abs(points[:, 1] - 2) <= 0.1)
    assert len(top) == 4
    assert len(edges_in_region(cube, lambda points: np.linalg.norm(points - 1, axis=1) <= 1.1)) == 1
    assert len(edges_in_region(cube, lambda points: points[:, 0] > 0)) == 4
    with pytest.raises(UsageError, match="returned shape"):
        edges_in_region(cube, lambda points: points > 0)


def test_p35_thresholds_may_be_functions_over_the_surface(menagerie: dict[str, PolygonMesh]) -> None:
    def finer_above(mesh):  # type: ignore[no-untyped-def]
        return np.where(mesh.vertices[:, 1] > 1, 0.15, 0.5)

    resampler = PolyhedralResampler(menagerie["cube"], Thresholds(finer_above))
    for _ in range(6):
        report = resampler.resample()
    mesh = resampler.mesh
    height = mesh.vertices[mesh.corners[mesh.offsets[:-1]], 1]
    assert report.longest <= 0.5
    assert mesh.areas[height > 1.5].mean() < 0.3 * mesh.areas[height < 0.5].mean()
    assert validate(mesh).require(closed=True).euler == 2
