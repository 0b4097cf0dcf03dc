"""Claims of the paper about its resampler, one by one (numbers P… of the project's checklist)."""

import math

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh import TriangleMesh, box, dihedral_angles, icosphere, rod, sheet, validate
from flowsculpt.pipeline.resample import Report, Resampler, Thresholds, resample


def edge_lengths(mesh: TriangleMesh) -> Floats:
    """Return the length of every half-edge."""
    ends = mesh.vertices[mesh.faces]
    return np.linalg.norm(np.roll(ends, -1, axis=1) - ends, axis=2).reshape(-1)


def agrees(mesh: TriangleMesh, report: Report, thresholds: Thresholds) -> None:
    """The report tells the truth, no edge is too long, and every short one has a reason."""
    lengths = edge_lengths(mesh)
    assert report.too_long == 0
    assert lengths.max() <= thresholds.max_edge_length
    assert report.longest == pytest.approx(lengths.max())
    assert report.shortest == pytest.approx(lengths.min())
    assert sum(report.refused.values()) == report.too_short
    closed = validate(mesh).require()
    assert (report.vertices, report.faces, report.edges) == (closed.vertices, closed.faces, closed.edges)
    if closed.closed:
        assert np.count_nonzero(lengths < thresholds.min_edge_length) == 2 * report.too_short


def stirred(points: Floats) -> Floats:
    """Three shears after each other: keeps volume, stretches surfaces."""
    x, y, z = points.T
    x = x + 0.03 * np.sin(2 * y)
    y = y + 0.03 * np.sin(2 * z)
    return np.column_stack([x, y, z + 0.03 * np.sin(2 * x)])


def test_p8_p25_one_frame_that_stretches_manyfold_leaves_no_long_edge() -> None:
    ball = icosphere(8)
    thresholds = Thresholds(0.3)
    for stretch in ([40, 1, 1], [1, 25, 25], [0.01, 60, 0.1]):
        mesh, report = resample(ball.with_vertices(ball.vertices * stretch), thresholds)
        agrees(mesh, report, thresholds)
        assert validate(mesh).require(closed=True).euler == 2
        assert report.passes < 40


def test_p25_stretching_needs_about_as_many_vertices_as_the_new_area() -> None:
    """Longest first: a frame stretched at once is sampled hardly more densely than by small steps."""
    ball, thresholds = icosphere(12), Thresholds(0.15)
    at_once = resample(ball.with_vertices(ball.vertices * [1, 16, 1]), thresholds)[1]
    stepwise = Resampler(ball, thresholds)
    for _ in range(40):
        stepwise.vertices[:] *= [1, 16 ** (1 / 40), 1]
        last = stepwise.resample()
    assert at_once.vertices < 1.6 * last.vertices


def test_p9_p10_density_stays_constant_while_the_shape_flows() -> None:
    ball, thresholds = icosphere(16), Thresholds(0.12)
    resampler = Resampler(ball, thresholds)
    means, edges, out = [], 0, 0
    for _ in range(120):
        resampler.vertices[:] = stirred(resampler.vertices)
        report = resampler.resample()
        edges, out = edges + report.edges, out + report.too_short
        means.append(edge_lengths(resampler.mesh).mean() / thresholds.max_edge_length)
    agrees(resampler.mesh, report, thresholds)
    assert out < 0.01 * edges
    assert 0.5 < min(means) <= max(means) < 0.85
    assert report.vertices > 1.5 * len(ball.vertices), "the flow has stretched the surface"


def test_p12_the_default_minimum_is_forty_percent() -> None:
    assert Thresholds(0.5).min_edge_length == pytest.approx(0.2)
    assert Thresholds(0.5).hard_angle == pytest.approx(math.radians(40))


@pytest.mark.parametrize("ratio", [0.5, 0.6, 1.0])
def test_p13_a_minimum_of_half_the_maximum_is_refused(ratio: float) -> None:
    with pytest.raises(UsageError, match=rf"{ratio:.0%} of max_edge_length.*below 50%.*Try 0\.02"):
        Thresholds(0.05, 0.05 * ratio)


