"""Sub-steps that each point halves for itself: by their error, and by the way that they go."""

from __future__ import annotations

import json
import math
from collections.abc import Callable

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.flow import (
    Flow,
    Function,
    Reversed,
    Sequence,
    Streamlines,
    Sum,
    VelocityField,
    checked_displacement,
    keyed,
)
from flowsculpt.pipeline.flow.catalogue.basic import ABC, Rotation, Strain, Translation
from flowsculpt.pipeline.flow.catalogue.deformations import Twist
from flowsculpt.pipeline.flow.catalogue.lorenz import Lorenz
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.flow.composition import Mirror, Placed, RegionField, Transform, Within
from flowsculpt.pipeline.flow.flow_map import FlowMap, FrameStep
from flowsculpt.pipeline.flow.regions import SphereRegion
from flowsculpt.pipeline.flow.streamlines import MAX_SUBSTEPS, StepPlan

DT = 1 / 24
SWIRL = Sum((Vortex(radius=0.3, strength=keyed((0.0, 1.0), (0.0, 6.0))), Strain(rate=0.7)))
FIELDS: dict[str, VelocityField] = {
    "swirl": SWIRL,
    "lorenz": Lorenz(time_scale=0.3),
    "abc": ABC(),
}
each_field = pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)
TOLERANT = Streamlines(SWIRL, tolerance=1e-6)


@pytest.fixture
def points() -> Points:
    return 0.5 * np.random.default_rng(2).normal(size=(300, 3))


def zonneveld(
    velocity: Callable[[Points, float], Points], x: Points, t: float, h: float
) -> tuple[Points, Points]:
    """A step of points (N, 3) by the method of order 4, and by its companion of order 3."""
    k1 = velocity(x, t)
    k2 = velocity(x + h / 2 * k1, t + h / 2)
    k3 = velocity(x + h / 2 * k2, t + h / 2)
    k4 = velocity(x + h * k3, t + h)
    k5 = velocity(x + h * (5 * k1 + 7 * k2 + 13 * k3 - k4) / 32, t + 3 * h / 4)
    third = x + h * (-k1 / 2 + 7 / 3 * k2 + 7 / 3 * k3 + 13 / 6 * k4 - 16 / 3 * k5)
    return x + h * (k1 + 2 * k2 + 2 * k3 + k4) / 6, third


def by_turns(field: VelocityField, place: Points, time: float, dt: float, tolerance: float) -> Points:
    """A point (1, 3) through a step that is one sub-step, if not halved: a readable twin of the kernel."""
    at, halved = 0.0, 0
    while at < 1.0:
        while (at * 2**halved) % 1.0:
            halved += 1
        h = dt / 2**halved
        better, worse = zonneveld(field.velocity, place, time + at * dt, h)
        error, more = float(np.linalg.norm(better - worse)), 0
        while error / 16**more > tolerance:
            more += 1
        if more:
            halved += more
            continue
        place, at = better, at + 0.5**halved
        if 32 * error <= tolerance:
            halved = max(halved - 1, 0)
    return place


@each_field
def test_the_orders_are_four_and_three(field: VelocityField, points: Points) -> None:
    exact = Streamlines(field, 2048).displace(points, 0.1, 0.4)
    theirs = {4: [], 3: []}
    for count in (32, 64):
        ours = Streamlines(field, count, tolerance=1e9).displace(points, 0.1, 0.4)
        np.testing.assert_allclose(ours, Streamlines(field, count).displace(points, 0.1, 0.4), atol=1e-13)
        theirs[4].append(np.sqrt(np.mean((ours - exact) ** 2)))
        companion = points
        for i in range(count):
            companion = zonneveld(field.velocity, companion, 0.1 + 0.4 * i / count, 0.4 / count)[1]
        theirs[3].append(np.sqrt(np.mean((companion - exact) ** 2)))
    for order, (coarse, fine) in theirs.items():
        assert math.log2(coarse / fine) == pytest.approx(order, abs=0.1)


@settings(max_examples=12, deadline=None)
@given(st.sampled_from(sorted(FIELDS)), st.integers(0, 1000), st.sampled_from([1e-4, 1e-6, 1e-8]))
def test_the_kernel_takes_the_substeps_of_its_readable_twin(name: str, seed: int, tolerance: float) -> None:
    points, field = 0.5 * np.random.default_rng(seed).normal(size=(4, 3)), FIELDS[name]
    moved = Streamlines(field, 1, tolerance=tolerance).displace(points, 0.2, 0.1)
    twins = [by_turns(field, point[None], 0.2, 0.1, tolerance)[0] for point in points]
    np.testing.assert_allclose(moved, twins, atol=1e-12)


