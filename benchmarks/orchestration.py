"""`python -m benchmarks.orchestration [FRAMES]`: the cost of planning and running jobs, without their work.

Shots of a twisted box, 1000 frames each, in a folder of their own. Where files should exist already, the
store is filled with dummies under the right keys, and nothing is rendered. Orchestration is a run of a plan
that was made for an empty store while the store holds everything: Snakemake runs every job, in processes of
its own, and each job finds its frames and links them. Simulation is left out: it has only its last frame to
find. The status is listed after twenty runs, each of which logged every frame of ten shots.

Targets are compared with the CPU seconds of all cores together; for a run on two cores with half of them,
because the clock of a busy machine says more.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import chdir
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

from benchmarks.report import Target, keep, show
from flowsculpt.pipeline.production.execution import snakemake
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.planning.profile import Profile
from flowsculpt.pipeline.production.request.framing import Framing
from flowsculpt.pipeline.production.store.event_log import RUNS
from flowsculpt.pipeline.production.store.history import summarise
from flowsculpt.pipeline.production.store.paths import EVENTS, STATE
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.base.serialise import to_plain
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.scene_stage import StagePlacement

CORES = 2
FEW, MANY = 10, 100
"""Shots that are planned at once."""

SHOT = """\
title: A box, twisted
frames: 1-{frames}
subject: {{solid: box, size: [2, 2, 2]}}
resample: {{max_edge_length: 0.5}}
flows:
  - twist: {{axis: y, amount: {{ease: linear, keys: {{1: 0, {frames}: {degrees}}}}}}}
camera: {{azimuth: {{keys: {{1: -30, {frames}: 30}}}}, elevation: 14}}
"""


class Spent(NamedTuple):
    """CPU seconds of all cores together, and seconds by the clock."""

    cpu: float
    clock: float


def main(frames: int = 1000) -> list[Target]:
    """Measure everything, print the table and write the numbers; return the targets."""
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # each process would compile us anew, as no user's does
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        names = write_shots(MANY, frames)
        lines = [*planning(names[:FEW], frames, most=6.0), *planning(names, frames, most=15.0)]
        lines += running(names[0], frames)
        lines += history(names[:FEW], frames)
    rows = [line.row for line in lines]
    show("Orchestration", rows)
    keep("orchestration", rows)
    return lines


def planning(names: list[str], frames: int, most: float) -> Iterator[Target]:
    """Measure planning with empty and with filled caches, and Snakemake's part."""
    work, words = f"{len(names)} × {frames} frames", ("render", *names, "-q", "draft")
    for when, bound in (("first plan", most), ("planned again", most)):
        spent = timed(lambda: command("--dry-run", *words))
        yield Target(work, f"{when}: s of a core", spent.cpu, most=bound)
        yield Target(work, f"{when}: s by the clock", spent.clock)
    plan = Project(Path.cwd(), CORES).pictures(names, "draft")
    spent = timed(lambda: snakemake_looks_at(plan))
    yield Target(work, f"Snakemake's graph of {len(plan.jobs)} jobs: s of a core", spent.cpu)


def running(name: str, frames: int) -> Iterator[Target]:
    """Measure a run of jobs that find all their outputs, and a run that has nothing to do."""
    plan = Project(Path.cwd(), CORES).pictures([name], "draft")
    fill(plan)
    work, spent = f"{frames} frames", timed(lambda: carry_out(plan))
    yield Target(work, "ms a frame, two cores", 1000 * spent.cpu / CORES / frames, most=10.0)
    yield Target(work, "ms a frame by the clock", 1000 * spent.clock / frames)
    for _ in range(2):  # the first notes the keys that it finds
        spent = timed(lambda: command("render", name, "-q", "draft"))
    yield Target(work, "nothing to be done: s of a core", spent.cpu, most=1.5)
    yield Target(work, "nothing to be done: s by the clock", spent.clock)


def history(names: list[str], frames: int) -> Iterator[Target]:
    """Measure `status` of finished shots after many runs, and the summary of one run."""
    plan = Project(Path.cwd(), CORES).pictures(names, "draft")
    fill(plan)
    Project(Path.cwd(), CORES).pictures(names, "draft").restore_links(Store(Path.cwd()))
    for number in range(RUNS):
        write_log(f"20260101-0000{number:02d}-1", names, frames)
        spent = timed(lambda: summarise(Path.cwd()))
    work = f"{len(names)} × {frames} frames after {RUNS} runs"
    yield Target(work, "summary of a run: s of a core", spent.cpu)
    process = subprocess.Popen(command_line("status", *names), stdout=subprocess.DEVNULL, env=environment())
    used = os.wait4(process.pid, 0)[2]
    yield Target(work, "status: s of a core", used.ru_utime + used.ru_stime, most=2.0)
    yield Target(work, "status: MiB", used.ru_maxrss / 1024.0, most=300.0)


