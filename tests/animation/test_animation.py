"""The frame loop: displace, resample, yield, go on."""

from __future__ import annotations

import dataclasses
import itertools
import math
import pickle
import tracemalloc
from itertools import pairwise
from pathlib import Path

import numba
import numpy as np
import pytest

from pipeline.animation import MeshFrame, animate, descent
from pipeline.animation.frame import material_of
from pipeline.arrays import AnyArray, Points
from pipeline.errors import FrameError, UsageError
from pipeline.flow import Sequence, Streamlines, Sum, keyed
from pipeline.flow.catalogue.attractors import Lorenz
from pipeline.flow.catalogue.deformations import Twist
from pipeline.flow.catalogue.vortices import Vortex
from pipeline.frames import FrameRange, FrameRate
from pipeline.mesh import TriangleMesh, validate
from pipeline.resample import Resampler, Thresholds
from pipeline.shot import Motion, Resampling, Solid, read_shot

EDGE = 0.25

MOST_BYTES = {"exact": 640.0, "chord": 560.0, "curved": 560.0}
"""Bytes a vertex at the peak, of arrays with room for a quarter more vertices, which takes no memory yet."""


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
        and one.mesh.creases.tobytes() == other.mesh.creases.tobytes()
        and one.mesh.attributes.keys() == other.mesh.attributes.keys()
        and all(v.tobytes() == other.mesh.attributes[n].tobytes() for n, v in one.mesh.attributes.items())
        and births(one).tobytes() == births(other).tobytes()
        and (one.identities, one.unsorted) == (other.identities, other.unsorted)
    )


def births(frame: MeshFrame) -> AnyArray:
    assert frame.births is not None
    return frame.births


def resampled(motion: Motion, **settings: object) -> Motion:
    """The motion with other settings of its resampling."""
    assert motion.resampling is not None
    return dataclasses.replace(motion, resampling=dataclasses.replace(motion.resampling, **settings))  # type: ignore[arg-type]


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


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"rest_interval": 6},
        {"placement": "curved"},
        {"placement": "chord"},
        {"placement": "chord", "splits": "faces"},
    ],
    ids=str,
)
def test_going_on_from_any_frame_gives_the_same_bits_as_never_stopping(
    motion: Motion, settings: dict[str, object]
) -> None:
    motion = resampled(motion, **settings)
    through = list(animate(motion))
    for stop in (0, 3, 6, 11, 14, 18):
        stored = MeshFrame.from_arrays(through[stop].to_arrays())
        rest = list(animate(motion, resume=stored))
        assert len(rest) == len(through) - stop - 1
        assert all(same(a, b) for a, b in zip(rest, through[stop + 1 :], strict=True))


