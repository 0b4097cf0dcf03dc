"""Long runs: thousands of frames and of random surfaces, each held to every promise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, rod, sheet, torus, validate
from flowsculpt.pipeline.resample import Chord, Curved, Exact, Placement, Report, Resampler, Thresholds

SUBJECTS = {
    "ball": icosphere(5),
    "cube": box(edge_length=0.5),
    "ring": torus(1.0, 0.3, 0.3),
    "bar": rod(2.0, 0.3, 0.25),
    "cloth": sheet((2, 2), 0.3),
}
PERIOD = 50  # frames: half of them there, half of them back, before another flow takes over


def stir(points: Points, seed: int, frame: int) -> Points:
    """One frame of one of four flows that take turns: there and back, or the surface would grow for ever.

    Errors that the way back leaves are kept from adding up: the flow also brings the surface to its size.
    """
    rng = np.random.default_rng((seed, frame // PERIOD))
    kind, centre, axis = rng.integers(4), rng.uniform(-0.7, 0.7, 3), int(rng.integers(3))
    within = frame % PERIOD
    ahead = 1 if within < PERIOD // 2 else -1
    away = points - centre
    near = np.exp(-np.einsum("ij,ij->i", away, away) / 0.5)[:, None]
    u, v = (axis + 1) % 3, (axis + 2) % 3
    step = np.zeros_like(points)
    if kind == 0:  # a vortex
        step[:, u], step[:, v] = -away[:, v], away[:, u]
        step *= 0.15 * near
    elif kind == 1:  # in along the axis and out across it
        step[:] = 0.045 * away
        step[:, axis] *= -2
        step *= near
    elif kind == 2:  # waves
        step[:, axis] = 0.06 * np.sin(3 * points[:, u] + min(within, PERIOD - 1 - within) / 7)
    else:  # contraction, then expansion
        step[:] = -0.06 * away * near
    moved: Points = points + ahead * step
    low, high = moved.min(axis=0), moved.max(axis=0)
    wanted = 1 + 0.02 * np.clip(2.0 / np.maximum(high - low, 1e-9) - 1, -1, 1)
    return (moved - (low + high) / 2) * wanted


def edge_lengths(mesh: TriangleMesh) -> Floats:
    ends = mesh.vertices[mesh.faces]
    return np.linalg.norm(np.roll(ends, -1, axis=1) - ends, axis=2).reshape(-1)


def holds(mesh: TriangleMesh, report: Report, longest: float, shortest: float, euler: int) -> None:
    """All that a frame promises of a surface."""
    found = validate(mesh).require()
    assert found.euler == euler
    lengths = edge_lengths(mesh)
    assert lengths.max() <= longest
    assert np.isclose(report.longest, lengths.max()) and np.isclose(report.shortest, lengths.min())
    assert (report.vertices, report.faces, report.edges) == (found.vertices, found.faces, found.edges)
    if found.closed:
        assert np.count_nonzero(lengths < shortest * (1 - 1e-12)) <= 2 * report.too_short


def run(placement: Placement, frames: int) -> Report:
    """Alternating flows on one ball, every promise looked at in every frame."""
    thresholds = Thresholds(0.25, max_vertices=40_000)
    resampler = Resampler(icosphere(8), thresholds, placement)
    for frame in range(frames):
        resampler.vertices[:] = stir(resampler.vertices, 7, frame)
        report = resampler.resample()
        assert report.too_long == 0, frame
        assert report.longest <= 0.25, frame
        assert report.too_short == sum(report.refused.values()), frame
        assert report.vertices - report.edges + report.faces == 2, frame
        validate(resampler.mesh).require(closed=True, name=f"frame {frame}")
        holds(resampler.mesh, report, 0.25, 0.1, 2)
    return report


@pytest.mark.parametrize("placement", [Chord(), Curved()], ids=["chord", "curved"])
def test_two_hundred_frames_of_alternating_flows_keep_every_promise(placement: Placement) -> None:
    assert run(placement, 200).vertices > 300


@pytest.mark.soak
@pytest.mark.parametrize("placement", [Chord(), Curved()], ids=["chord", "curved"])
def test_ten_thousand_frames_of_alternating_flows_keep_every_promise(placement: Placement) -> None:
    assert run(placement, 10_000).vertices > 300


def any_surface_any_operations(
    name: str,
    placement_name: str,
    seed: int,
    longest: float,
    ratio: float,
    hard: float,
    min_roundness: float,
    steps: int,
) -> None:
    """Move, resample, save and go on, tag and change thresholds, in a random order."""
    rng, subject = np.random.default_rng(seed), SUBJECTS[name]
    moves: list[tuple[Points, Floats]] = []

    def carry(points: Points) -> Points:
        for linear, phase in moves:
            points = points @ linear + 0.1 * np.sin(2 * points[:, [1, 2, 0]] + phase)
        return points

    placement = {"chord": Chord(), "curved": Curved(), "exact": Exact(carry)}[placement_name]
    before = validate(subject).require()
    thresholds = Thresholds(longest, ratio * longest, hard, max_vertices=6000)
    edges = np.sort(subject.faces[:, :2], axis=1)
    tagged = subject.with_creases(edges[rng.random(len(edges)) < rng.choice([0.0, 0.1])])
    resampler = Resampler(tagged, thresholds, placement, min_roundness)
    for _ in range(steps):
        moves.append((np.eye(3) + 0.25 * rng.normal(size=(3, 3)), rng.uniform(0, 6, 3)))
        linear, phase = moves[-1]
        points = resampler.vertices
        resampler.vertices[:] = points @ linear + 0.1 * np.sin(2 * points[:, [1, 2, 0]] + phase)
        if rng.random() < 0.2:
            resampler = Resampler.from_state(resampler.state(), thresholds, placement, min_roundness)
        if rng.random() < 0.2:
            longest *= rng.uniform(0.7, 1.4)
            thresholds = Thresholds(longest, ratio * longest, hard, max_vertices=6000)
            resampler.thresholds = thresholds
        try:
            report = resampler.resample()
        except FrameError as error:
            assert "budget" in str(error)
            validate(resampler.mesh).require()
            return
        assert report.too_long == 0
        assert report.too_short == sum(report.refused.values())
        holds(resampler.mesh, report, longest, ratio * longest, before.euler)


ANY = given(
    name=st.sampled_from(sorted(SUBJECTS)),
    placement_name=st.sampled_from(["chord", "curved", "exact"]),
    seed=st.integers(0, 2**32 - 1),
    longest=st.floats(0.3, 1.5),
    ratio=st.floats(0, 0.49),
    hard=st.floats(0.2, 3.1),
    min_roundness=st.sampled_from([0.0, 0.6, 0.85]),
    steps=st.integers(1, 5),
)
test_no_surface_and_no_operations_break_a_promise = settings(max_examples=60, deadline=None)(
    ANY(any_surface_any_operations)
)
test_ten_thousand_surfaces_and_their_operations_break_no_promise = pytest.mark.soak(
    settings(max_examples=10_000, deadline=None)(ANY(any_surface_any_operations))
)
