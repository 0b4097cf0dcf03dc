"""P33: in chaos the surface stays closed, oriented, manifold and finite, for hundreds of frames."""

import numpy as np

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.mesh import icosphere, validate
from flowsculpt.pipeline.resample import Resampler, Thresholds

FRAMES = 500


def lorenz(p: Points) -> Points:
    x, y, z = p.T
    return np.column_stack([10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z])


def advected(p: Points, dt: float) -> Points:
    """One step of the classical Runge-Kutta method."""
    a = lorenz(p)
    b = lorenz(p + dt / 2 * a)
    c = lorenz(p + dt / 2 * b)
    d = lorenz(p + dt * c)
    return p + dt / 6 * (a + 2 * b + 2 * c + d)


def test_five_hundred_frames_of_lorenz_keep_every_promise() -> None:
    thresholds = Thresholds(max_edge_length=0.6)
    resampler = Resampler(icosphere(20, 6.0, (3.0, 5.0, 22.0)), thresholds)
    edges = out = 0
    for frame in range(FRAMES):
        resampler.vertices[:] = advected(resampler.vertices, 1 / 960)
        report = resampler.resample()
        found = validate(resampler.mesh).require(closed=True, name=f"frame {frame}")
        assert found.euler == 2
        assert report.longest <= thresholds.max_edge_length
        assert sum(report.refused.values()) == report.too_short
        edges, out = edges + report.edges, out + report.too_short
    assert report.vertices > 4000, "the surface lives"
    assert out < 0.01 * edges
