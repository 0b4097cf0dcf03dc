"""Frames that are stored, resumed from, moved in blocks or by several threads: the same bits."""

from __future__ import annotations

import dataclasses
import itertools
import tracemalloc
from itertools import pairwise
from pathlib import Path

import numba
import numpy as np
import pytest

from flowsculpt.pipeline.animation import MeshFrame, animate, descent
from flowsculpt.pipeline.animation.frame import material_of
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.resample import Resampler, Thresholds
from flowsculpt.pipeline.shot import Motion
from tests.animation.motions import resampled, same

MOST_BYTES = {"exact": 640.0, "chord": 560.0, "curved": 560.0}
"""Bytes a vertex at the peak, of arrays with room for a quarter more vertices, which takes no memory yet."""


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
        stored = MeshFrame.from_arrays(through[stop].to_arrays(), through[stop].number)
        rest = list(animate(motion, resume=stored))
        assert len(rest) == len(through) - stop - 1
        assert all(same(a, b) for a, b in zip(rest, through[stop + 1 :], strict=True))


def test_going_on_between_two_sorts_of_the_vertices_gives_the_same_bits(
    motion: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flowsculpt.pipeline.resample.resampler._CACHED", 100)
    through = list(animate(resampled(motion, rest_interval=6)))
    counts = [frame.unsorted for frame in through]
    sorts = [n for n, (before, now) in enumerate(pairwise(counts), 1) if now < before]
    assert counts[0] == 0 and sorts, "vertices are sorted in the first frame and once more"
    for stop in (0, sorts[0] - 1, sorts[0]):
        stored = MeshFrame.from_arrays(through[stop].to_arrays(), through[stop].number)
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
    tagged = dataclasses.replace(last, number=20, own=last.mesh.with_attributes(**tags))
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
        last, own=TriangleMesh(last.mesh.vertices, last.mesh.faces, {"heat": last.mesh.vertices[:, 0]})
    )
    np.savez(tmp_path / "f.npz", **tagged.to_arrays())  # type: ignore[arg-type]
    with np.load(tmp_path / "f.npz", allow_pickle=False) as arrays:
        assert arrays["vertices"].dtype == np.float64 and arrays["faces"].dtype == np.int32
        back = MeshFrame.from_arrays(arrays, tagged.number)
    assert same(back, tagged)
    np.testing.assert_array_equal(back.mesh.attributes["heat"], tagged.mesh.attributes["heat"])


@pytest.mark.parametrize("placement", ["exact", "chord"])
def test_many_vertices_are_moved_by_blocks_to_the_same_bits(
    motion: Motion, placement: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion = resampled(motion, placement=placement)
    *_, whole = itertools.islice(animate(motion), 6)
    monkeypatch.setattr("flowsculpt.pipeline.flow.flow_map.MOVED_TOGETHER", 37)
    *_, parted = itertools.islice(animate(motion), 6)
    assert same(whole, parted)


def test_arrays_that_are_no_frame_are_refused() -> None:
    with pytest.raises(UsageError, match="have no report"):
        MeshFrame.from_arrays({"vertices": np.zeros((3, 3)), "faces": np.array([[0, 1, 2]])}, 1)


def test_a_frame_without_rest_points_is_no_start_for_exact_placement(motion: Motion) -> None:
    first = next(animate(resampled(motion, placement="chord")))
    with pytest.raises(UsageError, match="frame 5 has no vertex attribute 'rest'"):
        next(animate(motion, resume=first))


def test_crossings_are_counted_in_every_eighth_frame_also_after_resuming(motion: Motion) -> None:
    frames = list(animate(motion))
    counted = [frame.number for frame in frames if frame.report.statistics.crossings is not None]
    assert counted == [5, 13, 21]
    resumed = [frame.number for frame in animate(motion, frames[2]) if frame.report.statistics.crossings == 0]
    assert resumed == [13, 21]


@pytest.mark.slow
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
