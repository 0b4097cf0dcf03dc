"""Regions: who is inside, how the rim falls, and the same weights for maps and for velocity fields."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.flow import Streamlines, keyed
from flowsculpt.pipeline.flow.catalogue.basic import Translation
from flowsculpt.pipeline.flow.composition import RegionField
from flowsculpt.pipeline.flow.regions import (
    MAX_SLOPE,
    BoxRegion,
    CapsuleRegion,
    CylinderRegion,
    HalfSpaceRegion,
    Region,
    SphereRegion,
)

POINTS = np.random.default_rng(8).uniform(-2, 2, size=(700, 3))
AXIS = np.array([1.0, 2.0, -1.0]) / math.sqrt(6)
LINE = {"axis": (1.0, 2.0, -1.0), "centre": (0.1, 0.0, -0.2), "length": 1.5, "radius": 0.6}

REGIONS: list[Region] = [
    SphereRegion(centre=(0.2, 0.1, 0.0), radius=0.9, falloff=0.7),
    BoxRegion(centre=(0.1, -0.2, 0.0), size=(1.0, 2.0, 0.5), falloff=0.7),
    HalfSpaceRegion(centre=(0.0, 0.3, 0.0), normal=(0.0, 3.0, 4.0), falloff=0.7),
    CapsuleRegion(**LINE, falloff=0.7),
    CylinderRegion(**LINE, falloff=0.7),
]


def distance(region: Region, points: Points) -> Floats:
    """Return the distances of points from a region, zero inside."""
    p = points - np.array(region.centre)
    match region:
        case SphereRegion():
            return np.linalg.norm(p, axis=1) - region.radius
        case BoxRegion():
            nearest = np.clip(p, -np.array(region.size) / 2, np.array(region.size) / 2)
            return np.linalg.norm(p - nearest, axis=1)
        case HalfSpaceRegion():
            return p @ np.array([0.0, 0.6, 0.8])
    along = p @ AXIS
    on_line = np.clip(along, -0.75, 0.75)[:, None] * AXIS
    if isinstance(region, CapsuleRegion):
        return np.linalg.norm(p - on_line, axis=1) - 0.6
    across = p - along[:, None] * AXIS
    lengths = np.linalg.norm(across, axis=1, keepdims=True)
    nearest = on_line + across * np.minimum(1.0, 0.6 / lengths)
    return np.linalg.norm(p - nearest, axis=1)


@pytest.mark.parametrize("region", REGIONS, ids=lambda region: region.name)
def test_weights_are_one_inside_and_fall_to_nothing_over_the_falloff(region: Region) -> None:
    weights, t = region.weight(POINTS, 0.0), np.clip(distance(region, POINTS) / 0.7, 0, 1)
    np.testing.assert_allclose(weights, 1 - t**3 * (10 - 15 * t + 6 * t * t), atol=1e-12)
    assert (weights == 1).any() and (weights == 0).any() and ((weights > 0.2) & (weights < 0.8)).any()


@pytest.mark.parametrize("region", REGIONS, ids=lambda region: region.name)
@pytest.mark.parametrize("invert", [False, True])
def test_a_velocity_field_and_a_map_are_weighed_alike(region: Region, invert: bool) -> None:
    turned = type(region)(**{**vars(region), "invert": invert})
    velocity = RegionField(Translation((1.0, 0.0, -2.0)), turned).velocity(POINTS, 0.0)
    weights = turned.weight(POINTS, 0.0)
    np.testing.assert_allclose(velocity, weights[:, None] * [1.0, 0.0, -2.0], atol=1e-15)
    if invert:
        np.testing.assert_allclose(weights, 1 - region.weight(POINTS, 0.0), atol=1e-15)


@pytest.mark.parametrize("fall", list(MAX_SLOPE))
def test_the_way_down_is_as_it_is_called(fall: str) -> None:
    t = np.linspace(0, 1, 2001)
    points = np.column_stack([1 + 0.5 * t, 0 * t, 0 * t])
    weights = SphereRegion(radius=1.0, falloff=0.5, falloff_type=fall).weight(points, 0.0)  # type: ignore[arg-type]
    smooth = 1 - t**3 * (10 - 15 * t + 6 * t * t)
    expected = {"linear": 1 - t, "sine": (1 + np.cos(np.pi * t)) / 2, "smooth": smooth}[fall]
    np.testing.assert_allclose(weights, expected, atol=1e-12)
    steepest = np.abs(np.diff(weights)).max() * 2000
    assert steepest == pytest.approx(MAX_SLOPE[fall], rel=1e-4)  # type: ignore[index]


def test_without_a_falloff_a_region_ends_at_once() -> None:
    points = np.array([[0.999, 0, 0], [1.001, 0, 0]])
    assert SphereRegion(radius=1.0).weight(points, 0.0).tolist() == [1.0, 0.0]


def test_a_region_may_move_and_grow() -> None:
    region = SphereRegion(centre=keyed((0, 1), ((0.0, 0.0, 0.0), (4.0, 0.0, 0.0)), "linear"), radius=1.0)
    assert region.weight(np.array([[2.0, 0, 0]]), 0.5) == [1.0]
    assert region.weight(np.array([[2.0, 0, 0]]), 0.0) == [0.0]


def test_a_region_without_a_size_is_refused() -> None:
    with pytest.raises(UsageError, match=r"a box of the size \[1, 0, 1\] is empty"):
        BoxRegion(size=(1, 0, 1))
    with pytest.raises(FrameError, match=r"a sphere has the radius 0 at 0\.5 s and is empty"):
        SphereRegion(radius=keyed((0, 0.5), (1, 0))).weight(POINTS, 0.5)


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 699), st.integers(0, 690))
def test_a_weight_depends_on_no_other_point(many: int, first: int) -> None:
    for region in REGIONS:
        part = region.weight(POINTS[first : first + many], 0.0)
        assert part.tobytes() == region.weight(POINTS, 0.0)[first : first + many].tobytes()


def test_a_point_at_no_place_harms_no_other() -> None:
    bad = POINTS.copy()
    bad[[3, 40, 41]] = [(np.nan, 0.0, 0.0), (0.0, np.nan, 0.0), (0.0, 0.0, np.nan)]
    others = np.delete(np.arange(len(bad)), [3, 40, 41])
    for region in REGIONS:
        found = region.weight(bad, 0.0)
        assert found[others].tobytes() == region.weight(POINTS, 0.0)[others].tobytes()
        moved = Streamlines(RegionField(Translation((1.0, 0.0, 0.0)), region), 2).displace(bad, 0.0, 0.1)
        assert np.isfinite(moved[others]).all() and np.isnan(moved[[3, 40, 41]]).any(axis=1).all()
