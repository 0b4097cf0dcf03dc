"""Jobs that simulate store what is asked for, while the next frame is computed."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.animation import MeshFrame, animate
from flowsculpt.pipeline.errors import FrameError, MachineError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.store import readers
from flowsculpt.pipeline.production.store.event_log import EventLog, EventReader
from flowsculpt.pipeline.production.store.paths import EVENTS
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.pipeline.production.tasks import surfaces
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.shot import read_shot

pytestmark = pytest.mark.quick

SHOT = """\
title: A box, twisted
frames: 1-12
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.5}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 12: 60}}}
"""


class Job:
    """A project with one shot, and a job that simulates some of its frames in this process."""

    def __init__(self, root: Path, frames: str) -> None:
        self.root = root
        self.plan: Plan = Project(root, 1).meshes(["A"], FrameRange.parse(frames))
        (job,) = self.plan.jobs
        log = EventLog(root / EVENTS / f"{self.plan.name}.jsonl", job.name)
        self.context = Context(root, self.plan, job, log)

    def run(self) -> bool:
        return surfaces.simulate(self.context)

    def stored(self) -> list[int]:
        """The frames that the store holds."""
        held = {key for kind, key, _ in Store(self.root).entries() if kind == "mesh"}
        return [n for n in range(1, 13) if self.context.request.keys.mesh(n) in held]

    def shown(self) -> list[int]:
        return sorted(int(path.stem[-4:]) for path in (self.root / "renders/A/meshes").glob("*.npz"))

    def events(self, kind: str) -> list[dict[str, Any]]:
        events = EventReader(self.root / EVENTS / f"{self.plan.name}.jsonl").new()
        return [event for event in events if event["event"] == kind]


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "shots").mkdir()
    (tmp_path / "shots/A.yaml").write_text(SHOT)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def simulated(root: Path) -> dict[int, MeshFrame]:
    return {frame.number: frame for frame in animate(read_shot(root / "shots/A.yaml"))}


def test_a_range_of_a_large_mesh_stores_its_own_frames_and_none_after_it(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(surfaces, "LARGE", 1)
    job = Job(root, "7-9")
    assert job.run()
    assert job.stored() == job.shown() == [7, 8, 9]
    assert [event["frame"] for event in job.events("frame")] == [7, 8, 9]
    later = Job(root, "11")  # goes on from frame 9
    assert later.run() and later.stored() == [7, 8, 9, 11]
    frame = surfaces.read_mesh_frame(later.context, later.context.request, 11)
    assert np.array_equal(frame.mesh.vertices, simulated(root)[11].mesh.vertices)


def test_frames_before_the_range_are_stored_where_they_are_small_or_took_long(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = Job(root, "3-4")
    assert job.run() and job.stored() == [1, 2, 3, 4] and job.shown() == [3, 4]
    monkeypatch.setattr(surfaces, "LARGE", 1)
    monkeypatch.setattr(surfaces, "KEPT_SECONDS", 0.0)
    assert Job(root, "6").run() and job.stored() == [1, 2, 3, 4, 5, 6]


def test_a_frame_is_written_while_the_next_one_is_computed(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed, write = threading.Event(), readers.write_npz

    def frames(*given: Any, **more: Any) -> Iterator[MeshFrame]:
        for frame in animate(given[0]):
            if frame.number == 2:
                computed.set()
            yield frame

    def writes(path: Path, named: Any) -> None:
        is_first = named["key"] == job.context.request.keys.mesh(1)
        assert not is_first or computed.wait(120.0), "the first is not written before the second comes"
        write(path, named)

    monkeypatch.setattr(surfaces, "animate", frames)
    monkeypatch.setattr(readers, "write_npz", writes)
    job = Job(root, "1-3")
    assert job.run() and job.stored() == [1, 2, 3]


def test_where_writing_fails_the_job_says_so_once_and_leaves_nothing_half_written(
    root: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    write = readers.write_npz

    def fails(path: Path, named: Any) -> None:
        if named["key"] == job.context.request.keys.mesh(3):
            path.write_bytes(b"half of it")
            raise MachineError(f"{path}: cannot be written: the disk is full")
        write(path, named)

    monkeypatch.setattr(readers, "write_npz", fails)
    job = Job(root, "1-5")
    assert not job.run()
    (failure,) = job.events("fail")
    assert failure["frame"] == 3 and failure["exit_code"] == 4
    assert capfd.readouterr().err.count("disk is full") == 1
    assert job.stored() == job.shown() == [1, 2]
    assert not [*Store(root).scratch.glob("*"), *Store(root).inner_scratch.glob("*")]


def test_where_a_frame_fails_those_before_it_are_stored(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def frames(*given: Any, **more: Any) -> Iterator[MeshFrame]:
        for frame in animate(given[0]):
            if frame.number == 4:
                raise FrameError("the flow fails", 4)
            yield frame

    monkeypatch.setattr(surfaces, "animate", frames)
    job = Job(root, "1-6")
    assert not job.run()
    assert job.events("fail")[0]["frame"] == 4 and job.stored() == job.shown() == [1, 2, 3]


def test_what_is_not_stored_is_not_measured(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surfaces, "LARGE", 1)
    measured: list[int] = []

    def frames(*given: Any, **more: Any) -> Iterator[MeshFrame]:
        for frame in animate(given[0]):
            yield frame
            measured.extend([frame.number] * ("statistics" in vars(frame.report)))

    monkeypatch.setattr(surfaces, "animate", frames)
    job = Job(root, "5-6")
    assert job.run() and measured == [5]  # nothing asks for a frame after the last one
    report = json.loads(str(readers.read_npz(root / "renders/A/meshes/A.0006.npz")["report"]))
    assert report["statistics"]["area"] > 0
