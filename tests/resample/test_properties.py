"""Any surface, however it is moved, stays sound, and within its length limits or with a reason."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, rod, sheet, torus, validate
from flowsculpt.pipeline.resample import Resampler, Thresholds

SURFACES = {
    "ball": icosphere(6),
    "cube": box(edge_length=0.4),
    "ring": torus(1.0, 0.3, 0.25),
    "bar": rod(2.0, 0.3, 0.2),
    "cloth": sheet((2, 2), 0.25),
    "triangle": TriangleMesh(np.eye(3), [(0, 1, 2)]),
    "tetrahedron": TriangleMesh(
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
    ),
}


def moved(points: Points, rng: np.random.Generator, smooth: float, rough: float) -> Points:
    """A random linear map, a random wave, and noise of the size of `rough`."""
    waves = np.sin(points @ rng.normal(size=(3, 3)) * 2 + rng.uniform(0, 6, 3))
    linear = np.eye(3) + smooth * rng.normal(size=(3, 3))
    return points @ linear + smooth * waves + rough * rng.normal(size=points.shape)


def edge_lengths(mesh: TriangleMesh) -> Floats:
    """Return the length of every half-edge."""
    ends = mesh.vertices[mesh.faces]
    return np.linalg.norm(np.roll(ends, -1, axis=1) - ends, axis=2).reshape(-1)


@settings(max_examples=50, deadline=None)
@given(
    name=st.sampled_from(sorted(SURFACES)),
    seed=st.integers(0, 2**32 - 1),
    smooth=st.floats(0, 0.6),
    rough=st.sampled_from([0.0, 0.0, 0.05, 0.3]),
    longest=st.floats(0.2, 1.5),
    ratio=st.floats(0, 0.49),
    hard_angle=st.floats(0.2, 3.1),
)
def test_every_surface_survives_every_motion(
    name: str, seed: int, smooth: float, rough: float, longest: float, ratio: float, hard_angle: float
) -> None:
    rng, before = np.random.default_rng(seed), validate(SURFACES[name]).require()
    thresholds = Thresholds(longest, ratio * longest, hard_angle, max_vertices=20_000)
    resampler = Resampler(SURFACES[name], thresholds)
    for _ in range(4):
        resampler.vertices[:] = moved(resampler.vertices, rng, smooth, rough * longest)
        try:
            report = resampler.resample()
        except FrameError as error:
            assert "budget" in str(error)
            assert validate(resampler.mesh).require().euler == before.euler
            return
        after = validate(resampler.mesh).require()
        assert (after.euler, after.closed) == (before.euler, before.closed)
        assert report.too_long == 0
        assert report.longest <= longest
        assert sum(report.refused.values()) == report.too_short
        assert (report.vertices, report.faces, report.edges) == (after.vertices, after.faces, after.edges)
        lengths = edge_lengths(resampler.mesh)
        assert report.shortest == pytest.approx(lengths.min(), rel=1e-12)
        assert report.longest == pytest.approx(lengths.max(), rel=1e-12)
        if after.closed:
            short = np.count_nonzero(lengths < thresholds.min_edge_length * (1 - 1e-12))
            assert short == pytest.approx(2 * report.too_short, abs=2)


@settings(max_examples=25, deadline=None)
@given(name=st.sampled_from(sorted(SURFACES)), seed=st.integers(0, 2**32 - 1))
def test_the_connectivity_kept_alive_is_the_one_built_anew(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    resampler = Resampler(SURFACES[name], Thresholds(0.3))
    for _ in range(3):
        resampler.vertices[:] = moved(resampler.vertices, rng, 0.3, 0.01)
        resampler.resample()
    anew = Resampler(resampler.mesh, resampler.thresholds)
    motion = moved(resampler.vertices, rng, 0.3, 0.0)
    resampler.vertices[:] = motion
    anew.vertices[:] = motion
    assert resampler.resample() == anew.resample()
    assert np.array_equal(resampler.mesh.vertices, anew.mesh.vertices)
    assert np.array_equal(resampler.mesh.faces, anew.mesh.faces)
