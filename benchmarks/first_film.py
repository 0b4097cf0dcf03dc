"""`python -m benchmarks.first_film`: the waits of the first hour, from a bare clone.

Set-up, the kernels alone, `make film`, and the first draft frame of four kinds of new shots. Packages come
from pip's cache as it is; nothing else is cached. Seconds by the clock, and CPU seconds of all processes,
which other work lengthens less. `python -m benchmarks.first_film frames` measures the frames alone, and
`look` what a terminal shows of the film before it is done, in this checkout.

What stands beside them:
    set-up           a copy of the files that it writes, and the kernels
    kernels, film    their CPU time, shared evenly by the cores
    a frame          a bare script in one process: our simulation of the shot, whose frames all decide the
                     camera, and Mitsuba's own path tracer, without points, denoiser, store or Snakemake
"""

from __future__ import annotations

import os
import pty
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.mesh import torus

CHECKOUT = Path(__file__).parents[1]

KINDS = {
    "cube, twisted": ("--from", "twist"),
    "imported model, 8 thousand faces": ("--model", "model.obj"),
    "ball in Lorenz's flow": ("--from", "lorenz"),
    "20 thousand points": ("--from", "points.yaml"),
}
"""Kinds of new shots, and how `flowsculpt new` is asked for each."""

POINTS = """
title: Points
frames: 1-72
subject: {cloud: {solid: icosphere, radius: 0.75}, count: 20000, radius: 0.011}
flows:
  - twist: {axis: y, amount: {keys: {1: 0, 64: 80}}}
"""

SCRIPT = """
import sys
from flowsculpt.render.mitsuba.engine import choose
choose().start()
import mitsuba as mi
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.shot import read_shot
frames = [frame.mesh for frame in animate(read_shot(sys.argv[1]))]
mesh = frames[0]
shapes = {}
if len(mesh.faces):
    shape = mi.Mesh("subject", len(mesh.vertices), len(mesh.faces))
    parameters = mi.traverse(shape)
    parameters["vertex_positions"] = mesh.vertices.astype("float32").ravel()
    parameters["faces"] = mesh.faces.astype("uint32").ravel()
    parameters.update()
    shapes["subject"] = shape
camera = mi.ScalarTransform4f().look_at([4, 2, 4], [0, 0, 0], [0, 1, 0])
film = {"type": "hdrfilm", "width": 480, "height": 270}
sensor = {"type": "perspective", "to_world": camera, "film": film, "sampler": {"type": "independent"}}
lit = {"type": "scene", "integrator": {"type": "path", "max_depth": 8}, "sensor": sensor}
scene = mi.load_dict({**lit, "sky": {"type": "constant"}, **shapes})
mi.util.write_bitmap("script.exr", mi.render(scene, spp=4), write_async=False)
"""


class Cost(NamedTuple):
    """Seconds by the clock and CPU seconds."""

    clock: float
    processor: float


