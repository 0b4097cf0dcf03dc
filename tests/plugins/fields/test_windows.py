"""Only the samples around a moment are read, and files decide the keys of the frames that they show."""

from __future__ import annotations

import json
import pickle
import shutil
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import MissingInputError
from flowsculpt.pipeline.flow import Streamlines
from flowsculpt.pipeline.flow.flow_map import FlowMap, FrameStep, checked_displacement
from flowsculpt.pipeline.plugins.fields import scratch_arrays, windowed_samples
from flowsculpt.pipeline.plugins.fields.cf_files import cf_samples, missing_among
from flowsculpt.pipeline.plugins.fields.cf_headers import Selection
from flowsculpt.pipeline.plugins.fields.grid_layout import Placing
from flowsculpt.pipeline.shot import Shot, read_shot

xarray = pytest.importorskip("xarray")

HEAD = "title: T\nframes: 1-48\nsubject: {solid: icosphere}\nresample: off\nflows:\n"
TIMES = 9


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """Return a store of a wind that turns by 10 degrees an hour; its last time was never written."""
    axis = np.linspace(-2.0, 2.0, 9)
    x, y = np.meshgrid(axis, axis)
    turns = np.radians(10.0 * np.arange(TIMES))[:, None, None]
    u, v = np.cos(turns) - 0.1 * y, np.sin(turns) + 0.1 * x
    u[-1] = v[-1] = -999.0
    dims, units = ("time", "y", "x"), {"units": "m h-1", "_FillValue": -999.0}
    data = xarray.Dataset(
        {"u": (dims, u, units), "v": (dims, v, units)},
        {
            "x": ("x", axis, {"units": "m", "axis": "X"}),
            "y": ("y", axis, {"units": "m", "axis": "Y"}),
            "time": ("time", np.arange(TIMES), {"units": "hours since 2020-01-01"}),
        },
    )
    chunks = {name: {"chunks": (1, 9, 9)} for name in "uv"}
    data.to_zarr(tmp_path / "wind.zarr", zarr_format=2, encoding=chunks, write_empty_chunks=False)
    (tmp_path / "a.yaml").touch()
    return tmp_path / "wind.zarr"


def shot_of(store: Path, settings: str = "time_scale: 4 h") -> Shot:
    return read_shot(store.parent / "a.yaml", HEAD + f"  - sampled: {{file: {store.name}, {settings}}}\n")


def field_of(shot: Shot) -> Any:
    flow = shot.motion.flow
    for each in getattr(flow, "flows", [flow]):
        if isinstance(each, Streamlines):
            return each.field
    raise AssertionError(flow)


def keys_of(shot: Shot) -> list[str]:
    """Return what acts between frames, as text: of equal texts, equal motion."""
    return [json.dumps(shot.motion.step_data(frame)) for frame in range(2, 49)]


