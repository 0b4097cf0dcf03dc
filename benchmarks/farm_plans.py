"""`python -m benchmarks.farm_plans [ROOT]`: exported plans on 2 to 256 nodes, over the shortest time.

The gallery's film and one shot are planned for nodes of four cores, and their tasks are scheduled: a free
node takes the next task whose steps before are done. A task takes its start, and the estimates of its frames:
what runs under ROOT took, else typical times. Motion takes one core, all else four. The ideal is all work
without starts over the nodes, at least the longest chain: surfaces, one frame rendered and finished, movies.
Before, each task had eight frames.

A second table counts what the finishing tasks of a shot denoise, for each frame that is asked for: where each
task denoises all that it reads, where tasks follow each other, and where all begin at once, as far apart as
one frame takes: then two may denoise the same frame at the same time.
"""

from __future__ import annotations

import heapq
import random
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import chdir
from pathlib import Path

from benchmarks.report import Row, Target, keep, show
from benchmarks.scaling import Task, replayed
from flowsculpt.pipeline.plugins.farm.farm_steps import STEPS, FarmStep, steps_of
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.batches import even_batches
from flowsculpt.pipeline.production.planning.estimate import MeanTimings
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.planning.profile import START_OF_TASK, THREADS

NODES = (2, 8, 16, 64, 256)

BEFORE = 8
"""Frames of each task before tasks were sized by time."""

WORKS = {"the film": "film", "A010_cube": "A010_cube"}

MOST = 1.5
"""Target of a final film on FARM nodes, over the ideal."""

FARM = 64

SIZES = (2, 8, 64)
"""Frames of the finishing tasks whose denoised frames are counted."""

MOST_DENOISED = 1.05
"""Target for the frames denoised, over those asked for, where batches follow each other."""

AVERAGING = 0.5
"""Time to average a frame, over the time to denoise one."""


def main(root: Path | None = None) -> list[Target]:
    """Schedule all plans, print the tables and write the numbers; return the targets."""
    rows, targets = list[Row](), list[Target]()
    with tempfile.TemporaryDirectory() as empty, chdir(Path(__file__).parents[1]):
        project = Project(root or Path(empty), 2, variant="scalar_rgb")
        timings = MeanTimings(project.root)
        for title, name in WORKS.items():
            for quality in ("draft", "daily", "final"):
                for nodes in NODES:
                    plan = project.whole([name], quality, nodes=nodes)
                    now, before = (replayed(list(tasks(plan, timings, n)), nodes) for n in (None, BEFORE))
                    best = ideal(plan, timings, nodes)
                    sizes: Row = {step.kind: float(step.chunk) for step in steps_of(plan) if step.frames}
                    about: Row = {"work": title, "quality": quality, "nodes": float(nodes), **sizes}
                    rows.append({**about, "ideal, s": best, "before": before / best, "now": now / best})
                    if (title, quality, nodes) == ("the film", "final", FARM):
                        targets.append(
                            Target("final film, 64 nodes", "over the ideal", now / best, most=MOST)
                        )
        counts = [count_denoised(project.whole(["A010_cube"], "final"), size) for size in SIZES]
    show("Exported plans: time over the ideal", rows)
    keep("farm_plans", rows)
    show("Frames denoised, for each frame of A010_cube at final", counts)
    keep("farm_denoised", counts)
    for row in counts:
        name = f"batches of {row['frames']:g}, one after the other"
        targets.append(Target(name, "denoised, over asked", float(row["in turn"]), most=MOST_DENOISED))
    return targets


def seconds(step: FarmStep, timings: MeanTimings, stage: str) -> float:
    """Return what a node takes for a frame of a stage of a step."""
    job = next(job for job in step.jobs if job.stage == stage)
    cores = THREADS if STEPS[step.kind][0] != "simulate" else 1
    return timings.expected(stage, step.plan.requests[job.requests[0]]) / cores


def step_seconds(step: FarmStep, timings: MeanTimings) -> float:
    """Return what a node takes for all of a step."""
    return sum(len(job.frames) * seconds(step, timings, job.stage) for job in step.jobs)


def tasks(plan: Plan, timings: MeanTimings, chunk: int | None) -> Iterator[Task]:
    """Yield the tasks of a plan, of `chunk` frames, or of as many as the plan says."""
    steps, made = steps_of(plan), list[list[str]]()
    for place, step in enumerate(steps):
        after = tuple(name for other in step.after for name in made[other])
        if step.frames:
            each = seconds(step, timings, STEPS[step.kind][0])
            parts = even_batches(step.frames, chunk or step.chunk)
            lengths = [each * len(part) for part in parts]
        else:
            lengths = [step_seconds(step, timings)]
        made.append([f"{place}.{number}" for number in range(len(lengths))])
        for name, length in zip(made[-1], lengths, strict=True):
            yield Task(name, after, START_OF_TASK + length, urgency=-place)


def ideal(plan: Plan, timings: MeanTimings, nodes: int) -> float:
    """Return all work over the nodes, at least the longest chain, seconds."""
    steps = steps_of(plan)
    work = sum(step_seconds(step, timings) for step in steps)
    chains: list[float] = []
    for step in steps:
        own = seconds(step, timings, STEPS[step.kind][0]) if step.frames else step_seconds(step, timings)
        chains.append(own + max((chains[other] for other in step.after), default=0.0))
    return max(work / nodes, *chains)


def count_denoised(plan: Plan, size: int) -> Row:
    """Return the frames that tasks of `size` frames denoise, over those that they finish."""
    (request,) = plan.requests
    batches = even_batches(request.requested, size)
    windows = {n: request.pictures.window(n, request.requested.__contains__) for n in request.requested}
    alone = sum(len({other for n in batch for other in windows[n]}) for batch in batches)
    asked = len(request.requested)
    return {
        "frames": float(size),
        "without sharing": alone / asked,
        "in turn": denoised(batches, windows, [1e6 * i for i in range(len(batches))]) / asked,
        "at once": denoised(batches, windows, [random.Random(i).random() for i in range(len(batches))])
        / asked,
    }


def denoised(
    batches: Sequence[Sequence[int]], windows: dict[int, tuple[int, ...]], starts: Sequence[float]
) -> int:
    """Return how many frames batches denoise that begin at `starts`, in the seconds that one takes.

    As tasks do: each begins with its own frames that others need, and finds what others have left.
    """
    left: dict[int, float] = {}
    known: list[set[int]] = [set() for _ in batches]
    orders = [_order(batch, windows) for batch in batches]
    queue = [(start, number, 0) for number, start in enumerate(starts)]
    heapq.heapify(queue)
    count = 0
    while queue:
        now, number, done = heapq.heappop(queue)
        if done == len(orders[number]):
            continue
        frame = orders[number][done]
        if frame is None:
            heapq.heappush(queue, (now + AVERAGING, number, done + 1))
        elif frame in known[number] or left.get(frame, now + 1.0) <= now:
            heapq.heappush(queue, (now, number, done + 1))
        else:
            count += 1
            known[number].add(frame)
            left.setdefault(frame, now + 1.0)
            heapq.heappush(queue, (now + 1.0, number, done + 1))
    return count


def _order(batch: Sequence[int], windows: dict[int, tuple[int, ...]]) -> list[int | None]:
    """Return the frames that a batch needs in turn; None averages the frames before it."""
    others = windows.keys() - set(batch)
    own: list[int | None] = [n for n in batch if any(n in windows[other] for other in others)]
    for number in batch:
        own += [*windows[number], None]
    return own


if __name__ == "__main__":
    show("Targets", [target.row for target in main(*map(Path, sys.argv[1:2]))])
