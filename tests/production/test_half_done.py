"""A frame that is ended half done goes on later; a rendering process that has grown is replaced."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.plan import Job, Plan
from flowsculpt.pipeline.production.store.event_log import EventLog, EventReader
from flowsculpt.pipeline.production.store.paths import CHECKPOINTS, EVENTS
from flowsculpt.pipeline.production.store.store import Store, checkpoint_of, remove_checkpoints, sweep
from flowsculpt.pipeline.production.tasks import worker_end
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.production.tasks.worker import task_of
from flowsculpt.pipeline.production.tasks.worker_end import (
    RESTART_WORKER,
    VARIABLE,
    MemoryGuard,
    MemoryLimitError,
    needs_another,
    run_children,
    settled_frames,
    verdict,
)
from flowsculpt.render.frame import render_frame as passes
from flowsculpt.render.post.image import read_exr

NAME = "T010_tiny"
QUALITY = "draft.scale10"
SETTINGS = ("quality.draft={samples: 64, auxiliary_samples: 16, denoise: off}",)


@dataclass
class Bench:
    """A project whose jobs are done one by one, in this process."""

    root: Path

    def plan(self, frames: str, *settings: str) -> Plan:
        project = Project(self.root, 1, settings=(*SETTINGS, *settings))
        return project.pictures([NAME], QUALITY, FrameRange.parse(frames))

    def context(self, plan: Plan, task: str) -> Context:
        job = next(job for job in plan.jobs if job.stage == task)
        return Context(self.root, plan, job, EventLog(self.root / EVENTS / f"{plan.name}.jsonl", job.name))

    def do(self, plan: Plan, *tasks: str) -> None:
        for task in tasks:
            assert task_of(task)(self.context(plan, task))

    def events(self, plan: Plan, kind: str) -> list[dict[str, Any]]:
        return [e for e in EventReader(self.root / EVENTS / f"{plan.name}.jsonl").new() if e["event"] == kind]

    def halves(self) -> list[Path]:
        return sorted((self.root / CHECKPOINTS).glob("*"))

    def raw(self, number: int) -> dict[str, np.ndarray]:
        path = self.root / "renders" / NAME / QUALITY / "raw" / f"{NAME}.{number:04d}.exr"
        layers, header = read_exr(path)
        return {**layers.arrays, "header": np.array(str(sorted(header.items())))}


@pytest.fixture
def bench(project: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.chdir(project.path)
    monkeypatch.delenv(VARIABLE, raising=False)
    made = Bench(project.path)
    made.do(made.plan("2-3"), "simulate", "smooth_normals", "frame_camera")
    return made


@pytest.fixture
def ended_in_pass(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, signal.Signals], None]:
    """Has this process sent itself a signal while it renders a pass, as a user or a scheduler would."""

    def arrange(number: int, sent: signal.Signals) -> None:
        render, count = passes.SampleBatches.render, 0

        def rendering(*arguments: Any) -> None:
            nonlocal count
            count += 1
            if count == number:
                os.kill(os.getpid(), sent)
            render(*arguments)

        monkeypatch.setattr(passes.SampleBatches, "render", rendering)

    return arrange


def test_a_frame_that_is_ended_goes_on_from_its_last_pass_to_the_same_bits(
    bench: Bench, ended_in_pass: Callable[..., None]
) -> None:
    for sent, passes_before in ((signal.SIGINT, 0), (signal.SIGTERM, 2)):
        ended_in_pass(2, sent)
        plan = bench.plan("2")
        with pytest.raises(KeyboardInterrupt):
            bench.do(plan, "render")
        (half,) = bench.halves()
        with np.load(half) as found:
            assert found["done"] == passes_before + 2
    again = bench.plan("2")
    bench.do(again, "render")
    assert [(e["frame"], e["passes"]) for e in bench.events(again, "resumed")] == [(2, 4)]
    assert not bench.halves() and not list((bench.root / ".flowsculpt/tmp").glob("*.npz"))
    resumed = bench.raw(2)
    Store(bench.root).discard("raw", half.stem.rpartition(".")[2])
    bench.do(bench.plan("2"), "render")
    undisturbed = bench.raw(2)
    assert all(np.array_equal(resumed[name], undisturbed[name]) for name in undisturbed)


def test_what_was_begun_otherwise_or_is_corrupt_is_never_gone_on_with(
    bench: Bench, ended_in_pass: Callable[..., None]
) -> None:
    ended_in_pass(2, signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        bench.do(bench.plan("2"), "render")
    (half,) = bench.halves()
    ended_in_pass(2, signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        bench.do(bench.plan("2", "quality.draft.samples=80"), "render")
    (other,) = bench.halves()
    assert other != half
    os.truncate(other, 1000)
    again = bench.plan("2", "quality.draft.samples=80")
    bench.do(again, "render")
    (told,) = bench.events(again, "warn")
    assert told["frame"] == 2 and "rendered from the start" in told["message"]
    assert not bench.events(again, "resumed") and not bench.halves()


def test_kept_passes_go_with_what_they_are_of(tmp_path: Path) -> None:
    """With pictures that were made since, those shown now under other keys, and what nobody came back to."""
    store, targets = Store(tmp_path), [Path(f"renders/A/final/raw/A.{n:04d}.exr") for n in range(4)]

    def kept(number: int, key: str) -> Path:
        keep = checkpoint_of(store, targets[number], key, lambda _: None, lambda: True)
        keep.save_if_due(lambda: {"done": np.array(1)})
        return keep.path

    made, wanted, old, other = (kept(n, f"{n}" * 32) for n in range(4))
    store.path("raw", "0" * 32).parent.mkdir(parents=True)
    store.path("raw", "0" * 32).write_bytes(b"")
    os.utime(old, (0.0, 0.0))
    sweep(store)
    assert [path.exists() for path in (made, wanted, old, other)] == [False, True, False, True]
    anew = kept(1, "a" * 32)
    assert anew.exists() and not wanted.exists()
    remove_checkpoints(store, targets[1:2])
    assert not anew.exists() and other.exists()
    remove_checkpoints(store, targets)
    assert not any((tmp_path / CHECKPOINTS).iterdir())


def test_a_renderer_that_has_grown_leaves_its_other_frames_to_a_fresh_one(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "1")
    plan = bench.plan("2-3")
    with pytest.raises(MemoryLimitError) as worn:
        bench.do(plan, "render")
    assert worn.value.held > worn.value.limit == 1.0
    assert [e["frame"] for e in bench.events(plan, "frame") if e["stage"] == "render"] == [2]


def test_a_renderer_may_grow_by_half_and_to_a_gibibyte(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(worker_end.gc, "collect", lambda: 0)
    cases = ((200, 1000, False), (200, 1100, True), (2000, 2900, False), (2000, 3100, True))
    for first, grown, worn in cases:
        held = iter([first, *[grown] * 2])
        monkeypatch.setattr(worker_end, "_resident_mib", lambda held=held: float(next(held)))
        process = MemoryGuard()
        process.measure()
        process.check()
        process.measure()
        if worn:
            with pytest.raises(MemoryLimitError):
                process.check()
        else:
            process.check()


@pytest.mark.parametrize("said", ["much", "0", "-3", "inf", "nan"])
def test_a_size_that_is_none_is_refused(said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, said)
    with pytest.raises(UsageError, match=f"{VARIABLE} is '{said}'"):
        MemoryGuard()


@pytest.fixture
def renderer(tmp_path: Path) -> Context:
    """A job that renders four frames, of which a run before has made the first."""
    job = Job("job", "render", (0,), (1, 2, 3, 4))
    log = EventLog(tmp_path / "events.jsonl", "job")
    log.write("frame", frame=1)
    return Context(tmp_path, Plan((), None, (job,)), job, log)


def test_fresh_workers_go_on_where_others_ended_past_frames_that_failed(renderer: Context) -> None:
    settled: list[int] = []

    def start(after: int) -> Any:
        renderer.begin(after)
        settled.append(settled_frames(renderer))
        if not after:
            renderer.log.write("frame", frame=1)
            renderer.log.write("fail", frame=2, exit_code=1)
        else:
            renderer.log.write("frame", frame=settled[-1] + 1)
        code = RESTART_WORKER if settled_frames(renderer) < 4 else 0
        return SimpleNamespace(wait=lambda: code)

    assert run_children(start) == 0
    assert settled == [0, 2, 3]


@pytest.mark.parametrize(
    ("code", "events", "expected"),
    [
        (0, ["made", "made"], 0),
        (1, ["made"], 1),
        (1, ["made", "failed"], 0),
        (1, ["failed", "failed"], 1),
        (1, ["made", "refused"], 1),
        (130, ["made", "failed"], 130),
    ],
)
def test_what_was_rendered_is_finished_unless_nothing_was_or_the_machine_refused(
    renderer: Context, code: int, events: list[str], expected: int
) -> None:
    renderer.begin(0)
    for number, event in enumerate(events):
        if event == "made":
            renderer.log.write("frame", frame=number)
        else:
            renderer.log.write("fail", frame=number, exit_code=1 if event == "failed" else 4)
    assert verdict(renderer, code) == expected


def test_a_worker_is_replaced_when_it_has_grown_and_a_killed_one_once_to_say_why() -> None:
    killed, asked_to_end = -signal.SIGKILL, -signal.SIGTERM
    assert needs_another(RESTART_WORKER, 0) and needs_another(RESTART_WORKER, RESTART_WORKER)
    assert needs_another(killed, 0) and needs_another(killed, RESTART_WORKER)
    assert not any(needs_another(code, 0) for code in (0, 1, 4, 130, asked_to_end))
    assert not needs_another(killed, killed)


def test_a_signal_is_passed_on_and_the_renderer_waited_for(tmp_path: Path) -> None:
    """The renderer ends after its sample batch, not at once."""
    code = (
        "import os, signal, sys, time\n"
        "signal.signal(signal.SIGTERM, lambda *_: (time.sleep(0.3), open(sys.argv[1], 'w'), sys.exit(130)))\n"
        "os.kill(os.getppid(), signal.SIGTERM)\n"
        "time.sleep(60)"
    )

    def start(after: int) -> subprocess.Popen[bytes]:
        return subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "kept")])

    assert run_children(start) == 130
    assert (tmp_path / "kept").exists()