def test_going_on_between_two_sorts_of_the_vertices_gives_the_same_bits(
    motion: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.resample.resampler._CACHED", 100)
    through = list(animate(resampled(motion, rest_interval=6)))
    counts = [frame.unsorted for frame in through]
    sorts = [n for n, (before, now) in enumerate(pairwise(counts), 1) if now < before]
    assert counts[0] == 0 and sorts, "vertices are sorted in the first frame and once more"
    for stop in (0, sorts[0] - 1, sorts[0]):
        stored = MeshFrame.from_arrays(through[stop].to_arrays())
        rest = list(animate(resampled(motion, rest_interval=6), resume=stored))
        assert all(same(a, b) for a, b in zip(rest, through[stop + 1 :], strict=True))
    moved = descent(through).mixed(through[0].mesh.vertices)
    np.testing.assert_allclose(moved, material_of(through[-1].mesh), atol=0.4)


def test_a_resampler_is_resumed_from_what_a_frame_holds(motion: Motion) -> None:
    """The frame's arrays are the resampler's whole state, under the names that it takes them by."""
    *_, last = animate(motion)
    tags = {"heat": np.arange(float(len(last.mesh.vertices)))}
    mesh = TriangleMesh(last.mesh.vertices, last.mesh.faces, tags)
    assert motion.resampling is not None
    assert set(Resampler(mesh, motion.resampling.thresholds).state()) == {
        "vertices",
        "faces",
        "creases",
        "attribute.heat",
        "unsorted",
    }
    tagged = dataclasses.replace(last, number=20, mesh=last.mesh.with_attributes(**tags))
    assert "heat" in next(animate(motion, resume=tagged)).mesh.attributes


def carried_to(motion: Motion, number: int, rest: Points, since: int = 5) -> Points:
    """Move rest points of frame `since` to a frame by the flow alone."""
    for frame in range(since + 1, number + 1):
        rest = motion.flow.displace(rest, *motion.clock.step(frame))
    return rest


def test_vertices_lie_where_the_flow_takes_their_points_at_rest(motion: Motion) -> None:
    """Exact placement: but for the few that would have folded the surface, and stayed on the chord."""
    *_, last = animate(motion)
    exactly = carried_to(motion, 24, last.mesh.attributes["rest"])
    off = np.linalg.norm(exactly - last.mesh.vertices, axis=1)
    assert np.mean(off < 1e-12) > 0.99
    np.testing.assert_allclose(np.abs(last.mesh.attributes["rest"]).max(axis=1), 1.0, atol=1e-12)


def test_normals_go_with_the_flow_and_end_at_creases(motion: Motion) -> None:
    """Compared with cof(J) n of the whole way from the cube's sides, J by central differences."""
    *_, last = animate(motion)
    rest, normals = last.mesh.attributes["rest"], last.mesh.attributes["normal"]
    known = normals.any(axis=1)
    outermost = np.abs(rest) > 1 - 1e-9
    assert np.array_equal(known, outermost.sum(axis=1) == 1)
    points, sides = rest[known], np.sign(rest[known]) * outermost[known]
    columns = []
    for axis in np.eye(3):
        ahead, behind = (carried_to(motion, 24, points + h * axis) for h in (1e-5, -1e-5))
        columns.append((ahead - behind) / 2e-5)
    exact = np.linalg.inv(np.stack(columns, axis=1)) @ sides[:, :, None]
    exact = exact[:, :, 0] / np.linalg.norm(exact[:, :, 0], axis=1, keepdims=True)
    assert np.linalg.norm(np.cross(exact, normals[known]), axis=1).max() < 1e-5
    assert np.einsum("ij,ij->i", exact, normals[known]).min() > 0


def test_the_surface_at_rest_is_renewed_every_so_many_frames(motion: Motion) -> None:
    for frame in animate(resampled(motion, rest_interval=6)):
        since = 5 + (frame.number - 5) // 6 * 6
        rest = frame.mesh.attributes["rest"]
        if frame.number == since:
            assert frame.number == 5 or np.array_equal(rest, frame.mesh.vertices)
        exactly = carried_to(motion, frame.number, rest, since)
        off = np.linalg.norm(exactly - frame.mesh.vertices, axis=1)
        assert np.mean(off < 1e-12) > 0.99


def test_geometric_normals_are_not_kept(motion: Motion) -> None:
    *_, last = animate(resampled(motion, normals="geometric"))
    assert "normal" not in last.mesh.attributes
    *_, last = animate(resampled(motion, placement="curved"))
    assert set(last.mesh.attributes) == {"identity", "material"}


def test_the_creases_at_rest_stay_creases(motion: Motion) -> None:
    """P31: the twelve edges of the cube, by the fields of their vertices at rest."""
    *_, last = animate(motion)
    ends = np.abs(last.mesh.attributes["rest"])[last.mesh.creases]
    assert ((ends > 1 - 1e-9).all(axis=1).sum(axis=1) >= 2).all()
    length = np.linalg.norm(np.diff(last.mesh.attributes["rest"][last.mesh.creases], axis=1), axis=2).sum()
    assert length == pytest.approx(24.0)
    *_, last = animate(resampled(motion, placement="curved", creases="none"))
    assert not len(last.mesh.creases)


def test_a_frame_without_rest_points_is_no_start_for_exact_placement(motion: Motion) -> None:
    first = next(animate(resampled(motion, placement="chord")))
    with pytest.raises(UsageError, match="frame 5 has no vertex attribute 'rest'"):
        next(animate(motion, resume=first))


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


def test_the_vertices_of_a_film_are_numbered_and_every_birth_is_in_its_frame(motion: Motion) -> None:
    told = len(motion.mesh_at_rest().vertices)
    alive = set(range(told))
    for frame in animate(motion):
        assert births(frame)[:, 0].tolist() == list(range(told, frame.identities))
        told = frame.identities
        alive |= set(births(frame)[:, 0].tolist())
        now = frame.mesh.attributes["identity"].tolist()
        assert len(set(now)) == len(now) and set(now) <= alive
        assert frame.report.resampling is not None and frame.report.resampling.splits == len(births(frame))
        alive = set(now)
    assert told > len(alive)


def test_a_survivor_is_told_by_its_number_and_the_young_by_their_ancestors(motion: Motion) -> None:
    """A flow that only stretches: what the first frame's vertices were mixed to goes where they go."""
    stretching = resampled(motion, thresholds=Thresholds(EDGE, 1e-6), placement="chord")
    frames = list(animate(stretching, flow=lambda points, time, dt: points * (1 + dt)))
    found, first, last = descent(frames[2:]), frames[2].mesh, frames[-1].mesh
    stretch = (1 + 1 / 24) ** 17
    np.testing.assert_allclose(stretch * found.mixed(first.vertices), last.vertices, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(found.survives, last.attributes["identity"] < frames[2].identities)
    assert found.survives.sum() == len(first.vertices) < len(last.vertices) / 1.5


def test_the_ancestors_of_a_wild_film_are_near_at_rest(motion: Motion) -> None:
    """Exact placement: survivors keep their points at rest, new ones lie by those they descend from."""
    frames = [
        MeshFrame.from_arrays(frame.to_arrays()) for frame in animate(resampled(motion, min_roundness=0.0))
    ]
    found, then, now = descent(frames), frames[0].mesh.attributes["rest"], frames[-1].mesh.attributes["rest"]
    off = np.linalg.norm(found.mixed(then) - now, axis=1)
    assert off[found.survives].max() == 0
    assert 0 < np.count_nonzero(~found.survives) < len(now) and off.max() < EDGE


def test_frames_that_are_left_out_leave_no_lineage(motion: Motion) -> None:
    frames = list(animate(motion))
    with pytest.raises(UsageError, match=r"frames \[5, 7\] are not consecutive"):
        descent([frames[0], frames[2]])
    with pytest.raises(UsageError, match=r"frames \[\] are not"):
        descent([])
    polygons = list(animate(resampled(motion, method="polyhedra", thresholds=Thresholds(1.2))))[:2]
    assert polygons[0].births is None and "births" not in polygons[0].to_arrays()
    with pytest.raises(UsageError, match="frame 5 has no identities"):
        descent(polygons)


def test_arrays_that_are_no_frame_are_refused() -> None:
    with pytest.raises(UsageError, match="hold no number and no report"):
        MeshFrame.from_arrays({"vertices": np.zeros((3, 3)), "faces": np.array([[0, 1, 2]])})


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


@pytest.mark.parametrize("placement", ["exact", "chord"])
def test_many_vertices_are_moved_by_blocks_to_the_same_bits(
    motion: Motion, placement: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion = resampled(motion, placement=placement)
    *_, whole = itertools.islice(animate(motion), 6)
    monkeypatch.setattr("pipeline.animation.loop.MOVED_TOGETHER", 37)
    *_, parted = itertools.islice(animate(motion), 6)
    assert same(whole, parted)


def test_an_error_in_a_later_block_names_the_vertex_of_the_surface(
    motion: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = next(animate(motion))

    def broken(points: Points, time: float, dt: float) -> Points:
        points[(points == first.mesh.vertices[100]).all(axis=1)] = np.nan
        return points

    monkeypatch.setattr("pipeline.animation.loop.MOVED_TOGETHER", 32)
    with pytest.raises(FrameError, match="moved vertex 100 from"):
        list(animate(resampled(motion, placement="chord"), flow=broken))


@pytest.mark.parametrize("placement", ["exact", "chord", "curved"])
def test_a_frame_takes_a_bounded_number_of_bytes_a_vertex(motion: Motion, placement: str) -> None:
    motion = resampled(motion, placement=placement, thresholds=Thresholds(max_edge_length=0.03))
    frames = animate(motion)
    vertices = len(next(frames).mesh.vertices)  # kernels are loaded
    tracemalloc.start()
    try:
        frames = animate(motion)
        for frame in itertools.islice(frames, 2):
            assert frame.report.statistics is not None
            del frame
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak / vertices < MOST_BYTES[placement]


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


def test_crossings_are_counted_in_every_eighth_frame_also_after_resuming(motion: Motion) -> None:
    frames = list(animate(motion))
    counted = [frame.number for frame in frames if frame.report.statistics.crossings is not None]
    assert counted == [5, 13, 21]
    resumed = [frame.number for frame in animate(motion, frames[2]) if frame.report.statistics.crossings == 0]
    assert resumed == [13, 21]


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
        <= 3 * np.ptp(frames[0].mesh.vertices, axis=0).max()
    )
