"""The frame loop: displace, resample, yield, go on."""

from __future__ import annotations

import dataclasses
import math
import pickle
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate, descent
from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.flow import Sequence, Streamlines, keyed
from flowsculpt.pipeline.flow.catalogue.deformations import Twist
from flowsculpt.pipeline.flow.catalogue.lorenz import Lorenz
from flowsculpt.pipeline.mesh import validate
from flowsculpt.pipeline.resample import Thresholds
from flowsculpt.pipeline.shot import Motion, Resampling, Solid, read_shot
from tests.animation.motions import EDGE, births, resampled


def test_the_first_frame_is_the_subject_at_rest(motion: Motion) -> None:
    first = next(animate(motion))
    assert first.number == 5
    np.testing.assert_allclose(first.mesh.bounds, [[-1.0] * 3, [1.0] * 3], atol=1e-15)


def test_every_frame_is_within_limits_and_a_closed_surface(motion: Motion) -> None:
    frames = list(animate(motion))
    assert [frame.number for frame in frames] == list(range(5, 25))
    for frame in frames:
        corners = frame.mesh.vertices[frame.mesh.faces]
        assert np.linalg.norm(corners - corners[:, (1, 2, 0)], axis=2).max() <= EDGE * (1 + 1e-12)
        assert validate(frame.mesh).closed
        assert frame.report.resampling is not None and frame.report.resampling.too_long == 0
    assert len(frames[-1].mesh.vertices) > 1.1 * len(frames[0].mesh.vertices)


def test_a_flow_that_fails_on_the_way_from_rest_is_told_with_its_frame(motion: Motion) -> None:
    """The vertices pass; a point of the surface between them does not."""

    def tear(points: Points, time: float, dt: float) -> Points:
        moved = points * (1 + 8 * dt)
        moved[np.abs(points[:, 0] - 0.25) < 0.02] = np.nan
        return moved

    even = dataclasses.replace(motion, subject=Solid.of("box", {"size": (2.0, 2.0, 1.9)}))
    even = resampled(even, thresholds=Thresholds(0.9), normals="geometric")
    with pytest.raises(
        FrameError, match=r"^frame \d+: ((?!frame \d).)*on the way from the rest surface: .*tear"
    ) as told:
        list(animate(even, flow=tear))
    assert told.value.frame is not None


def test_without_resampling_vertices_only_move(motion: Motion) -> None:
    still = dataclasses.replace(motion, resampling=None)
    frames = list(animate(still))
    assert all(np.array_equal(frame.mesh.faces, frames[0].mesh.faces) for frame in frames)
    assert frames[-1].report.resampling is None
    assert len(births(frames[-1])) == 0 and frames[-1].identities == len(frames[0].mesh.vertices)
    assert descent(frames).survives.all()
    points = frames[0].mesh.vertices
    for frame in range(6, 25):
        points = motion.flow.displace(points, *motion.clock.step(frame))
    np.testing.assert_allclose(frames[-1].mesh.vertices, points, atol=1e-12)


def test_a_keyed_twist_is_exact_at_every_frame(motion: Motion) -> None:
    amount = keyed((0.0, 0.7), (0.0, 1.0))
    twisted = dataclasses.replace(motion, resampling=None, flow=Sequence((Twist(amount=amount),)))
    rest, *frames = animate(twisted)
    x, y, z = rest.mesh.vertices.T
    for frame in frames:
        a = amount.at(motion.clock.time(frame.number))[0] * y
        closed = np.stack([x * np.cos(a) + z * np.sin(a), y, z * np.cos(a) - x * np.sin(a)], axis=1)
        np.testing.assert_allclose(frame.mesh.vertices, closed, atol=1e-12)


