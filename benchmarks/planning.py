"""`python -m benchmarks.planning [--before DIR] [--shots 18 90]`: planning and status of the gallery.

The gallery's shots in a folder of their own, with an edit of all; of more shots than it has, copies of other
edge lengths. Each case is a command in a process of its own: CPU seconds of all its threads, wall time, and
the most memory that it held at once. Kernels are compiled before; what planning remembers for the user begins
empty.

1. A new clone of the gallery: `status` and a plan of the film before a run has begun, and where one has. The
   code of another checkout, DIR, does the same in turns with this one.
2. A production of so many shots: files that should exist are dummies under the right keys, so nothing is
   rendered; cameras are real and stand still.

Prints a table of each; writes `benchmarks/out/planning.json` and `planning_production.json`.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from contextlib import chdir
from pathlib import Path
from statistics import mean
from typing import NamedTuple

import platformdirs

from benchmarks.orchestration import CORES, fill, graph_line
from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.store.paths import STATE
from flowsculpt.pipeline.production.store.store import Store

HERE = Path(__file__).parents[1]

GALLERY = 18
"""Shots of the gallery."""

SIZES = (GALLERY, 90)
"""Shots of a production."""

REPEATS = 2
"""Times that each case of a new clone is measured; their mean counts."""

MOST_FIRST, MOST_AGAIN = 4.0, 0.5
"""Targets for the gallery in a new clone: CPU seconds of `status`."""

MOST_SECONDS, MOST_STATUS_SECONDS, MOST_MB = 15.0, 3.0, 1000.0
"""Targets for the largest film: CPU seconds of a plan, of `status`, and memory of each."""

STATUS, PLAN, FILM = ("status",), ("--dry-run", "film"), ("film",)


class Cost(NamedTuple):
    """Costs of a process: CPU seconds, seconds of wall time, and memory at its peak, megabytes."""

    cpu: float
    wall: float
    megabytes: float


class Commands:
    """The commands of a checkout, which remember what they plan in a folder of their own."""

    def __init__(self, checkout: Path, cache: Path) -> None:
        """Run the code of `checkout`; `cache` becomes the user's cache folder, with the kernels of now."""
        python = sys.executable if checkout == HERE else checkout / ".venv/bin/python"
        self._line = [str(python), "-m", "flowsculpt", "--no-progress", "-j", str(CORES)]
        self._environment = {**os.environ, "PYTHONPATH": str(checkout), "XDG_CACHE_HOME": str(cache)}
        self._cache = cache / "flowsculpt"
        self._cache.mkdir(parents=True, exist_ok=True)
        for known in platformdirs.user_cache_path("flowsculpt").glob("*"):
            if known.name != "planning" and not (self._cache / known.name).exists():
                (self._cache / known.name).symlink_to(known)

    def cost(self, *words: str) -> Cost:
        """Return what a command takes. Raises CalledProcessError where it fails."""
        return spent([*self._line, *words], self._environment)

    def forget(self) -> None:
        """Remove all that planning remembers."""
        for folder in (STATE / "planning", self._cache / "planning"):
            shutil.rmtree(folder, ignore_errors=True)


def main(before: Path | None = None, sizes: Sequence[int] = SIZES) -> list[Target]:
    """Measure all cases, print the tables and write the numbers; return the targets."""
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # each process would compile us again, as no user's does
    with tempfile.TemporaryDirectory() as cache:
        now = Commands(HERE, Path(cache))
        others = {"before": Commands(before, Path(cache))} if before else {}
        clone = new_clone({**others, "now": now})
        show("A new clone, CPU seconds", clone)
        keep("planning", clone)
        rows, targets = list[Row](), list(_targets_of_clone(clone))
        for shots in sizes:
            with tempfile.TemporaryDirectory() as folder, chdir(folder):
                frames = write_gallery(shots)
                now.forget()
                for case, cost in production(now):
                    size: Row = {"case": case, "shots": float(shots), "frames": float(frames)}
                    rows.append({**size, "CPU s": cost.cpu, "wall time, s": cost.wall, "MB": cost.megabytes})
                    if shots == sizes[-1] and case.startswith(("plan", "status")):
                        most = MOST_STATUS_SECONDS if case.startswith("status") else MOST_SECONDS
                        targets.append(Target(f"{shots} shots", f"{case}: CPU s", cost.cpu, most=most))
                        targets.append(Target(f"{shots} shots", f"{case}: MB", cost.megabytes, most=MOST_MB))
    show("A production", rows)
    keep("planning_production", rows)
    return targets


