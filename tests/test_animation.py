"""The frame loop: displace, resample, yield, go on."""

from __future__ import annotations

import dataclasses
import math
import pickle
from pathlib import Path

import numba
import numpy as np
import pytest

from pipeline.animation import MeshFrame, animate
from pipeline.arrays import Points
from pipeline.errors import FrameError, UsageError
from pipeline.flow import Sequence, Streamlines, Sum, keyed
from pipeline.flow.catalogue import Lorenz, Twist, Vortex
from pipeline.frames import FrameRange, FrameRate
from pipeline.mesh import TriangleMesh, validate
from pipeline.resample import Resampler, Thresholds
from pipeline.shot import Motion, Resampling, Solid, read_shot

EDGE = 0.25


@pytest.fixture
def motion() -> Motion:
    pair = Sum((Vortex(centre=(0.9, 0.0, 0.0), strength=3.0), Vortex(centre=(-0.9, 0.0, 0.0), strength=-3.0)))
    return Motion(
        frames=FrameRange.parse("5-24"),
        rate=FrameRate.of(24),
        subject=Solid.of("box", {}),
        flow=Sequence((Streamlines(pair), Twist(amount=keyed((0.0, 0.7), (0.0, 1.0))))),
        resampling=Resampling(Thresholds(max_edge_length=EDGE)),
    )


def same(one: MeshFrame, other: MeshFrame) -> bool:
    return (
        one.number == other.number
        and one.report == other.report
        and one.mesh.vertices.tobytes() == other.mesh.vertices.tobytes()
        and one.mesh.faces.tobytes() == other.mesh.faces.tobytes()
    )


def test_the_first_frame_is_the_subject_at_rest(motion: Motion) -> None:
    first = next(animate(motion))
    assert first.number == 5
    np.testing.assert_allclose(first.mesh.bounds, [[-1.0] * 3, [1.0] * 3], atol=1e-15)


def test_every_frame_is_in_the_bracket_and_a_closed_surface(motion: Motion) -> None:
    frames = list(animate(motion))
    assert [frame.number for frame in frames] == list(range(5, 25))
    for frame in frames:
        corners = frame.mesh.vertices[frame.mesh.faces]
        assert np.linalg.norm(corners - corners[:, (1, 2, 0)], axis=2).max() <= EDGE * (1 + 1e-12)
        assert validate(frame.mesh).closed
        assert frame.report.resampling is not None and frame.report.resampling.too_long == 0
    assert len(frames[-1].mesh.vertices) > 1.1 * len(frames[0].mesh.vertices)


def test_going_on_from_any_frame_gives_the_same_bits_as_never_stopping(motion: Motion) -> None:
    through = list(animate(motion))
    for stop in (0, 3, 6, 11, 14, 18):
        stored = MeshFrame.from_arrays(through[stop].to_arrays())
        rest = list(animate(motion, resume=stored))
        assert len(rest) == len(through) - stop - 1
        assert all(same(a, b) for a, b in zip(rest, through[stop + 1 :], strict=True))


def test_a_resampler_is_resumed_from_what_a_frame_holds(motion: Motion) -> None:
    """The frame's arrays are the resampler's whole state, under the names that it takes them by."""
    *_, last = animate(motion)
    tags = {"heat": np.arange(float(len(last.mesh.vertices)))}
    mesh = TriangleMesh(last.mesh.vertices, last.mesh.faces, tags)
    assert motion.resampling is not None
    assert set(Resampler(mesh, motion.resampling.thresholds).state()) == {
        "vertices",
        "faces",
        "attribute.heat",
    }
    tagged = dataclasses.replace(last, number=20, mesh=mesh)
    assert "heat" in next(animate(motion, resume=tagged)).mesh.attributes


def test_nothing_is_left_to_do_after_the_last_frame(motion: Motion) -> None:
    *_, last = animate(motion)
    assert list(animate(motion, resume=last)) == []


def test_the_number_of_threads_changes_no_bit(motion: Motion) -> None:
    before, runs = numba.get_num_threads(), []
    try:
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            runs.append(list(animate(motion)))
    finally:
        numba.set_num_threads(before)
    assert all(same(a, b) for a, b in zip(*runs, strict=True))


def test_a_frame_survives_a_file(motion: Motion, tmp_path: Path) -> None:
    *_, last = animate(motion)
    tagged = dataclasses.replace(
        last, mesh=TriangleMesh(last.mesh.vertices, last.mesh.faces, {"heat": last.mesh.vertices[:, 0]})
    )
    np.savez(tmp_path / "f.npz", **tagged.to_arrays())  # type: ignore[arg-type]
    with np.load(tmp_path / "f.npz", allow_pickle=False) as arrays:
        assert arrays["vertices"].dtype == np.float64 and arrays["faces"].dtype == np.int32
        back = MeshFrame.from_arrays(arrays)
    assert same(back, tagged)
    np.testing.assert_array_equal(back.mesh.attributes["heat"], tagged.mesh.attributes["heat"])


def test_arrays_that_are_no_frame_are_refused() -> None:
    with pytest.raises(UsageError, match="hold no number and no report"):
        MeshFrame.from_arrays({"vertices": np.zeros((3, 3)), "faces": np.array([[0, 1, 2]])})


def test_without_resampling_vertices_only_move(motion: Motion) -> None:
    still = dataclasses.replace(motion, resampling=None)
    frames = list(animate(still))
    assert all(np.array_equal(frame.mesh.faces, frames[0].mesh.faces) for frame in frames)
    assert frames[-1].report.resampling is None
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
    shot = read_shot(Path(__file__).parents[1] / "shots" / f"{name}.yaml")
    frames = list(animate(shot))
    assert 10_000 <= max(len(frame.mesh.vertices) for frame in frames) <= 30_000
    assert (
        max(np.ptp(f.mesh.vertices, axis=0).max() for f in frames)
        <= 3 * np.ptp(frames[0].mesh.vertices, axis=0).max()
    )
