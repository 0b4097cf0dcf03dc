"""Tidying in parts: whatever the number of threads the same bits, and nothing between parts is touched."""

from collections.abc import Callable

import numba
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.arrays import AnyArray, Floats, Points
from pipeline.mesh import HalfedgeMesh, icosphere, require, sheet, torus
from pipeline.mesh._kernels_halfedge import Surface
from pipeline.resample import Chord, Exact, Placement, Resampler, Thresholds, frame, parts
from pipeline.resample._kernels_lists import Changes
from pipeline.resample._kernels_parts import PARTS, Shares, tidy_parts

SURFACES = {"ball": icosphere(12), "ring": torus(1.0, 0.3, 0.12), "cloth": sheet((2, 2), 0.1)}
TIDIED = parts.tidied_in_parts


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """What the parts of surfaces of any size have collapsed and flipped, since all are large for now."""
    done = []

    def told(*arguments: object) -> tuple[int, int]:
        done.append(TIDIED(*arguments))  # type: ignore[arg-type]
        return done[-1]

    monkeypatch.setattr(parts, "WORTH_SHARING", 0)
    monkeypatch.setattr(parts, "_LEAST", 0)
    monkeypatch.setattr(frame, "tidied_in_parts", told)
    return done


def stirred(points: Points, turn: float) -> Points:
    x, y, z = points.T
    angle = turn * np.exp(-2 * ((x - 0.4) ** 2 + y * y))
    return np.column_stack([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z])


def film(placement: Callable[[float], Placement]) -> list[bytes]:
    resampler, bits = Resampler(icosphere(25), Thresholds(0.075), placement(0.0)), []
    for step in range(1, 5):
        resampler.placement = placement(0.5 * step)
        resampler.vertices[:] = stirred(resampler.vertices, 0.5)
        resampler.resample()
        bits += [values.tobytes() for values in resampler.state().values()]
    return bits


def follow(turn: float) -> Callable[[Points], Points]:
    def carried(rest: Points) -> Points:
        now = rest
        for _ in range(round(turn / 0.5)):
            now = stirred(now, 0.5)
        return now

    return carried


PLACEMENTS: dict[str, Callable[[float], Placement]] = {
    "chord": lambda _: Chord(),
    "exact": lambda turn: Exact(follow(turn)),
}


@pytest.mark.parametrize("name", sorted(PLACEMENTS))
def test_parts_give_the_same_bits_whatever_the_number_of_threads(
    name: str, calls: list[tuple[int, int]]
) -> None:
    before, films = numba.get_num_threads(), []
    try:
        for threads in sorted({1, min(2, numba.config.NUMBA_NUM_THREADS)}):
            numba.set_num_threads(threads)
            films.append(film(PLACEMENTS[name]))
    finally:
        numba.set_num_threads(before)
    assert all(bits == films[0] for bits in films)
    assert sum(collapses for collapses, _ in calls) > 100
    assert sum(flips for _, flips in calls) > 100


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(sorted(SURFACES)), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.1, 0.3]))
def test_a_surface_tidied_in_parts_is_sound_and_within_its_bracket_or_explained(
    calls: list[tuple[int, int]], name: str, seed: int, rough: float
) -> None:
    rng, before = np.random.default_rng(seed), require(SURFACES[name])
    longest = float(rng.uniform(0.15, 0.3))
    resampler = Resampler(SURFACES[name], Thresholds(longest, max_vertices=200_000))
    for _ in range(3):
        linear = np.eye(3) + 0.2 * rng.normal(size=(3, 3))
        noise = rough * longest * rng.normal(size=resampler.vertices.shape)
        resampler.vertices[:] = stirred(resampler.vertices @ linear, rng.uniform(-2, 2)) + noise
        report, after = resampler.resample(), require(resampler.mesh)
        assert (after.euler, after.closed) == (before.euler, before.closed)
        assert (report.vertices, report.faces, report.edges) == (after.vertices, after.faces, after.edges)
        assert report.too_long == 0
        assert sum(report.refused.values()) == report.too_short
        ends = resampler.mesh.vertices[resampler.mesh.faces]
        lengths = np.linalg.norm(np.roll(ends, -1, axis=1) - ends, axis=2)
        assert report.shortest == pytest.approx(lengths.min(), rel=1e-12)
        assert report.longest == pytest.approx(lengths.max(), rel=1e-12)
    assert np.array_equal(HalfedgeMesh(resampler.mesh).twins, resampler._mesh.twins)
    assert calls


def test_faces_across_planes_and_their_corners_are_left_alone_by_all_parts(
    calls: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What threads at work may read of one another must not change."""
    crossing = []

    def watched(
        surface: Surface,
        limits: Floats,
        planes: Floats,
        axis: int,
        changes: Changes,
        shares: Shares,
        counts: AnyArray,
    ) -> None:
        faces, points = surface.vert.reshape(-1, 3).copy(), surface.points.copy()
        part = np.searchsorted(planes[1:PARTS], points[faces, axis], side="right")
        across = (part != part[:, :1]).any(axis=1) & (faces >= 0).all(axis=1)
        tidy_parts(surface, limits, planes, axis, changes, shares, counts)
        assert np.array_equal(surface.vert.reshape(-1, 3)[across], faces[across])
        corners = np.unique(faces[across])
        assert np.array_equal(surface.points[corners], points[corners])
        crossing.append(np.count_nonzero(across))

    monkeypatch.setattr(parts, "tidy_parts", watched)
    for mesh in (SURFACES["ball"], icosphere(25)):
        resampler = Resampler(mesh, Thresholds(0.09))
        resampler.vertices[:] = stirred(resampler.vertices, 1.0)
        resampler.resample()
    assert min(crossing) > 50
    assert sum(collapses for collapses, _ in calls) > 50