def test_p24_a_large_triangle_is_cut_by_its_edges_alone() -> None:
    mesh, report = resample(TriangleMesh([(0, 0, 0), (9, 0, 0), (0, 0, -9)], [(0, 1, 2)]), Thresholds(1.0))
    agrees(mesh, report, Thresholds(1.0))
    assert report.faces > 80


def test_p27_a_soft_edge_collapses_to_its_midpoint() -> None:
    ball = icosphere(4)
    a, b = ball.faces[40][:2]
    middle = (ball.vertices[a] + ball.vertices[b]) / 2
    pinched = np.array(ball.vertices)
    pinched[a] += 0.8 * (middle - pinched[a])
    pinched[b] += 0.8 * (middle - pinched[b])
    mesh, report = resample(ball.with_vertices(pinched), Thresholds(1.0, 0.15))
    assert report.collapses == 1
    assert np.linalg.norm(mesh.vertices - middle, axis=1).min() < 1e-12


def melted(hard_angle: float) -> TriangleMesh:
    """A cube breathing in and out: squeezed it loses vertices, grown again it gets new ones."""
    resampler = Resampler(box(edge_length=0.125), Thresholds(0.2, hard_angle=hard_angle))
    for _ in range(6):
        resampler.vertices[:] *= 0.5
        resampler.resample()
        resampler.vertices[:] *= 2.0
        resampler.resample()
    return resampler.mesh


def test_p28_p29_without_hard_edges_a_cube_melts_and_with_them_it_does_not() -> None:
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)

    def missed(mesh: TriangleMesh) -> float:
        return float(np.linalg.norm(mesh.vertices[:, None] - corners, axis=2).min(axis=0).max())

    kept, lost = melted(math.radians(40)), melted(math.pi)
    assert missed(kept) == 0
    assert missed(lost) > 0.1
    assert np.allclose(np.abs(kept.vertices).max(axis=1), 1), "every vertex is still on the cube"


def with_spike() -> TriangleMesh:
    """A ball with a spike: three short edges around its base, and three that are not short to its tip."""
    ball = icosphere(6)
    points, (a, b, c) = np.array(ball.vertices), ball.faces[0].tolist()
    middle = points[[a, b, c]].mean(axis=0)
    points[[a, b, c]] = middle + 0.1 * (points[[a, b, c]] - middle) / np.linalg.norm(points[b] - points[a])
    tip = len(points)
    return TriangleMesh(
        np.vstack([points, middle * 1.2]), [*ball.faces[1:].tolist(), (a, b, tip), (b, c, tip), (c, a, tip)]
    )


def test_p28_a_spike_does_not_keep_the_short_edges_of_its_base() -> None:
    spiked = with_spike()
    lengths = np.sort(edge_lengths(spiked))
    assert (lengths < 0.12).sum() == 6 and (lengths[6:] > 0.13).all(), "the base alone is short"
    blunt, report = resample(spiked, Thresholds(0.4, 0.12, math.pi), min_roundness=0.0)
    agrees(blunt, report, Thresholds(0.4, 0.12))
    assert report.too_short == 0
    assert np.linalg.norm(blunt.vertices, axis=1).max() < 1.06


def test_p30_a_spike_of_hard_edges_keeps_its_tip() -> None:
    spiked = with_spike()
    sharp, report = resample(spiked, Thresholds(0.4, 0.12, math.radians(40)), min_roundness=0.0)
    agrees(sharp, report, Thresholds(0.4, 0.12))
    assert (sharp.vertices == spiked.vertices[-1]).all(axis=1).any()