@each_field
@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7, 1e-9])
def test_a_frame_errs_by_less_than_the_tolerance(
    field: VelocityField, tolerance: float, points: Points
) -> None:
    exact = Streamlines(field, 1000).displace(points, 0.1, DT)
    error = np.abs(Streamlines(field, tolerance=tolerance).displace(points, 0.1, DT) - exact).max()
    assert error <= tolerance + 1e-13


@each_field
def test_there_and_back_returns_within_the_tolerance(field: VelocityField, points: Points) -> None:
    flow = Streamlines(field, tolerance=1e-7)
    there = flow.displace(points, 0.0, 6 * DT)
    back = Reversed(flow, 6 * DT).displace(there, 0.0, 6 * DT)
    assert np.abs(there - points).max() > 0.01
    assert np.abs(back - points).max() < 1e-6


def test_calm_points_take_fewer_substeps_than_wild_ones(points: Points) -> None:
    """One vortex, near and far: of the near point the way is as exact, at more evaluations."""
    evaluations = []
    for radius in (0.05, 8.0):
        counted = [0]

        class Counted(Vortex):
            def velocity(self, points: Points, time: float, counted: list[int] = counted) -> Points:
                counted[0] += 1
                return Vortex.velocity(self, points, time)

        field = Counted(radius=0.05, strength=2.0)
        by_turns(field, np.array([[radius, 0.0, 0.0]]), 0.0, DT, 1e-7)
        evaluations.append(counted[0])
    assert evaluations[0] > 20 * evaluations[1]


LIMITED = [TOLERANT, Streamlines(SWIRL, max_step=0.004), Streamlines(SWIRL, tolerance=1e-7, max_step=0.01)]


@pytest.mark.parametrize("flow", LIMITED, ids=["tolerance", "max_step", "both"])
def test_a_points_bits_depend_on_no_block_and_no_thread(flow: Streamlines) -> None:
    many = np.random.default_rng(1).normal(size=(4007, 3))
    before = numba.get_num_threads()
    try:
        results = []
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            results.append(flow.displace(many, 0.3, DT))
    finally:
        numba.set_num_threads(before)
    assert results[0].tobytes() == results[1].tobytes()
    for first, last in ((0, 1), (13, 14), (250, 262), (255, 699)):
        assert flow.displace(many[first:last], 0.3, DT).tobytes() == results[0][first:last].tobytes()
    shuffled = np.random.default_rng(2).permutation(len(many))
    assert flow.displace(many[shuffled], 0.3, DT).tobytes() == results[0][shuffled].tobytes()


@settings(max_examples=15, deadline=None)
@given(st.lists(st.sampled_from(range(5)), min_size=1, max_size=3), st.integers(1, 6))
def test_a_carried_point_has_the_bits_of_a_vertex_moved_frame_by_frame(
    chosen: list[int], frames: int
) -> None:
    points = np.random.default_rng(3).normal(size=(57, 3))
    kinds: list[Flow] = [*LIMITED, Streamlines(Translation((3.0, 0.0, 1.0)), max_step=0.02), Twist()]
    flow, history = Sequence(tuple(kinds[i] for i in chosen)), FlowMap()
    moved = points
    for frame in range(frames):
        history.add(FrameStep(flow, frame * DT, DT, frame + 2))
        moved = checked_displacement(flow, moved, frame * DT, DT, frame + 2)
    assert history.carry(points).tobytes() == moved.tobytes()


@settings(max_examples=6, deadline=None)
@given(st.floats(0.02, 0.2), st.integers(0, 100))
def test_no_substep_takes_a_point_further_than_the_maximum_step(max_step: float, seed: int) -> None:
    """The way of a frame, cut at the moments of the finest sub-steps that were needed, is no longer."""
    points = 0.6 * np.random.default_rng(seed).normal(size=(6, 3))
    flow = Streamlines(Rotation(axis=(0.0, 0.0, 1.0), speed=30.0), max_step=max_step)
    plan = flow.step_plan(0.0, DT, finest=True)
    moved = flow.displace(points, 0.0, DT)
    turned = 30.0 * DT
    exact = points @ np.array(
        [[math.cos(turned), math.sin(turned), 0], [-math.sin(turned), math.cos(turned), 0], [0, 0, 1]]
    )
    np.testing.assert_allclose(moved, exact, atol=1e-5)
    assert plan.halved and len(plan.spans) == 13
    for point, end in zip(points, moved, strict=True):
        each = _advanced_alone(point, max_step)
        np.testing.assert_allclose(each, end, atol=1e-12)


