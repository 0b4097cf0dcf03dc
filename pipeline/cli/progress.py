"""Progress of a run, read from its event log: a bar a stage, with the time left."""

from __future__ import annotations

import threading
from collections import Counter
from types import TracebackType

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from pipeline.production.events import Event, EventReader
from pipeline.production.plan import Plan

POLL_SECONDS = 0.2

STAGES = {
    "simulate": "simulating",
    "smooth_normals": "smoothing",
    "frame_camera": "framing",
    "render": "rendering",
    "finish": "finishing",
    "assemble": "assembling",
    "film": "cutting the film",
    "png": "writing PNG",
    "png16": "writing PNG",
    "jpeg": "writing JPEG",
}


class Bars:
    """Shows the stages of a plan while Snakemake works: the context manager that `run` asks for."""

    def __init__(self, plan: Plan, reader: EventReader, console: Console) -> None:
        self._reader = reader
        self._console = console
        totals = Counter({job.task: 0 for job in plan.jobs})
        for job in plan.jobs:
            totals[job.task] += len(job.frames)
        self._progress = Progress(
            TextColumn("{task.description:>16}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
        )
        self._tasks: dict[str, TaskID] = {
            stage: self._progress.add_task(words, total=totals[stage], start=False)
            for stage, words in STAGES.items()
            if totals[stage]
        }
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._follow, daemon=True)

    def __enter__(self) -> Bars:
        self._progress.start()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._thread.join()
        self._read()
        self._progress.stop()

    def _follow(self) -> None:
        while not self._done.wait(POLL_SECONDS):
            self._read()

    def _read(self) -> None:
        for event in self._reader.new():
            self._show(event)

    def _show(self, event: Event) -> None:
        task = self._tasks.get(event.get("stage", ""))
        if event["event"] == "begin" and task is not None:
            self._progress.start_task(task)
        elif event["event"] == "frame" and task is not None:
            self._progress.advance(task)
        elif event["event"] == "healed":
            self._console.print(event["message"], style="yellow", markup=False, highlight=False)