def test_p30_the_vertex_with_more_hard_edges_wins_and_keeps_its_position() -> None:
    """Beside the crease of a cube, a soft vertex joins it; along the crease, the corner stays."""
    cube = box(edge_length=0.5)
    points = np.array(cube.vertices)
    crease = int(np.flatnonzero((points == (1, 1, 0)).all(axis=1))[0])
    beside = int(np.flatnonzero((points == (0.5, 1, 0)).all(axis=1))[0])
    points[beside] = (0.95, 1, 0)
    mesh, report = resample(cube.with_vertices(points), Thresholds(1.2, 0.1))
    assert report.collapses == 1
    gone = {tuple(p) for p in points} - {tuple(p) for p in mesh.vertices}
    assert gone == {(0.95, 1.0, 0.0)}
    points = np.array(cube.vertices)
    points[crease] = (1, 1, 0.45)
    near = int(np.flatnonzero((points == (1, 1, 0.5)).all(axis=1))[0])
    points[near] = (1, 1, 0.95)
    mesh, report = resample(cube.with_vertices(points), Thresholds(1.2, 0.1))
    assert report.collapses == 1
    assert (mesh.vertices == (1, 1, 1)).all(axis=1).any()
    assert not (mesh.vertices == (1, 1, 0.95)).all(axis=1).any()


def test_two_creases_are_never_merged_across_the_surface_between_them() -> None:
    """A blade thinner than the minimum edge stays a blade."""
    blade = box((2.0, 2.0, 0.01), edge_length=0.2)
    mesh, report = resample(blade, Thresholds(0.4, 0.15))
    assert report.refused["feature"] > 0
    assert np.allclose(mesh.bounds, blade.bounds)
    assert validate(mesh).require(closed=True).euler == 2
    assert np.allclose(np.sort(np.unique(np.abs(mesh.vertices[:, 2]))), [0.005])


def test_p32_a_tendril_survives_as_a_tube_of_triangular_section() -> None:
    """A bar pulled out to twenty times its length, far thinner than the minimum, keeps all of it."""
    resampler = Resampler(rod(2.0, 0.3, 0.1), Thresholds(0.16))
    for _ in range(120):
        resampler.vertices[:] *= [20 ** (-0.5 / 120), 20 ** (1 / 120), 20 ** (-0.5 / 120)]
        report = resampler.resample()
        assert report.too_long == 0
    mesh = resampler.mesh
    assert validate(mesh).require(closed=True).euler == 2
    assert np.ptp(mesh.vertices[:, 1]) > 0.97 * 40
    ends = mesh.vertices[mesh.faces][:, :, 1]
    through = [
        np.count_nonzero((ends.min(axis=1) < y) & (ends.max(axis=1) >= y)) for y in np.linspace(-19, 19, 77)
    ]
    assert min(through) >= 3, "at every height there is a tube"
    assert report.refused, "what is kept against the minimum is counted"


def test_p32_a_tube_of_triangular_section_keeps_its_length() -> None:
    turn = 2 * math.pi * np.arange(3) / 3
    rings = [
        np.column_stack([0.02 * np.cos(turn), np.full(3, y), 0.02 * np.sin(turn)])
        for y in np.arange(0, 3, 0.1)
    ]
    points = np.concatenate(rings)
    faces = [(0, 1, 2)]
    for base in range(0, len(points) - 3, 3):
        for i in range(3):
            a, b = base + i, base + (i + 1) % 3
            faces += [(a, a + 3, b), (b, a + 3, b + 3)]
    n = len(points)
    faces.append((n - 1, n - 2, n - 3))
    tube = TriangleMesh(points, faces)
    assert (dihedral_angles(tube) > math.radians(40)).any()
    mesh, report = resample(tube, Thresholds(0.5))
    assert report.collapses > 0
    assert np.ptp(mesh.vertices[:, 1]) == pytest.approx(2.9)
    assert validate(mesh).require(closed=True).euler == 2


def test_boundaries_are_kept_and_corners_stay() -> None:
    flat = sheet((2, 2), 0.1)
    thresholds = Thresholds(0.5)
    mesh, report = resample(flat, thresholds)
    agrees(mesh, report, thresholds)
    assert np.allclose(mesh.bounds, flat.bounds)
    assert validate(mesh).require().euler == 1
    area = np.linalg.norm(
        np.cross(*(mesh.vertices[mesh.faces[:, i]] - mesh.vertices[mesh.faces[:, 0]] for i in (1, 2))), axis=1
    )
    assert area.sum() / 2 == pytest.approx(4)