def write_log(run: str, names: list[str], frames: int) -> None:
    """Write the event log of a run that made every frame of some shots."""
    path = EVENTS / f"{run}.jsonl"
    path.parent.mkdir(parents=True, exist_ok=True)
    stages = ("simulate", "smooth_normals", "frame_camera", "render", "finish")
    with path.open("w") as file:
        for name, stage in product(names, stages):
            about = {"job": f"{stage}_{name}", "stage": stage, "shot": name, "quality": "draft"}
            begin: dict[str, object] = {"event": "begin", "threads": 1, "process": 1, "host": platform.node()}
            events = [begin]
            for number in range(1, frames + 1):
                events += [
                    {"event": "start", "frame": number},
                    {"event": "frame", "frame": number, "found": False, "seconds": 0.5},
                ]
            events.append({"event": "end"})
            for event in events:
                file.write(json.dumps({"time": 1767225600.0, **about, **event}) + "\n")
        file.write(json.dumps({"time": 1767225600.0, "event": "ran", "job": ""}) + "\n")


def write_shots(count: int, frames: int) -> list[str]:
    """Write shots to `shots/` of the working folder, no two of which share meshes; return their names."""
    Path("shots").mkdir()
    STATE.mkdir()  # as of a root in which work has begun: there keys are remembered
    names = [f"P{number:03d}_box" for number in range(1, count + 1)]
    for number, name in enumerate(names):
        Path(f"shots/{name}.yaml").write_text(SHOT.format(frames=frames, degrees=60 + number))
    return names


def fill(plan: Plan, share: float = 1.0) -> None:
    """Put dummies into the store for the files of a plan's requests, and cameras that stand still.

    share  the part of each request's frames that are filled in, from the first on; movies only of all
    """
    framing = Framing(Camera((0.0, 1.0, 8.0), (0.0, 0.0, 0.0)), StagePlacement((0.0, -1.0, 0.0), 1.0, 0.0))
    store, clips = Project(Path.cwd(), CORES).store, []
    for request in plan.requests:
        cameras = json.dumps({str(number): to_plain(framing) for number in request.angles})
        store.put("cameras", request.keys.cameras, partial(_write, text=cameras))
        keys = request.keys.pictures(store)
        assert keys is not None
        clips.append(keys)
        held = request.requested[: int(share * len(request.requested))]
        files = [("mesh", part.keys.mesh(n)) for part in request.parts for n in held]
        files += [("normals", part.keys.normals(n)) for part in request.parts for n in held]
        files += [(kind, getattr(keys[n], kind)) for n in held for kind in ("raw", "frame")]
        if share == 1.0:
            files.append(("movie", request.keys.movie([keys[n].frame for n in sorted(held)])))
        keys.remember()  # as finding cameras does
        for kind, key in files:
            _put(store, kind, key, "a dummy")
    if plan.film is not None and share == 1.0:
        whole = [place for place, request in enumerate(plan.requests) if not request.source.subject]
        film = plan.film.key([plan.requests[place] for place in whole], [clips[place] for place in whole])
        _put(store, "movie", film, "a dummy")


def carry_out(plan: Plan) -> None:
    """Have Snakemake run all jobs of a plan but its simulations."""
    kept = replace(plan, jobs=tuple(job for job in plan.jobs if job.stage != "simulate"))
    kept.freeze(Path.cwd())
    with snakemake.running(kept, Path.cwd(), CORES, Profile.local()) as process:
        assert process.wait() == 0, "a job failed"


def snakemake_looks_at(plan: Plan) -> None:
    """Have Snakemake build the graph of a plan's jobs, and run none."""
    subprocess.run(graph_line(plan), check=True, stdout=subprocess.DEVNULL)


def graph_line(plan: Plan) -> list[str]:
    """Freeze a plan; return the arguments of a process in which Snakemake builds its graph and runs none."""
    rules = snakemake.snakefile()
    words = [sys.executable, "-m", "snakemake", "--snakefile", str(rules), "--cores", str(CORES)]
    words += ["--workflow-profile", str(rules.parent / "profiles/default"), "--quiet", "all"]
    return [*words, "--dry-run", "--config", f"plan={plan.freeze(Path.cwd())}"]


def command(*words: str) -> None:
    subprocess.run(command_line(*words), check=True, stdout=subprocess.DEVNULL, env=environment())


def command_line(*words: str) -> list[str]:
    """Return the arguments of the process of a command of flowsculpt."""
    return [sys.executable, "-m", "flowsculpt", "--no-progress", "-j", str(CORES), *words]


def environment() -> dict[str, str]:
    """Return the environment of processes: they run this checkout."""
    return {**os.environ, "PYTHONPATH": _room()}


def timed(work: Callable[[], None]) -> Spent:
    """Measure this process and the processes that `work` starts."""
    before, begun = _cpu(), time.perf_counter()
    work()
    return Spent(_cpu() - before, time.perf_counter() - begun)


def _cpu() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_CHILDREN, resource.RUSAGE_SELF)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


def _room() -> str:
    return str(Path(__file__).parents[1])


def _write(path: Path, text: str) -> None:
    path.write_text(text)


def _put(store: Store, kind: str, key: str, text: str) -> None:
    """Put a file into the store without flushing the disk, which takes most of the time of small files."""
    path = store.path(kind, key)
    try:
        path.write_text(text)
    except FileNotFoundError:
        path.parent.mkdir(parents=True)
        path.write_text(text)


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:2]))
