"""`python -m benchmarks.planning [SHOTSxFRAMES …]`: planning a film and its status, by shots and frames.

Films of twisted boxes of several sizes, each in a folder of its own. Files that should exist are dummies
under the right keys, so nothing is rendered; cameras are real and stand still. Each case is a command in a
process of its own: CPU seconds of all its threads, seconds by the clock, and the most memory that it held at
once.

A model is fitted to the CPU seconds of each case where three sizes or more are measured: a fixed part, a part
for each shot and one for each frame. Relative errors count, so that small films weigh as much as large ones.
Prints a table of measurements beside the model, and one of the model; writes `benchmarks/out/planning.json`
and `planning_model.json`. A hundred shots of 1000 frames take 2 GB of disk and some minutes.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import chdir
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.orchestration import CORES, command_line, environment, fill, graph_line, write_shots
from benchmarks.report import Row, Target, keep, show
from pipeline.production.execution.project import Project
from pipeline.production.planning.plan import Plan
from pipeline.production.store.paths import STATE
from pipeline.production.store.store import Store

SIZES = ((10, 100), (10, 1000), (100, 100), (100, 1000))
"""Shots, and frames of each."""

MOST_SECONDS, MOST_STATUS_SECONDS, MOST_MB = 15.0, 3.0, 1000.0
"""Targets for a hundred shots of 1000 frames: CPU seconds of a plan, of `status`, and memory of each."""

PLAN = ("film", "--dry-run")


class Cost(NamedTuple):
    """Costs of a process: CPU seconds, seconds by the clock, and memory at its peak, megabytes."""

    cpu: float
    clock: float
    megabytes: float


def main(sizes: Sequence[tuple[int, int]] = SIZES) -> list[Target]:
    """Measure all cases at all sizes, print the tables and write the numbers; return the targets."""
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # each process would compile us anew, as no user's does
    costs: dict[str, dict[tuple[int, int], Cost]] = {}
    for shots, frames in sizes:
        with tempfile.TemporaryDirectory() as folder, chdir(folder):
            for case, cost in cases(shots, frames):
                print(f"{shots} × {frames}, {case}: {cost.cpu:.1f} s", file=sys.stderr, flush=True)
                costs.setdefault(case, {})[shots, frames] = cost
    rows, parts = list[Row](), list[Row]()
    for case, measured in costs.items():
        model = fitted(measured) if len(measured) >= 3 else None
        if model is not None:
            parts.append({"case": case, "fixed, s": model[0], "ms a shot": model[1], "µs a frame": model[2]})
        for (shots, frames), cost in measured.items():
            predicted = "" if model is None else model @ _terms(shots, frames)
            size: Row = {"case": case, "shots": float(shots), "frames of each": float(frames)}
            taken: Row = {"s of a core": cost.cpu, "s by the clock": cost.clock, "MB": cost.megabytes}
            rows.append({**size, **taken, "model, s": predicted})
    show("Planning", rows)
    show("The model of planning", parts)
    keep("planning", rows)
    keep("planning_model", parts)
    return [target for case, measured in costs.items() for target in _targets(case, measured)]


def cases(shots: int, frames: int) -> Iterator[tuple[str, Cost]]:
    """Yield the cases in the order of a production, each with what it took."""
    names = write_shots(shots, frames)
    Path("shots/film.yaml").write_text(f"title: Planned\nrate: 24\nshots: [{', '.join(names)}]\n")
    yield "plan, nothing made, first time", cost_of(*PLAN)
    yield "plan, nothing made", cost_of(*PLAN)
    yield "Snakemake's graph of that plan", _spent(graph_line(_plan()))
    fill(_plan(), 0.5)
    _forget()
    yield "plan, half made, first time", cost_of(*PLAN)
    yield "plan, half made", cost_of(*PLAN)
    fill(_plan())
    _forget()
    yield "plan, all made, first time", cost_of(*PLAN)
    _show_all()
    yield "film, nothing to be done", cost_of("film")
    yield "status", cost_of("status")
    edited = Path(f"shots/{names[0]}.yaml")
    edited.write_text(
        edited.read_text().replace("elevation: 14", "elevation: 15").replace("y, amount", "x, amount")
    )
    yield "plan, one shot edited", cost_of(*PLAN)
    yield "status, one shot edited", cost_of("status")


def fitted(measured: dict[tuple[int, int], Cost]) -> np.ndarray:
    """Return the model (3,) of CPU seconds: s, ms a shot and µs a frame, by least relative squares."""
    terms = np.array([_terms(*size) for size in measured])
    seconds = np.array([cost.cpu for cost in measured.values()])
    return np.linalg.lstsq(terms / seconds[:, None], np.ones(len(seconds)), rcond=None)[0]


def cost_of(*words: str) -> Cost:
    """Return what a command of flowsculpt takes."""
    return _spent(command_line(*words))


def _terms(shots: int, frames: int) -> np.ndarray:
    return np.array([1.0, 1e-3 * shots, 1e-6 * shots * frames])


def _plan() -> Plan:
    return Project(Path.cwd(), CORES).film("draft")


def _show_all() -> None:
    """Link all that a plan shows, without digests: for each link, recording its digest takes longest."""
    store = Store(Path.cwd())
    for link in _plan().links:
        target = Path(link.target)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.hardlink_to(store.path(link.kind, link.key))


def _forget() -> None:
    """Remove the planning cache."""
    shutil.rmtree(STATE / "planning", ignore_errors=True)


_MEASURE = """
import os, subprocess, sys, time
begun = time.perf_counter()
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
_, status, used = os.wait4(process.pid, 0)
print(used.ru_utime + used.ru_stime, time.perf_counter() - begun, used.ru_maxrss * 1024 / 1e6)
sys.exit(status != 0)
"""
"""Measures a process from a small one: Linux counts what its parent held as its own memory."""


def _spent(line: Sequence[str]) -> Cost:
    """Run a process and measure it. Raises CalledProcessError where it fails."""
    words = [sys.executable, "-I", "-S", "-c", _MEASURE, *line]
    done = subprocess.run(words, check=True, capture_output=True, text=True, env=environment())
    return Cost(*map(float, done.stdout.split()))


def _targets(case: str, measured: dict[tuple[int, int], Cost]) -> Iterator[Target]:
    """Yield the targets of a case: of the largest film, if that was measured."""
    cost = measured.get(SIZES[-1])
    if cost is not None and case.startswith(("plan", "status")):
        work = "{} × {} frames".format(*SIZES[-1])
        most = MOST_STATUS_SECONDS if case.startswith("status") else MOST_SECONDS
        yield Target(work, f"{case}: s of a core", cost.cpu, most=most)
        yield Target(work, f"{case}: MB", cost.megabytes, most=MOST_MB)


if __name__ == "__main__":
    asked = [tuple(map(int, word.split("x"))) for word in sys.argv[1:]]
    show("Targets", [target.row for target in main([(shots, frames) for shots, frames in asked] or SIZES)])
