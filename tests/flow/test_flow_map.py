"""Rest points carried through all frames at once arrive where vertices moved frame by frame arrive."""

from __future__ import annotations

import gc
import weakref
from typing import Any

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
    checked_displacement,
    keyed,
)
from flowsculpt.pipeline.flow import flow_map as module
from flowsculpt.pipeline.flow.catalogue.basic import Enright, Expansion, Rotation
from flowsculpt.pipeline.flow.catalogue.deformations import Shear, Stretch, Taper, Twist
from flowsculpt.pipeline.flow.catalogue.lorenz import Lorenz
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.flow.composition import RegionField
from flowsculpt.pipeline.flow.flow_map import FlowMap, FrameStep
from flowsculpt.pipeline.flow.regions import ClosedSurface, MeshRegion, _lookup
from flowsculpt.pipeline.flow.streamlines import StepPlan
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.plugins.fields.attraction import Attraction, Target

DT = 1 / 24
AMOUNT = keyed((0.0, 0.6), (1.0, 1.4))

FLOWS: list[Flow] = [
    Streamlines(Lorenz(scale=16.0, time_scale=keyed((0.0, 0.5), (0.1, 0.3)))),
    Streamlines(Sum((Vortex(radius=0.4, strength=AMOUNT), Expansion(rate=0.4)))),
    Streamlines(Enright(period=0.5), substeps=3),
    Streamlines(Sum(())),
    Twist(amount=AMOUNT),
    Stretch(amount=AMOUNT),
    Taper(amount=AMOUNT),
    Shear(amount=AMOUNT),
    Reversed(Sequence((Streamlines(Vortex(strength=AMOUNT)), Twist(amount=AMOUNT))), 0.5),
    Function(lambda points, time, dt: points + dt * np.sin(points[:, ::-1] + time)),
]


@pytest.fixture
def points() -> Points:
    return np.random.default_rng(3).normal(size=(57, 3))


def flow_map_of(flow: Flow, frames: int) -> FlowMap:
    flow_map = FlowMap()
    for frame in range(frames):
        flow_map.add(FrameStep(flow, frame * DT, DT, frame + 2))
    return flow_map


def frame_by_frame(flow: Flow, points: Points, frames: int) -> Points:
    for frame in range(frames):
        points = checked_displacement(flow, points, frame * DT, DT, frame + 2)
    return points


@settings(max_examples=40, deadline=None)
@given(st.lists(st.sampled_from(range(len(FLOWS))), max_size=4), st.integers(0, 9))
def test_a_carried_point_has_the_bits_of_a_vertex_moved_frame_by_frame(
    chosen: list[int], frames: int
) -> None:
    points = np.random.default_rng(3).normal(size=(57, 3))
    flow = Sequence(tuple(FLOWS[i] for i in chosen))
    carried = flow_map_of(flow, frames).carry(points)
    assert carried.tobytes() == frame_by_frame(flow, points, frames).tobytes()


@pytest.mark.parametrize("flow", FLOWS, ids=lambda flow: flow.name)
def test_it_grows_by_a_frame_at_a_time(flow: Flow, points: Points) -> None:
    flow_map, moved = FlowMap(), points
    for frame in range(4):
        assert flow_map.carry(points).tobytes() == moved.tobytes()
        flow_map.add(FrameStep(flow, frame * DT, DT, frame + 2))
        moved = checked_displacement(flow, moved, frame * DT, DT, frame + 2)


def test_streamlines_of_many_frames_are_one_call(points: Points, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where two different fields act in turn; and the size of a call is bounded."""
    calls = []
    follow = StepPlan.follow
    monkeypatch.setattr(
        StepPlan, "follow", lambda self, *a: calls.append(len(self.tables)) or follow(self, *a)
    )
    flow = Sequence((FLOWS[0], FLOWS[1]))
    whole = flow_map_of(flow, 12).carry(points)
    assert len(calls) == 1
    monkeypatch.setattr(module, "LARGEST_STEP_PLAN", calls.pop() // 5)
    again = flow_map_of(flow, 12).carry(points)
    assert 5 <= len(calls) <= 9 and max(calls) <= module.LARGEST_STEP_PLAN
    assert again.tobytes() == whole.tobytes()


def test_what_a_step_plan_reads_lives_as_long_as_the_plan(points: Points) -> None:
    """Fields, and regions, that are gone when it is followed, and their memory filled by others."""

    def flows() -> tuple[Streamlines, Streamlines]:
        region = MeshRegion(ClosedSurface.of(icosphere(8)), falloff=0.5)
        pull = Attraction(Target.points(np.random.default_rng(1).normal(size=(5000, 3))), 2.0, 3.0)
        return Streamlines(Sum((pull, Vortex())), 2), Streamlines(RegionField(Rotation(), region), 2)

    one, other = flows()
    expected = other.displace(one.displace(points, 0.0, DT), 0.0, DT)
    del one, other
    gone: list[weakref.ref[Any]] = []

    def step_plan() -> StepPlan:
        made = flows()
        gone.extend(weakref.ref(flow) for flow in made)
        return StepPlan.joined([flow.step_plan(0.0, DT) for flow in made])

    joined = step_plan()
    _lookup.cache_clear()  # which holds the surface's memory too
    gc.collect()
    assert [known() for known in gone] == [None, None]
    overwritten = [np.full(shape, np.nan) for shape in (64_003, 45_000, 85_000, 90_000) for _ in range(5)]
    assert joined.follow(points).tobytes() == expected.tobytes()
    assert len(joined.owners) == 2 and overwritten


def test_points_given_stay_as_they_are(points: Points) -> None:
    before = points.copy()
    flow_map = FlowMap()
    assert flow_map.carry(points) is not points
    flow_map_of(FLOWS[-1], 2).carry(points)
    np.testing.assert_array_equal(points, before)


def test_no_points_are_carried_to_no_points() -> None:
    assert flow_map_of(Sequence(tuple(FLOWS)), 2).carry(np.empty((0, 3))).shape == (0, 3)


def test_a_point_that_leaves_the_numbers_is_told_with_frame_flow_and_place() -> None:
    flow = Streamlines(Lorenz(scale=16.0, time_scale=5.0), substeps=1)
    points = np.array([[0.0, 0.0, 0.0], [1e5, 1e5, 1e5]])
    with pytest.raises(
        FrameError,
        match=r"^frame 7: on the way from the rest surface: frame \d: flow lorenz moved vertex 1 from",
    ) as told:
        flow_map_of(flow, 6).carry(points)
    assert told.value.frame == 7


def test_a_user_flow_that_fails_is_told(points: Points) -> None:
    def fail(points: Points, time: float, dt: float) -> Points:
        raise ValueError("no wind")

    with pytest.raises(FrameError, match=r"^frame 4: .*fail raised ValueError: no wind"):
        flow_map_of(Function(fail), 3).carry(points)


def test_a_field_too_steep_to_follow_is_refused_when_its_frame_is_added() -> None:
    flow = Streamlines(Vortex(radius=1e-4, strength=keyed((0.0, 0.1), (0.0, 100.0), "linear")))
    flow_map = FlowMap()
    flow_map.add(FrameStep(flow, -DT, DT, 1))
    before = flow_map.carry(np.ones((1, 3)))
    with pytest.raises(FrameError, match=r"^frame 2: flow vortex at 0 s needs .* sub-steps"):
        flow_map.add(FrameStep(flow, 0.0, DT, 2))
    assert np.array_equal(flow_map.carry(np.ones((1, 3))), before)
