"""Any polyhedron, however it is moved, stays sound, and within its length limits or with a reason."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.mesh import PolygonMesh, validate
from flowsculpt.pipeline.plugins.polyhedra.polyhedral_resampler import PolyhedralResampler
from flowsculpt.pipeline.plugins.polyhedra.polyhedron import Collapse, Cutting
from flowsculpt.pipeline.resample import Thresholds

KINDS = ["cube", "ell", "comb", "star", "drum", "ring", "open box", "leaf", "tetrahedron", "ball", "cloth"]


def moved(points: Points, rng: np.random.Generator, smooth: float, rough: float) -> Points:
    """A random linear map, a random wave, and noise of the size of `rough`."""
    waves = np.sin(points @ rng.normal(size=(3, 3)) * 2 + rng.uniform(0, 6, 3))
    linear = np.eye(3) + smooth * rng.normal(size=(3, 3))
    return points @ linear + smooth * waves + rough * rng.normal(size=points.shape)


def edge_lengths(mesh: PolygonMesh) -> Floats:
    """(E,) of every edge."""
    ends = mesh.vertices[mesh.edges]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


@pytest.mark.slow
@settings(max_examples=50, deadline=None)
@given(
    kind=st.sampled_from(KINDS),
    seed=st.integers(0, 2**32 - 1),
    smooth=st.floats(0, 0.6),
    rough=st.sampled_from([0.0, 0.0, 0.05, 0.3]),
    longest=st.floats(0.4, 1.5),
    ratio=st.floats(0, 0.49),
    hard_angle=st.floats(0.2, 3.1),
    cutting=st.sampled_from(["slice", "recurse"]),
    collapse=st.sampled_from(["edges", "edges", "areas"]),
)
def test_every_polyhedron_survives_every_motion(
    kind: str,
    seed: int,
    smooth: float,
    rough: float,
    longest: float,
    ratio: float,
    hard_angle: float,
    cutting: Cutting,
    collapse: Collapse,
    menagerie: dict[str, PolygonMesh],
) -> None:
    rng, before = np.random.default_rng(seed), validate(menagerie[kind]).require()
    thresholds = Thresholds(longest, ratio * longest, hard_angle, max_vertices=1_200)
    resampler = PolyhedralResampler(menagerie[kind], thresholds, cutting, collapse)
    for _ in range(3):
        resampler.vertices[:] = moved(resampler.vertices, rng, smooth, rough * longest)
        try:
            report = resampler.resample()
        except FrameError as error:
            assert "budget" in str(error)
            assert validate(resampler.mesh).require().euler == before.euler
            return
        after = validate(resampler.mesh).require()
        assert (after.euler, after.closed) == (before.euler, before.closed)
        lengths = edge_lengths(resampler.mesh)
        assert report.too_long == 0
        assert lengths.max() <= longest
        assert resampler.mesh.extents.max() <= longest
        assert sum(report.refused.values()) == report.too_short
        assert np.count_nonzero(lengths < ratio * longest * (1 - 1e-12)) == pytest.approx(
            report.too_short, abs=2
        )
        assert report.shortest == pytest.approx(lengths.min(), rel=1e-12)
        assert report.longest == pytest.approx(lengths.max(), rel=1e-12)
        assert validate(resampler.mesh.triangulated()).sound


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(kind=st.sampled_from(KINDS), seed=st.integers(0, 2**32 - 1))
def test_the_structure_kept_alive_is_the_one_built_anew(
    kind: str, seed: int, menagerie: dict[str, PolygonMesh]
) -> None:
    rng = np.random.default_rng(seed)
    resampler = PolyhedralResampler(menagerie[kind], Thresholds(0.5))
    for _ in range(3):
        resampler.vertices[:] = moved(resampler.vertices, rng, 0.2, 0.01)
        resampler.resample()
    anew = PolyhedralResampler(resampler.mesh, resampler.thresholds)
    motion = moved(resampler.vertices, rng, 0.2, 0.0)
    resampler.vertices[:] = motion
    anew.vertices[:] = motion
    assert resampler.resample() == anew.resample()
    assert resampler.mesh.vertices.tobytes() == anew.mesh.vertices.tobytes()
    assert np.array_equal(resampler.mesh.corners, anew.mesh.corners)


@pytest.mark.soak
def test_a_thousand_frames_leave_a_sound_surface(menagerie: dict[str, PolygonMesh]) -> None:
    rng = np.random.default_rng(1)
    resampler = PolyhedralResampler(menagerie["cube"], Thresholds(0.4, max_vertices=20_000))
    for frame in range(1000):
        x, y, z = resampler.vertices.T.copy()
        turn = 0.2 * rng.normal() * np.exp(-(x * x + y * y))
        resampler.vertices[:] = np.column_stack(
            [
                0.9 * (x * np.cos(turn) - y * np.sin(turn)) + 0.1 * np.tanh(x),
                0.9 * (x * np.sin(turn) + y * np.cos(turn)) + 0.1 * np.tanh(2 * y),
                0.9 * z + 0.15 * np.tanh(2 * z) + 0.05 * np.sin(3 * x + frame),
            ]
        )
        report = resampler.resample()
        found = validate(resampler.mesh).require(closed=True)
        assert (found.euler, report.too_long) == (2, 0)