def main(words: Sequence[str] = ()) -> list[Target]:
    """Measure what the words name, by default everything; return the targets."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows: list[Row] = []
        if "look" in words:
            looks = measure_look(folder, CHECKOUT / ".venv/bin/flowsculpt")
            show("What a terminal shows of the film", looks)
            keep("first_look", looks)
            return [Target("animatic", "seconds", float(looks[0]["seconds"]), most=30.0)]
        if "frames" in words:
            flowsculpt, environment = CHECKOUT / ".venv/bin/flowsculpt", dict(os.environ)
        else:
            subprocess.run(["git", "clone", "--quiet", str(CHECKOUT), str(folder / "clone")], check=True)
            environment = _bare_environment(folder)
            flowsculpt = folder / "clone/.venv/bin/flowsculpt"
            rows += measure_set_up(folder / "clone", environment)
        frames = measure_frames(folder / "show", flowsculpt, environment)
    keep("first_film", [*rows, *frames])
    if rows:
        show("From a bare clone", rows)
    show("The first draft frame of a new shot", frames)
    seconds = {str(row["what"]): float(row["seconds"]) for row in rows}
    targets = [
        Target(what, "seconds", seconds[what], most=most)
        for what, most in (("kernels", 90.0), ("set-up and film", 300.0))
        if rows
    ]
    return [*targets, *(Target(str(r["shot"]), "CPU seconds", float(r["CPU s"]), most=8.0) for r in frames)]


def measure_set_up(clone: Path, environment: dict[str, str]) -> list[Row]:
    """Measure set-up, the film that follows it, and the kernels once more alone."""
    cores = len(os.sched_getaffinity(0))
    ready = run(["make", ".venv/ready"], clone, environment)
    copied = run(["cp", "-r", ".venv", "copy"], clone, environment)
    shutil.rmtree(clone / "copy")
    film = run(["make", "film"], clone, environment)
    shutil.rmtree(Path(environment["XDG_CACHE_HOME"]) / "flowsculpt/kernels")
    kernels = run([".venv/bin/flowsculpt", "doctor", "--prepare"], clone, environment)
    total = Cost(ready.clock + film.clock, ready.processor + film.processor)
    return [
        row("set-up", ready, copied.clock + kernels.processor / cores),
        row("kernels", kernels, kernels.processor / cores),
        row("film", film, film.processor / cores),
        row("set-up and film", total, copied.clock + (kernels.processor + film.processor) / cores),
    ]


def measure_frames(root: Path, flowsculpt: Path, environment: dict[str, str]) -> list[Row]:
    """Measure the first draft frame of each kind of shot, and the bare script beside it."""
    root.mkdir(parents=True)
    shutil.copytree(CHECKOUT / "shots", root / "shots")
    (root / "points.yaml").write_text(POINTS)
    write_model(root / "model.obj")
    rows: list[Row] = []
    for number, (kind, words) in enumerate(KINDS.items()):
        name = f"S{number}"
        subprocess.run([flowsculpt, "new", name, *words], cwd=root, env=environment, check=True)
        frame = run([flowsculpt, "render", name, "-f", "1", "--no-progress"], root, environment)
        python = flowsculpt.with_name("python")
        script = run([python, "-c", SCRIPT, f"shots/{name}.yaml"], root, environment)
        plain: Row = {"script, CPU s": script.processor, "script, s": script.clock}
        rows.append({"shot": kind, "CPU s": frame.processor, "s": frame.clock, **plain})
    return rows


def measure_look(root: Path, flowsculpt: Path) -> list[Row]:
    """Measure when a terminal names the animatic of the film and its first finished frame; stop it there."""
    shutil.copytree(CHECKOUT / "shots", root / "shots")
    began = time.perf_counter()
    process, terminal = pty.fork()
    if process == 0:
        os.chdir(root)
        os.execve(flowsculpt, [flowsculpt, "film"], {**os.environ, "CI": "", "COLUMNS": "200"})
    said, rows = "", list[Row]()
    for what in ("Animatic: ", "First finished frame: "):
        while what not in said:
            said += os.read(terminal, 65536).decode(errors="replace")
        rows.append({"what": what.removesuffix(": "), "seconds": time.perf_counter() - began})
    os.write(terminal, b"\x03")
    with suppress(OSError):  # raised once the command has ended
        while os.read(terminal, 65536):
            pass
    os.waitpid(process, 0)
    return rows


def write_model(path: Path) -> None:
    """Write a torus as OBJ, its faces in one group, as modellers export them."""
    mesh = torus(0.9, 0.36, 0.075)
    vertices = "".join(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in mesh.vertices)
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in np.asarray(mesh.faces) + 1)
    path.write_text(f"o torus\n{vertices}{faces}")


def row(what: str, cost: Cost, limit: float) -> Row:
    """Return a row of the table of set-up."""
    return {"what": what, "seconds": cost.clock, "CPU seconds": cost.processor, "limit, seconds": limit}


def run(command: Sequence[str | Path], folder: Path, environment: dict[str, str]) -> Cost:
    """Run a command to its end; return what it and all its processes took. Raises CalledProcessError."""
    before, started = _children_seconds(), time.perf_counter()
    subprocess.run(command, cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)
    return Cost(time.perf_counter() - started, _children_seconds() - before)


def _children_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _bare_environment(folder: Path) -> dict[str, str]:
    """Return an environment whose caches are empty, but for pip's."""
    pip = [sys.executable, "-m", "pip", "cache", "dir"]
    packages = subprocess.run(pip, capture_output=True, text=True, check=True).stdout.strip()
    ours = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return {**ours, "XDG_CACHE_HOME": str(folder / "cache"), "PIP_CACHE_DIR": packages}


if __name__ == "__main__":
    show("Targets", [target.row for target in main(sys.argv[1:])])
