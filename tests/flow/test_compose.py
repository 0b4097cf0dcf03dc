"""The algebra of flows: its laws, for maps and for velocity fields."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.flow import (
    Blend,
    Flow,
    Mirror,
    Placed,
    Repeated,
    Reversed,
    Sequence,
    Streamlines,
    Sum,
    Transform,
    VelocityField,
    Within,
    as_flow,
    keyed,
)
from flowsculpt.pipeline.flow.catalogue.basic import Enright, Expansion, Rotation, Translation
from flowsculpt.pipeline.flow.catalogue.deformations import Shear, Twist
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.flow.composition import (
    RegionField,
    ScaledField,
    TransformedField,
    blended,
    placed,
    within,
)
from flowsculpt.pipeline.flow.regions import BoxRegion, CapsuleRegion, HalfSpaceRegion, Region, SphereRegion

POINTS = np.random.default_rng(4).uniform(-1, 1, size=(300, 3))
DT = 1 / 24

TWIST = Twist(amount=keyed((0.0, 1.0), (0.0, 1.0)))
SHEAR = Shear(amount=keyed((0.0, 1.0), (0.0, 0.8)))
SWIRL = Streamlines(Sum((Vortex(radius=0.5, strength=3.0), Expansion(rate=keyed((0.0, 1.0), (0.0, 1.0))))))
BALL = SphereRegion(centre=(0.3, 0.0, 0.0), radius=0.5, falloff=0.6)
TURNING = Transform(
    translate=keyed((0.0, 1.0), ((0.0, 0.0, 0.0), (1.0, 0.5, 0.0))),
    rotate=keyed((0.0, 1.0), ((0.0, 0.0, 0.0), (0.3, 1.0, -0.5))),
    scale=keyed((0.0, 1.0), (1.0, 1.5)),
)

MAPS: list[Flow] = [
    Within(TWIST, BALL),
    Blend(TWIST, SHEAR, keyed((0.0, 1.0), (0.0, 1.0))),
    Placed(TWIST, TURNING),
    Placed(TWIST, Mirror((1.0, 1.0, 0.0), (0.2, 0.0, 0.0))),
    Repeated(TWIST, 0.3),
    Sequence((TWIST, Within(SHEAR, BALL))),
    Within(Sequence((TWIST, Placed(SHEAR, Mirror()))), CapsuleRegion(radius=0.4, falloff=0.8)),
]
FIELDS: list[VelocityField] = [
    RegionField(Vortex(radius=0.5, strength=3.0), BALL),
    ScaledField(Rotation(), keyed((0.0, 1.0), (0.0, 1.0))),
    TransformedField(Vortex(radius=0.5, strength=3.0), TURNING),
    TransformedField(Vortex(radius=0.5, strength=3.0), Mirror((1.0, 1.0, 0.0), (0.2, 0.0, 0.0))),
    RegionField(
        Sum((TransformedField(Enright(period=2.0), TURNING), Rotation())),
        BoxRegion(size=(1, 1, 1), falloff=0.5),
    ),
]


def over(flow: Flow, points: Points, seconds: float, frames: int, start: float = 0.0) -> Points:
    for frame in range(frames):
        a, b = (start + seconds * n / frames for n in (frame, frame + 1))
        points = flow.displace(points, a, b - a)
    return points


@pytest.mark.parametrize("flow", MAPS, ids=lambda flow: flow.name)
def test_what_a_composition_of_maps_does_is_undone_to_the_last_digits(flow: Flow) -> None:
    """Forwards and backwards through 24 frames: back to 1e-12."""
    there = over(flow, POINTS, 1.0, 24)
    assert np.abs(there - POINTS).max() > 0.05
    np.testing.assert_allclose(over(flow, there, -1.0, 24, 1.0), POINTS, atol=1e-12)
    np.testing.assert_allclose(over(Reversed(flow, 1.0), there, 1.0, 24), POINTS, atol=1e-12)


@pytest.mark.parametrize("field", FIELDS, ids=lambda field: field.name)
def test_what_a_composition_of_fields_does_is_undone_to_a_millionth(field: VelocityField) -> None:
    flow = Streamlines(field)
    there = over(flow, POINTS, 1.0, 24)
    assert np.abs(there - POINTS).max() > 0.05
    np.testing.assert_allclose(over(flow, there, -1.0, 24, 1.0), POINTS, atol=1e-6)


IN_THE_RIM = HalfSpaceRegion(centre=(0.0, -3.0, 0.0), falloff=6.0)
SMOOTH = [field for field in FIELDS if not isinstance(field, RegionField)]


@pytest.mark.parametrize(
    "field", [*SMOOTH, RegionField(SWIRL.field, IN_THE_RIM)], ids=lambda field: field.name
)
def test_fields_composed_converge_with_order_four(field: VelocityField) -> None:
    """Also in a rim; at its ends, whose third derivatives jump, a few points lose a little."""
    ends = [Streamlines(field, n).displace(POINTS, 0.2, 0.8) for n in (20, 40, 80)]
    coarse, fine = (np.abs(a - b).max() for a, b in pairwise(ends))
    assert fine < 1e-13 or math.log2(coarse / fine) == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("field", FIELDS, ids=lambda field: field.name)
def test_no_velocity_gradient_is_steeper_than_is_said(field: VelocityField) -> None:
    near = np.random.default_rng(1).uniform(-1.5, 1.5, size=(4000, 3))
    h = 1e-5
    for time in (0.0, 0.4, 1.0):
        columns = [
            (field.velocity(near + h * e, time) - field.velocity(near - h * e, time)) / (2 * h)
            for e in np.eye(3)
        ]
        steepest = np.linalg.norm(np.stack(columns, axis=-1), ord=2, axis=(1, 2)).max()
        assert steepest <= field.gradient_bound(time) * (1 + 1e-6) + 1e-9


@pytest.mark.parametrize("flow", [TWIST, SWIRL, Sequence((TWIST, SWIRL))], ids=lambda flow: flow.name)
def test_a_mirror_of_a_mirror_and_a_frame_at_rest_change_nothing(flow: Flow) -> None:
    plain = flow.displace(POINTS, 0.1, 0.2)
    mirror = Mirror((1.0, 2.0, 0.0), (0.1, 0.0, 0.0))
    for same in (
        placed(placed(flow, mirror), mirror),
        placed(flow, Transform()),
        within(flow, HalfSpaceRegion(centre=(0.0, 9.0, 0.0))),
        blended(flow, Sequence(()), 0.0),
        blended(Sequence(()), flow, 1.0),
    ):
        np.testing.assert_allclose(same.displace(POINTS, 0.1, 0.2), plain, atol=1e-13)


@pytest.mark.parametrize(
    "frame", [TURNING, Transform(translate=(1.0, 2.0, 0.0), rotate=(0.4, 0.2, 1.0), scale=2.0)]
)
def test_a_field_in_a_frame_is_the_map_in_that_frame_to_the_order_of_a_step(frame: Transform) -> None:
    """For a frame at rest to the last digits: the method of Runge and Kutta does not care for coordinates."""
    as_field, as_map = (
        Streamlines(TransformedField(Rotation(), frame), 8),
        Placed(Streamlines(Rotation(), 8), frame),
    )
    tolerance = 1e-3 if frame is TURNING else 1e-13
    np.testing.assert_allclose(over(as_field, POINTS, 1.0, 24), over(as_map, POINTS, 1.0, 24), atol=tolerance)


def test_a_frame_scales_then_turns_then_moves() -> None:
    frame = Transform((1.0, 0.0, 0.0), (0.0, 0.0, math.pi / 2), 2.0)
    velocity = TransformedField(Translation((1.0, 0.0, 0.0)), frame).velocity(np.zeros((1, 3)), 0.0)
    np.testing.assert_allclose(velocity, [[0.0, 2.0, 0.0]], atol=1e-15)
    quarter = Placed(Twist(amount=keyed((0, 1), (0, 1), "linear")), Transform((0.0, 5.0, 0.0)))
    np.testing.assert_allclose(
        quarter.displace(np.array([[1.0, 5.0, 0.0]]), 0.0, 1.0), [[1.0, 5.0, 0.0]], atol=1e-15
    )


def test_what_turns_left_turns_right_in_the_mirror() -> None:
    seen = TransformedField(Rotation(axis=(0.0, 1.0, 0.0), speed=1.0), Mirror((1.0, 0.0, 0.0))).velocity(
        POINTS, 0.0
    )
    np.testing.assert_allclose(
        seen, Rotation(axis=(0.0, 1.0, 0.0), speed=-1.0).velocity(POINTS, 0.0), atol=1e-15
    )


def test_outside_of_a_region_nothing_moves_and_inside_everything_as_without_it() -> None:
    distance = np.linalg.norm(POINTS - [0.3, 0, 0], axis=1)
    inside, outside = distance < 0.5, distance > 1.1
    for flow in (TWIST, Streamlines(Translation((0.05, 0.0, 0.0)))):
        there = within(flow, BALL).displace(POINTS, 0.3, DT)
        np.testing.assert_array_equal(there[outside], POINTS[outside])
        if flow is TWIST:
            np.testing.assert_allclose(there[inside], flow.displace(POINTS, 0.3, DT)[inside], atol=1e-15)


def test_velocities_are_blended_where_there_are_any_and_ways_where_not() -> None:
    left, right = Streamlines(Translation((-1.0, 0.0, 0.0))), Streamlines(Translation((1.0, 0.0, 0.0)))
    weight = keyed((0.0, 1.0), (0.0, 1.0), "linear")
    both = blended(Sequence((left,)), right, weight)
    assert isinstance(both, Streamlines)
    np.testing.assert_allclose(both.displace(POINTS, 0.0, 1.0), POINTS, atol=1e-14)
    mixed = blended(left, TWIST, 0.25)
    assert isinstance(mixed, Blend)
    ways = [flow.displace(POINTS, 0.2, DT) - POINTS for flow in (left, TWIST)]
    np.testing.assert_allclose(
        mixed.displace(POINTS, 0.2, DT) - POINTS, 0.75 * ways[0] + 0.25 * ways[1], atol=1e-15
    )


@pytest.mark.parametrize("weight", [-0.1, 1.5, keyed((0.0, 1.0), (0.0, 1.0), "back_out")])
def test_a_weight_beyond_nought_and_one_is_refused(weight: object) -> None:
    with pytest.raises(FrameError, match=r"has the weight .*; a weight is from 0 to 1"):
        blended(Sequence(()), TWIST, weight).displace(POINTS, 0.7, DT)  # type: ignore[arg-type]


@settings(max_examples=30, deadline=None)
@given(period=st.floats(0.05, 2.0), start=st.floats(0, 3), dt=st.floats(-0.9, 0.9))
def test_rounds_are_the_same_wherever_steps_are_cut(period: float, start: float, dt: float) -> None:
    flow = Repeated(Twist(amount=keyed((0.0, 0.5, 2.0), (0.0, 1.0, -0.5))), period)
    middle = start + 0.4 * dt
    at_once = flow.displace(POINTS, start, dt)
    in_two = flow.displace(flow.displace(POINTS, start, middle - start), middle, start + dt - middle)
    np.testing.assert_allclose(in_two, at_once, atol=1e-8)
    np.testing.assert_allclose(flow.displace(at_once, start + dt, -dt), POINTS, atol=1e-8)


def test_each_round_adds_what_the_first_did() -> None:
    quarter = Twist(amount=keyed((0.0, 1.0), (0.0, math.pi / 2)))
    np.testing.assert_allclose(
        over(Repeated(quarter, 1.0), POINTS, 3.0, 72),
        Twist(amount=keyed((0.0, 1.0), (0.0, 1.5 * math.pi))).displace(POINTS, 0.0, 1.0),
        atol=1e-12,
    )


@pytest.mark.parametrize("period", [0.0, -1.0, math.inf, math.nan])
def test_a_period_that_is_none_is_refused(period: float) -> None:
    with pytest.raises(UsageError, match="it must be above 0"):
        Repeated(TWIST, period)


def test_rounds_without_number_are_refused() -> None:
    with pytest.raises(FrameError, match=r"goes through 4e[+]05 rounds in a frame; 1000 are the most"):
        Repeated(TWIST, 1e-7).displace(POINTS, 0.0, 0.04)


def test_a_fold_cannot_be_undone_and_is_told() -> None:
    fold = Within(as_flow(lambda points, time, dt: points + 3.0), SphereRegion(radius=0.2, falloff=0.1))
    with pytest.raises(FrameError, match=r"cannot be undone at .* widen its falloff"):
        fold.displace(np.array([[0.1, 0.0, 0.0]]), 1.0, -1.0)


@pytest.mark.parametrize("flow", [*MAPS, *map(Streamlines, FIELDS)], ids=lambda flow: flow.name)
def test_a_point_goes_its_way_whatever_the_others_do(flow: Flow) -> None:
    """To the bit, forwards and backwards."""
    for dt in (DT, -DT):
        together = flow.displace(POINTS, 0.5, dt)
        for part in (slice(0, 1), slice(7, 20), slice(150, 300)):
            assert flow.displace(POINTS[part], 0.5, dt).tobytes() == together[part].tobytes()


REGION: list[Region] = [
    SphereRegion(radius=0.5),
    SphereRegion(radius=0.6),
    SphereRegion(radius=0.5, invert=True),
    BoxRegion(),
]


def test_what_decides_the_motion_is_in_its_data_and_nothing_else() -> None:
    data = [within(flow, region).cache_data(0.1, DT) for flow in (TWIST, SWIRL) for region in REGION]
    assert all(a != b for i, a in enumerate(data) for b in data[:i])
    early, late = keyed((0.0, 0.5, 1.0), (0.0, 1.0, 0.2)), keyed((0.0, 0.5, 1.0), (0.0, 1.0, 0.7))
    for compose in (
        lambda w: blended(TWIST, SHEAR, w),
        lambda w: blended(Sequence(()), SWIRL, w),
        lambda w: within(SWIRL, SphereRegion(radius=0.3, falloff=w)),
        lambda w: placed(
            TWIST, Transform(translate=(0.0, 0.0, 0.0), scale=keyed((0.0, 1.0), (1.0, 1.0 + w.values[2][0])))
        ),
    ):
        one, other = compose(early), compose(late)
        assert one.cache_data(0.9, DT) != other.cache_data(0.9, DT)
    one, other = (blended(TWIST, SHEAR, w) for w in (early, late))
    assert one.cache_data(0.5 - DT, DT) == other.cache_data(0.5 - DT, DT)