def new_clone(codes: dict[str, Commands]) -> list[Row]:
    """Return what `status` and a plan take of each code, before and after a run has begun."""
    costs: dict[tuple[str, str], list[float]] = {}
    for repeat in range(REPEATS + 1):  # the first compiles what is missing, modules and kernels
        for name, commands in codes.items():
            for begun in ("new clone", "a run has begun"):
                with tempfile.TemporaryDirectory() as folder, chdir(folder):
                    write_gallery(GALLERY)
                    if begun != "new clone":
                        STATE.mkdir()
                    for what, words in (("status", STATUS), ("plan of the film", PLAN)):
                        commands.forget()
                        for when in ("first", "again"):
                            cost = commands.cost(*words)
                            if repeat:
                                costs.setdefault((f"{what}, {begun}, {when}", name), []).append(cost.cpu)
    cases = dict.fromkeys(case for case, _ in costs)
    return [{"case": case, **{name: mean(costs[case, name]) for name in codes}} for case in cases]


def production(commands: Commands) -> Iterator[tuple[str, Cost]]:
    """Yield the cases in the order of a production, each with what it took."""
    STATE.mkdir()
    yield "plan, nothing made, first", commands.cost(*PLAN)
    yield "plan, nothing made", commands.cost(*PLAN)
    yield "Snakemake's graph of that plan", spent(graph_line(_plan()), dict(os.environ))
    fill(_plan(), 0.5)
    commands.forget()
    yield "plan, half made, first", commands.cost(*PLAN)
    yield "plan, half made", commands.cost(*PLAN)
    fill(_plan())
    commands.forget()
    yield "plan, all made, first", commands.cost(*PLAN)
    _show_all()
    yield "film, nothing to be done", commands.cost(*FILM)
    yield "status", commands.cost(*STATUS)
    edited = min(Path("shots").glob("A010*.yaml"))
    edited.write_text(edited.read_text().replace("max_edge_length: 0.0", "max_edge_length: 0.1"))
    yield "plan, one shot edited", commands.cost(*PLAN)
    yield "status, one shot edited", commands.cost(*STATUS)


def write_gallery(shots: int) -> int:
    """Write so many shots of the gallery to `shots/`, and a film of all; return their frames.

    Copies have other edge lengths, so that no two shots share a file.
    """
    gallery = sorted(path for path in (HERE / "shots").glob("*.yaml") if "frames:" in path.read_text())
    gallery = [path for path in gallery if path.stem not in ("film", "showreel")]
    Path("shots").mkdir()
    shutil.copy(HERE / "shots/pulse.opus", "shots")
    shutil.copytree(HERE / "shots/models", "shots/models")
    names, frames = [], 0
    for number in range(shots):
        copy, place = divmod(number, len(gallery))
        text = gallery[place].read_text()
        text = re.sub(r"(max_edge_length: |coarsest: |finest: )(0\.\d+)", rf"\g<1>\g<2>{copy or ''}", text)
        names.append(f"{gallery[place].stem}_{copy}")
        Path(f"shots/{names[-1]}.yaml").write_text(text)
        frames += int(re.findall(r"^frames: 1-(\d+)", text, re.M)[0])
    Path("shots/film.yaml").write_text(f"title: Planned\nrate: 24\nshots: [{', '.join(names)}]\n")
    return frames


def _plan() -> Plan:
    return Project(Path.cwd(), CORES).film("draft")


def _show_all() -> None:
    """Link all that a plan shows, without digests: for each link, recording its digest takes longest."""
    store = Store(Path.cwd())
    for link in _plan().links:
        target = Path(link.target)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.hardlink_to(store.path(link.kind, link.key))


_MEASURE = """
import os, subprocess, sys, time
begun = time.perf_counter()
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
_, status, used = os.wait4(process.pid, 0)
print(used.ru_utime + used.ru_stime, time.perf_counter() - begun, used.ru_maxrss * 1024 / 1e6)
sys.exit(status != 0)
"""
"""Measures a process from a small one: Linux counts what its parent held as its own memory."""


def spent(line: Sequence[str], environment: dict[str, str]) -> Cost:
    """Run a process and measure it. Raises CalledProcessError where it fails."""
    words = [sys.executable, "-I", "-S", "-c", _MEASURE, *line]
    done = subprocess.run(words, check=True, capture_output=True, text=True, env=environment)
    return Cost(*map(float, done.stdout.split()))


def _targets_of_clone(rows: Sequence[Row]) -> Iterator[Target]:
    """Yield the targets of `status` in a new clone."""
    for row in rows:
        if str(row["case"]).startswith("status"):
            most = MOST_FIRST if str(row["case"]).endswith("first") else MOST_AGAIN
            yield Target("the gallery", f"{row['case']}: CPU s", float(row["now"]), most=most)


if __name__ == "__main__":
    parser = ArgumentParser()
    parser.add_argument("--before", type=Path)
    parser.add_argument("--shots", type=int, nargs="*", default=SIZES)
    given = parser.parse_args()
    show("Targets", [target.row for target in main(given.before, given.shots)])