def _advanced_alone(point: Points, max_step: float) -> Points:
    """Take the 13 sub-steps of the gradient bound, each halved alike while one exceeds the maximum step."""
    field = Rotation(axis=(0.0, 0.0, 1.0), speed=30.0)
    here = point[None]
    for _ in range(13):
        halvings = 0
        while True:
            h, place, furthest = DT / 13 / 2**halvings, here, 0.0
            for _ in range(2**halvings):
                after = zonneveld(field.velocity, place, 0.0, h)[0]
                furthest = max(furthest, float(np.linalg.norm(after - place)))
                place = after
            if furthest <= max_step:
                break
            halvings += 1
        here = place
    return here[0]


def test_a_maximum_step_that_nothing_exceeds_changes_no_bit(points: Points) -> None:
    for flow in (Streamlines(SWIRL), Streamlines(Translation((0.1, 0.2, 0.3)))):
        free = flow.displace(points, 0.3, DT)
        assert flow.with_max_step(10.0).displace(points, 0.3, DT).tobytes() == free.tobytes()
        assert flow.with_max_step(0.001).displace(points, 0.3, DT).tobytes() != free.tobytes()


def test_compositions_hand_the_maximum_step_on() -> None:
    inner = Streamlines(SWIRL)
    ball = SphereRegion(centre=(0.0, 0.0, 0.0), radius=1.0)
    for flow in (
        Sequence((inner,)),
        Reversed(inner, 1.0),
        Placed(inner, Mirror()),
        Within(inner, ball),
        Placed(inner, Transform(scale=2.0)),
    ):
        assert flow.with_max_step(0.01).cache_data(0.3, DT) != flow.cache_data(0.3, DT)
    scaled = Placed(inner, Transform(scale=2.0)).with_max_step(0.02).cache_data(0.3, DT)
    assert scaled["flow"] == inner.with_max_step(0.01).cache_data(0.3, DT)
    function = Function(lambda points, time, dt: points)
    assert function.with_max_step(0.1) is function


def test_a_key_within_a_frame_is_in_the_data_of_an_adaptive_step() -> None:
    """An adaptive step samples times that a fixed plan skips: values there decide keys too."""

    def flow(height: float) -> Streamlines:
        peak = keyed((0.0, 0.3 * DT, 0.4 * DT, DT), (1.0, 1.0, height, 1.0), "linear")
        return Streamlines(Vortex(strength=peak), substeps=1, tolerance=1e-6)

    points = np.array([[0.3, 0.0, 0.0]])
    assert flow(1.0).displace(points, 0.0, DT).tobytes() != flow(9.0).displace(points, 0.0, DT).tobytes()
    assert flow(1.0).cache_data(0.0, DT) != flow(9.0).cache_data(0.0, DT)
    data = flow(9.0).cache_data(0.0, DT)
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    still = Streamlines(Vortex(), tolerance=1e-6)
    assert (
        still.cache_data(0.0, DT)
        == still.cache_data(0.5, DT)
        != Streamlines(Vortex(), tolerance=1e-5).cache_data(0.0, DT)
    )


def test_a_tolerance_out_of_reach_is_told_with_the_place() -> None:
    sharp = RegionField(Translation((0.0, 100.0, 0.0)), SphereRegion(radius=0.5))
    points = np.array([[0.1, 0.0, 0.0]])
    crossing = Streamlines(Sum((sharp, Translation((5.0, 0.0, 0.0)))), tolerance=1e-12)
    away, drift = np.array([[0.6, 0.0, 0.0]]), np.array([5.0 * DT, 0.0, 0.0])
    np.testing.assert_allclose(crossing.displace(away, 0.0, DT), away + drift, atol=1e-13)
    with pytest.raises(
        FrameError,
        match=r"^frame 9: flow .* at 0 s needs more than 10000 sub-steps a frame to move the point at "
        r"\(0\.4, 0, 0\.1\) with at most an error of 1e-12 units.*raise tol",
    ):
        checked_displacement(crossing, np.array([[0.4, 0.0, 0.1]]), 0.0, DT, 9)
    with pytest.raises(
        FrameError, match=r"more than 10000 sub-steps a frame .* at most a step of 1e-06 units.*max_step"
    ):
        Streamlines(Translation((50.0, 0.0, 0.0)), max_step=1e-6).displace(points, 0.0, DT)
    assert MAX_SUBSTEPS == 10_000


def test_courses_of_both_kinds_are_not_joined(points: Points, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    follow = StepPlan.follow
    monkeypatch.setattr(StepPlan, "follow", lambda self, *a: calls.append(self.halved) or follow(self, *a))
    history = FlowMap()
    for frame in range(4):
        history.add(FrameStep(Sequence((TOLERANT, Streamlines(Strain()))), frame * DT, DT, frame + 2))
    history.carry(0.01 * points)
    assert calls[:2] == [True, False]