def count_reads(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that gets the index of each time that is read."""
    read: list[int] = []
    original = windowed_samples.WindowedSamples._read
    monkeypatch.setattr(
        windowed_samples.WindowedSamples, "_read", lambda self, k: (read.append(k), original(self, k))[1]
    )
    return read


def test_velocities_are_blended_between_times_and_go_by_the_clock_of_the_samples(store: Path) -> None:
    field = field_of(shot_of(store))
    points = np.array([[0.5, 0.0, 0.3], [0.0, -1.0, 7.0]])
    half = np.radians(5.0)
    expected = [
        [np.cos(half) ** 2, 0.05 + 0.5 * np.sin(2 * half), 0.0],
        [0.1 + np.cos(half) ** 2, 0.5 * np.sin(2 * half), 0.0],
    ]
    found = field.velocity(points, 0.125) / 4.0
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_planning_reads_no_velocities_once_it_knows_their_gradients(
    store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = keys_of(shot_of(store))
    read = count_reads(monkeypatch)
    assert keys_of(shot_of(store)) == first and not read


def test_a_frame_reads_the_times_around_it_once(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shot = shot_of(store)
    keys_of(shot)
    again, read = shot_of(store), count_reads(monkeypatch)
    monkeypatch.setattr(windowed_samples, "KEPT_BYTES", 0)
    points = np.random.default_rng(1).normal(size=(100, 3))
    for frame in range(1, 25):
        points = again.motion.flow.displace(points, *again.motion.clock.step(frame + 1))
    assert read == [0, 1, 2, 3, 4]
    samples = field_of(again).samples
    assert len(samples._kept) == 2


def test_memory_stays_while_a_plan_names_it(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(windowed_samples, "KEPT_BYTES", 0)
    field = field_of(shot_of(store))
    points = np.array([[0.5, 0.0, 0.3]])
    whole = Streamlines(field, substeps=64).step_plan(0.0, 1.9)  # across all times
    for _ in range(3):
        np.full(10**6, np.nan)
    apart = points
    for k in range(64):
        apart = Streamlines(field, substeps=1).step_plan(1.9 * k / 64, 1.9 / 64).follow(apart)
    np.testing.assert_allclose(whole.follow(points), apart, rtol=1e-9)


@pytest.mark.parametrize(("begin", "seconds"), [(0.1, 1.3), (1.4, -1.3)])
def test_a_step_across_many_times_holds_two_of_them(
    store: Path, monkeypatch: pytest.MonkeyPatch, begin: float, seconds: float
) -> None:
    monkeypatch.setattr(windowed_samples, "KEPT_BYTES", 0)
    original, read, most = windowed_samples.WindowedSamples._read, list[Any](), [0]

    def counted(samples: windowed_samples.WindowedSamples, index: int) -> np.ndarray:
        velocity = original(samples, index)
        read.append(weakref.ref(velocity))
        most[0] = max(most[0], sum(each() is not None for each in read))
        return velocity

    monkeypatch.setattr(windowed_samples.WindowedSamples, "_read", counted)
    shot = shot_of(store)
    flow, start = Streamlines(field_of(shot), substeps=4), np.array([[0.5, 0.0, 0.3]])
    moved = checked_displacement(flow, start, begin, seconds, 2)
    assert len(read) == 7 and most[0] == 2
    known = FlowMap()
    known.add(FrameStep(flow, begin, seconds, 2))
    np.testing.assert_array_equal(known.carry(start), moved)
    assert most[0] == 2


@pytest.mark.parametrize(("kept_free", "reads"), [(0.0, windowed_samples.ONCE_EACH_CHUNK + 1), (1.0, 5)])
def test_times_that_are_needed_again_and_again_are_kept_on_the_disk_if_it_has_room(
    store: Path, monkeypatch: pytest.MonkeyPatch, kept_free: float, reads: int
) -> None:
    monkeypatch.setattr(windowed_samples, "KEPT_BYTES", 0)
    monkeypatch.setattr(scratch_arrays, "KEPT_FREE", kept_free)
    samples, _ = cf_samples((store,), Selection(), Placing())
    first = [samples.velocities(index).copy() for index in range(4)]
    read = count_reads(monkeypatch)
    for _ in range(4):
        for index in range(4):
            np.testing.assert_array_equal(samples.velocities(index), first[index])
    assert [1 + read.count(index) for index in range(4)] == [reads] * 4


def test_a_disk_that_fails_changes_nothing(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(windowed_samples, "KEPT_BYTES", 0)
    monkeypatch.setattr(windowed_samples, "ONCE_EACH", 0)
    monkeypatch.setattr(scratch_arrays.os, "pwrite", fail)
    samples, _ = cf_samples((store,), Selection(), Placing())
    first = [samples.velocities(index).copy() for index in range(3)]
    for index in range(3):
        np.testing.assert_array_equal(samples.velocities(index), first[index])


def test_a_step_ends_at_the_times_of_samples_whose_velocities_then_bend(store: Path) -> None:
    flow, point = Streamlines(field_of(shot_of(store)), substeps=1), np.array([[0.5, 0.0, 0.3]])
    halves = flow.displace(flow.displace(point, 0.2, 0.05), 0.25, 0.05)  # there is a time at 0.25 s
    np.testing.assert_allclose(flow.displace(point, 0.2, 0.1), halves, rtol=1e-12)
    assert len(list(flow.steps(0.25, 0.25))) == 1 and len(list(flow.steps(0.2, 0.35))) == 3


def test_a_chunk_decides_the_frames_around_its_time_alone(store: Path) -> None:
    before = keys_of(shot_of(store))
    changed = store / "u" / "5.0.0"
    shutil.copyfile(store / "u" / "3.0.0", changed)
    after = keys_of(shot_of(store))
    differing = [
        frame for frame, (one, other) in enumerate(zip(before, after, strict=True), 2) if one != other
    ]
    assert differing == list(range(26, 38))  # from 4 h to 6 h


def test_a_chunk_that_was_not_there_counts_once_it_is(store: Path) -> None:
    absent = store / "u" / f"{TIMES - 1}.0.0"
    assert not absent.exists()
    before = shot_of(store)
    assert (absent, "") in before.files
    shutil.copyfile(store / "u" / "3.0.0", absent)
    after = shot_of(store)
    assert keys_of(before)[-1] != keys_of(after)[-1] and keys_of(before)[30] == keys_of(after)[30]


def test_a_shot_reads_the_files_of_its_frames_alone(store: Path) -> None:
    chunks = {path.name for path, _ in shot_of(store, "time_scale: 1 h").files if path.parent.name == "u"}
    assert {"0.0.0", "1.0.0", "2.0.0"} <= chunks and "5.0.0" not in chunks


def test_a_shot_in_real_time_is_told_how_to_go_faster(store: Path) -> None:
    assert any("write time_scale: 1 day" in note for note in shot_of(store, "strength: 1").notes)
    assert not shot_of(store, "time_scale: 1 h").notes


def test_a_store_that_changes_after_planning_is_reported(store: Path) -> None:
    samples, _ = cf_samples((store,), Selection(), Placing())
    samples.digest(2)
    shutil.copyfile(store / "u" / "3.0.0", store / "u" / "2.0.0")
    with pytest.raises(
        MissingInputError, match=r"2\.0\.0: it was changed since the work was planned; run again"
    ):
        samples.velocities(2)


@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.tuples(*[st.integers(2, 20)] * 3),
    widths=st.tuples(*[st.booleans()] * 3),
)
def test_slopes_are_the_largest_rises_over_their_own_distances(
    seed: int, shape: tuple[int, int, int], widths: tuple[bool, bool, bool]
) -> None:
    generator = np.random.default_rng(seed)
    velocity = generator.normal(size=(*shape, 3)).astype(np.float32)
    for k in range(3):
        sizes = [length - (axis == k) for axis, length in enumerate(shape)]
        distances = generator.uniform(
            0.1, 2.0, [n if own else 1 for n, own in zip(sizes, widths, strict=True)]
        )
        rises = np.linalg.norm(np.diff(velocity, axis=k), axis=-1)
        assert windowed_samples._largest_secant(velocity, distances, k) == (rises / distances).max()


def test_samples_travel_to_other_processes_without_what_was_read(store: Path) -> None:
    field = field_of(shot_of(store))
    points = np.array([[0.5, 0.0, 0.3]])
    known = field.velocity(points, 0.4)
    content = pickle.dumps(field)
    assert len(content) < 20_000
    np.testing.assert_array_equal(pickle.loads(content).velocity(points, 0.4), known)


@given(
    values=st.lists(st.sampled_from([0.0, 1.5, -3.0, 7.0, 1e37, -1e37, np.nan, np.inf]), max_size=6),
    fills=st.lists(st.sampled_from([0.0, -3.0, 7.0, 99.0, np.nan]), max_size=2),
    ends=st.sampled_from([(), (-2.0, 5.0), (None, 5.0), (-5.0, 99.0)]),
)
def test_each_number_is_missing_by_the_same_rules_whatever_is_beside_it(
    values: list[float], fills: list[float], ends: tuple[float | None, ...]
) -> None:
    attributes: dict[str, Any] = {"missing_value": np.array(fills)} if fills else {}
    attributes |= {
        f"valid_{name}": end for name, end in zip(("min", "max"), ends, strict=False) if end is not None
    }
    raw = np.array(values)
    low, high = attributes.get("valid_min", -np.inf), attributes.get("valid_max", np.inf)
    expected = [
        not abs(value) < 9e36 or value in [fill for fill in fills if fill] or not low <= value <= high
        for value in values
    ]
    found = missing_among(raw, attributes)
    assert (np.zeros(len(raw), bool) if found is None else found).tolist() == expected
