"""Points are moved in an order of space, and come back in their own."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from flowsculpt.pipeline.flow import Streamlines
from flowsculpt.pipeline.mesh.meshes import morton_order
from flowsculpt.pipeline.plugins.fields.curl_noise import CurlNoise

pytestmark = pytest.mark.quick

POINTS = np.random.default_rng(7).normal(size=(3000, 3))


def test_neighbours_in_the_order_are_neighbours_in_space() -> None:
    order = morton_order(POINTS)
    assert sorted(order) == list(range(3000))
    steps = [np.linalg.norm(np.diff(points, axis=0), axis=1).mean() for points in (POINTS, POINTS[order])]
    assert steps[1] < 0.25 * steps[0]


@pytest.mark.parametrize(
    "points", [np.zeros((4, 3)), np.full((4, 3), np.nan), np.diag([np.inf, 0.0, 1e300]), np.zeros((1, 3))]
)
def test_points_without_an_order_of_space_keep_their_own(points: np.ndarray) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert list(morton_order(points)) == list(range(len(points)))


def test_a_flow_returns_points_in_the_order_in_which_they_came() -> None:
    flow, shuffled = Streamlines(CurlNoise()), np.random.default_rng(8).permutation(3000)
    moved = flow.displace(POINTS, 0.2, 1 / 24)
    assert flow.displace(POINTS[shuffled], 0.2, 1 / 24).tobytes() == moved[shuffled].tobytes()
    few = flow.displace(POINTS[:200], 0.2, 1 / 24)
    assert few.tobytes() == moved[:200].tobytes()