def test_an_error_in_a_later_block_names_the_vertex_of_the_surface(
    motion: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = next(animate(motion))

    def broken(points: Points, time: float, dt: float) -> Points:
        points[(points == first.mesh.vertices[100]).all(axis=1)] = np.nan
        return points

    monkeypatch.setattr("flowsculpt.pipeline.flow.flow_map.MOVED_TOGETHER", 32)
    with pytest.raises(FrameError, match="moved vertex 100 from"):
        list(animate(resampled(motion, placement="chord"), flow=broken))


def test_any_callable_may_take_the_flows_place(motion: Motion) -> None:
    """P1."""
    called = []

    def lift(points: Points, time: float, dt: float) -> Points:
        called.append((time, dt))
        return points + np.array([0.0, dt, 0.0])

    *_, last = animate(motion, flow=lift)
    assert last.mesh.bounds[:, 1] == pytest.approx([-1 + 19 / 24, 1 + 19 / 24])
    assert called[0][0] == 0.0 and called[-1][0] == pytest.approx(18 / 24)


def test_an_exploding_flow_stops_after_the_good_frames(motion: Motion) -> None:
    def explode(points: Points, time: float, dt: float) -> Points:
        return points * (np.nan if time > 0.1 else 1.0)

    good = []
    with pytest.raises(FrameError, match=r"frame 9: flow .*explode moved vertex 0 from \(") as told:
        for frame in animate(motion, flow=explode):
            good.append(frame.number)
    assert good == [5, 6, 7, 8] and told.value.exit_code == 1 and told.value.frame == 9


def test_a_surface_that_outgrows_its_budget_stops_with_the_frame(motion: Motion) -> None:
    tight = dataclasses.replace(
        motion, resampling=Resampling(Thresholds(max_edge_length=EDGE, max_vertices=1000))
    )
    last = 0
    with pytest.raises(FrameError, match=r"^frame \d+: (?!frame).*1000") as told:
        for frame in animate(tight, flow=lambda points, time, dt: points * 1.3):
            last = frame.number
    assert told.value.frame == last + 1


def test_a_threshold_far_too_fine_for_the_budget_stops_at_the_first_frame(motion: Motion) -> None:
    fine = Resampling(Thresholds(max_edge_length=1e-7, max_vertices=5000))
    with pytest.raises(FrameError, match=r"^frame 5: .*5000"):
        next(animate(dataclasses.replace(motion, subject=Solid.of("sheet", {}), resampling=fine)))


def test_an_error_that_knows_its_frame_says_so_once(motion: Motion) -> None:
    def give_up(points: Points, time: float, dt: float) -> Points:
        raise FrameError("the tide went out", 8)

    with pytest.raises(FrameError, match=r"^frame 8: the tide went out$") as told:
        list(animate(motion, flow=give_up))
    assert told.value.frame == 8
    copy = pickle.loads(pickle.dumps(told.value))
    assert (str(copy), copy.frame) == ("frame 8: the tide went out", 8)


def test_the_report_says_how_mesh_like_the_surface_is(motion: Motion) -> None:
    """P7: edges are much shorter than the whole, and neighbours nearly flat."""
    statistics = next(animate(motion)).report.statistics
    assert statistics.diameter == pytest.approx(2 * math.sqrt(3))
    assert statistics.area == pytest.approx(24.0)
    assert statistics.mean_edge < statistics.diameter / 15
    assert statistics.median_dihedral == pytest.approx(math.pi)


def test_lorenz_stays_a_closed_surface(motion: Motion) -> None:
    """P33."""
    flow = Streamlines(Lorenz(scale=16.0, time_scale=0.4))
    *_, last = animate(dataclasses.replace(motion, subject=Solid.of("icosphere", {})), flow=flow)
    assert validate(last.mesh).closed and np.isfinite(last.mesh.vertices).all()


@pytest.mark.soak
@pytest.mark.parametrize("name", ["A010_cube", "A020_lorenz", "A030_taffy"])
def test_the_films_shots_stay_framable(name: str) -> None:
    shot = read_shot(Path(__file__).parents[2] / "shots" / f"{name}.yaml")
    frames = list(animate(shot))
    assert 10_000 <= max(len(frame.mesh.vertices) for frame in frames) <= 60_000
    assert (
        max(np.ptp(f.mesh.vertices, axis=0).max() for f in frames)
        <= 3.6 * np.ptp(frames[0].mesh.vertices, axis=0).max()  # a ring that falls flat and spreads
    )
