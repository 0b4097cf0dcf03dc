"""Flows as such: any callable, any points, and what happens when one fails."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.flow import Flow, Function, Sequence, Streamlines, Sum, as_flow, checked_displacement
from flowsculpt.pipeline.flow.catalogue.basic import Rotation, Translation
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.flow.composition import Blend, Within
from flowsculpt.pipeline.flow.regions import SphereRegion
from flowsculpt.pipeline.resample import Resampler, resample

POINTS = np.random.default_rng(5).normal(size=(40, 3))


def drift(points: Points, time: float, dt: float) -> Points:
    return points + np.array([dt, 0.0, time * dt])


def drift_in_place(points: Points, time: float, dt: float) -> Points:
    points += np.array([dt, 0.0, time * dt])
    return points


def replaced(composed: Flow, part: Flow, other: Flow) -> Flow:
    """A composition with another part in the place of one."""
    return type(composed)(
        **{name: other if value is part else value for name, value in vars(composed).items()}
    )


def test_any_callable_is_a_flow() -> None:
    """P1."""
    np.testing.assert_array_equal(
        as_flow(drift).displace(POINTS, 2.0, 0.5), POINTS + np.array([0.5, 0.0, 1.0])
    )
    assert as_flow(Function(drift)).name == "drift"


def test_callables_compose_with_flows_of_the_catalogue() -> None:
    both = Sequence((as_flow(drift), Streamlines(Translation((0.0, 1.0, 0.0)))))
    np.testing.assert_allclose(both.displace(POINTS, 2.0, 0.5), POINTS + np.array([0.5, 0.5, 1.0]))


def test_the_resampler_is_told_nothing_of_the_flow() -> None:
    """P2."""
    for taker in (Resampler.__init__, resample):
        assert not {"flow", "time", "dt"} & set(inspect.signature(taker).parameters)


def test_particles_and_vertices_go_the_same_way() -> None:
    """P4: what happens to a point depends on no other point."""
    flow = Sequence((Streamlines(Sum((Vortex(), Rotation()))), as_flow(drift)))
    together = flow.displace(POINTS, 0.0, 0.3)
    for i in (0, 7, 39):
        np.testing.assert_array_equal(flow.displace(POINTS[i : i + 1], 0.0, 0.3)[0], together[i])


def test_no_points_are_fine() -> None:
    assert Streamlines(Vortex()).displace(np.empty((0, 3)), 0.0, 0.1).shape == (0, 3)


def test_a_flow_leaves_the_points_it_is_given_alone() -> None:
    before = POINTS.copy()
    Sequence((Streamlines(Vortex()), as_flow(drift))).displace(POINTS, 0.0, 0.3)
    np.testing.assert_array_equal(POINTS, before)


def test_a_callable_may_write_over_the_points_it_gets() -> None:
    """Composed with others, and undone, it moves points as one that returns new ones does."""
    flow, before = as_flow(drift_in_place), POINTS.copy()
    half = SphereRegion(radius=0.8, falloff=1.0)
    for composed in (Blend(Sequence(()), flow, 0.25), Blend(flow, as_flow(drift), 0.5), Within(flow, half)):
        same = replaced(composed, flow, as_flow(drift))
        for dt in (0.1, -0.1):
            moved = composed.displace(POINTS, 2.0, dt)
            np.testing.assert_array_equal(moved, same.displace(POINTS, 2.0, dt))
            assert np.abs(moved - POINTS).max() > 0.01
    np.testing.assert_array_equal(POINTS, before)


def test_the_order_of_a_sum_does_not_matter() -> None:
    a, b = Vortex(strength=3.0), Rotation(axis=(1.0, 0.0, 0.0))
    one, other = (Streamlines(Sum(s)).displace(POINTS, 0.0, 0.4) for s in ((a, b), (b, a)))
    np.testing.assert_allclose(one, other, atol=1e-14)


def test_a_sum_of_sums_is_one_sum() -> None:
    a, b, c = Vortex(), Rotation(), Translation((1.0, 0.0, 0.0))
    flat = Streamlines(Sum((a, b, c))).displace(POINTS, 0.0, 0.4)
    nested = Streamlines(Sum((Sum((a, b)), c))).displace(POINTS, 0.0, 0.4)
    np.testing.assert_array_equal(flat, nested)


def test_velocities_are_added() -> None:
    a, b = Vortex(strength=3.0), Rotation(axis=(1.0, 0.0, 0.0))
    added = a.velocity(POINTS, 0.0) + b.velocity(POINTS, 0.0)
    np.testing.assert_allclose(Sum((a, b)).velocity(POINTS, 0.0), added, atol=1e-15)


def test_the_order_of_a_sequence_matters() -> None:
    turn, shift = Streamlines(Rotation(speed=1.0), 50), Streamlines(Translation((1.0, 0.0, 0.0)))
    one, other = (Sequence(s).displace(POINTS, 0.0, 1.0) for s in ((turn, shift), (shift, turn)))
    np.testing.assert_allclose(one, turn.displace(POINTS, 0.0, 1.0) + np.array([1.0, 0.0, 0.0]))
    assert np.abs(one - other).max() > 0.1


def test_an_empty_sequence_moves_nothing() -> None:
    np.testing.assert_array_equal(Sequence(()).displace(POINTS, 0.0, 1.0), POINTS)


def test_equal_motion_has_equal_data_and_a_change_shows() -> None:
    flow, same, other = (Streamlines(Vortex(strength=s)) for s in (1.0, 1.0, 1.5))
    assert flow.cache_data(0.0, 0.1) == same.cache_data(0.0, 0.1) != other.cache_data(0.0, 0.1)


def explode(points: Points, time: float, dt: float) -> Points:
    moved = points.copy()
    moved[11:] = np.inf
    return moved


def lose_one(points: Points, time: float, dt: float) -> Points:
    return points[1:]


def stumble(points: Points, time: float, dt: float) -> Points:
    raise ZeroDivisionError("division by zero")


def test_an_exploding_flow_is_told_with_the_first_vertex_and_where_it_was() -> None:
    points = np.tile([0.5, -0.25, 2.0], (20, 1))
    with pytest.raises(FrameError) as told:
        checked_displacement(as_flow(explode), points, 0.0, 0.1, 7)
    assert str(told.value) == (
        "frame 7: flow explode moved vertex 11 from (0.5, -0.25, 2) to [inf, inf, inf]; points must "
        "stay finite. Lower the flow's strength, or raise substeps if it grows from frame to frame."
    )


def test_a_flow_that_loses_points_is_told() -> None:
    with pytest.raises(FrameError, match=r"frame 3: flow lose_one returned an array of shape \(39, 3\)"):
        checked_displacement(as_flow(lose_one), POINTS, 0.0, 0.1, 3)


def test_a_flow_that_raises_is_told() -> None:
    with pytest.raises(FrameError, match="frame 3: flow stumble raised ZeroDivisionError: division by zero"):
        checked_displacement(as_flow(stumble), POINTS, 0.0, 0.1, 3)


def test_in_a_sequence_the_guilty_flow_is_named() -> None:
    flow = Sequence((Streamlines(Vortex()), as_flow(explode)))
    with pytest.raises(FrameError, match="flow explode moved vertex 11"):
        checked_displacement(flow, POINTS, 0.0, 0.1, 3)
