"""`python -m benchmarks.scaling [ROOT [RUN]]`: the time of a run on more nodes.

With a ROOT, a run that was recorded there is replayed: a small simulation of discrete events, in which
workers take jobs whose predecessors are done, the most urgent first, and hold them for as long as the event
log says. With as many workers as the run had, the result must equal the recorded time. Without a ROOT the
models of docs/scaling.md are evaluated: planned shots on a farm whose jobs each wait for its queue, and what
planning takes (`benchmarks.planning`), beside its measurement. `benchmarks.farm_plans` schedules real plans.
"""

from __future__ import annotations

import heapq
import sys
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks import planning
from benchmarks.report import Row, keep, show
from flowsculpt.pipeline.plugins.maintenance.run_report import named_run
from flowsculpt.pipeline.production.planning.batches import batches
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.store.event_log import EventReader
from flowsculpt.pipeline.production.store.paths import EVENTS, PLANS

HOP = 14.0
"""Seconds that a job of a farm waits: queue, start, and until its end is noticed (measured: 13 to 15)."""

START = 2.0
"""Seconds until a process makes its first frame."""

SECONDS = {"motion": 1.0, "render": 85.0, "finish": 3.4, "movie": 1.0}
"""Of a node of two cores, a frame of 67 thousand vertices, 1280 × 720, 64 samples (docs/benchmarks.md)."""


@dataclass(frozen=True)
class Task:
    """A job of the simulation: its predecessors, and how long it holds a worker."""

    name: str
    after: tuple[str, ...]
    seconds: float
    urgency: int = 0


def replayed(tasks: Sequence[Task], workers: int, hop: float = 0.0) -> float:
    """Return the seconds until all tasks are done by so many workers; each begins after a delay of `hop`."""
    waiting = {task.name: len(task.after) for task in tasks}
    followers: dict[str, list[Task]] = defaultdict(list)
    for task in tasks:
        for name in task.after:
            followers[name].append(task)
    ready = [(-task.urgency, number, task) for number, task in enumerate(tasks) if not task.after]
    heapq.heapify(ready)
    running: list[tuple[float, int, Task]] = []
    now, free, count = 0.0, workers, len(tasks)
    while ready or running:
        while ready and free:
            _, number, task = heapq.heappop(ready)
            heapq.heappush(running, (now + hop + task.seconds, number, task))
            free -= 1
        now, _, done = heapq.heappop(running)
        free += 1
        for task in followers[done.name]:
            waiting[task.name] -= 1
            if not waiting[task.name]:
                count += 1
                heapq.heappush(ready, (-task.urgency, count, task))
    return now


def recorded(root: Path, run: str) -> tuple[list[Task], int, float]:
    """Return the jobs of a run with the seconds that they held a worker, its workers, and its length.

    A job holds its worker from the end of the job before it, or from the beginning of the run.
    """
    events = list(EventReader(root / EVENTS / f"{run}.jsonl").new())
    plan = Plan.thaw(root / PLANS / f"{run}.json")
    makers = {job.output: job.name for job in plan.jobs}
    after = {job.name: tuple(makers[output] for output in plan.all_inputs(job)) for job in plan.jobs}
    cores = next(int(event["cores"]) for event in events if event["event"] == "run")
    begun = {event["job"]: event for event in reversed(events) if event["event"] == "begin"}
    ended = {event["job"]: event["time"] for event in events if event["event"] == "end"}
    first, last = events[0]["time"], events[-1]["time"]
    tasks = []
    for name, event in begun.items():
        before = max((t for t in ended.values() if t < event["time"]), default=first)
        tasks.append(Task(name, after[name], ended[name] - before))
    return tasks, cores, last - first


def shot(number: int, frames: int, nodes: int) -> list[Task]:
    """Return the planned jobs of a shot, distributed over so many nodes."""
    motion = f"motion{number}"
    tasks = [Task(motion, (), START + frames * SECONDS["motion"], urgency=1)]
    finished = []
    for place, batch in enumerate(batches(range(1, frames + 1), nodes)):
        rendered, done = f"render{number}.{place}", f"finish{number}.{place}"
        tasks.append(Task(rendered, (motion,), START + len(batch) * SECONDS["render"], -(place // nodes)))
        tasks.append(Task(done, (rendered,), START + len(batch) * SECONDS["finish"], -(place // nodes)))
        finished.append(done)
    return [*tasks, Task(f"movie{number}", tuple(finished), START + frames * SECONDS["movie"])]


def check(root: Path, run: str) -> None:
    """Replay a recorded run on its own workers and on more."""
    tasks, cores, seconds = recorded(root, run)
    rows: list[Row] = [
        {
            "workers": float(n),
            "replayed, s": replayed(tasks, n),
            "by the clock, s": seconds if n == cores else "",
        }
        for n in (cores, 2 * cores, 4 * cores, 16 * cores)
    ]
    show(f"{run}: {len(tasks)} jobs on {cores} workers", rows)
    keep("scaling_replay", rows)


def model() -> None:
    """Evaluate 1 to 1000 shots of 100 frames on 1 to 1000 nodes."""
    rows: list[Row] = []
    for shots in (1, 10, 100, 1000):
        for nodes in (1, 10, 100, 1000):
            tasks = [task for number in range(shots) for task in shot(number, 100, max(1, nodes // shots))]
            hours = replayed(tasks, nodes, HOP) / 3600
            work = sum(task.seconds for task in tasks) / 3600
            row: Row = {"frames": 100.0 * shots, "nodes": float(nodes), "jobs": float(len(tasks))}
            rows.append(
                {**row, "hours": hours, "node hours of work": work, "busy, %": 100 * work / hours / nodes}
            )
    show("Final frames, 1280 × 720, 64 samples, nodes of two cores", rows)
    keep("scaling", rows)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        check(Path(sys.argv[1]), named_run(Path(sys.argv[1]), next(iter(sys.argv[2:]), None)))
    else:
        model()
        show("Targets", [target.row for target in planning.main()])
