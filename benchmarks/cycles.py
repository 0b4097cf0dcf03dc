"""`python -m benchmarks.cycles [WIDTH REFERENCE [CELL …]]`: time to equal error, against Blender's Cycles.

A cell is a look and a light rig, such as `clay-studio`; by default all of LOOK_NAMES × RIG_NAMES are
measured. Cells that `benchmarks/out/cycles.json` holds already, for that width and reference, are only shown.
The scene is a torus, WIDTH pixels wide (160). Both renderers get the same triangles, stage, emitters, sun,
sky and lens, as many vertices to a path, a box filter and Intel's denoiser (see `benchmarks/blender.py`).
Each renders three seeds, raw and denoised. Seconds include building the scene, which both are given anew for
every picture, and the auxiliary features. Cycles denoises with the prefilter of features and without; what
reaches the error sooner counts.

Each renderer is compared with its own reference of REFERENCE samples (256), so that it does not matter which
of the two is right; the distance between the references is shown. The references' noise is estimated from
their halves, and subtracted. Errors are root mean squares of display values. The time of Cycles is
interpolated between its numbers of samples. Beyond them its error falls as between the last two, or as noise
does if that is faster.

The table has the CPU seconds of Cycles until the error of ours, over ours: the mean, and the least and most
of the seeds. Needs `benchmarks/requirements-cycles.txt`.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.equal_quality import Best
from benchmarks.errors import put, shown
from benchmarks.flicker import CAMERA, subject
from benchmarks.raw_files import as_read
from benchmarks.report import OUT, Row, Target, show
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.mitsuba.emitters import (
    daylight_exposure,
    daylight_irradiances,
    daylight_map,
)
from flowsculpt.render.mitsuba.engine import Engine, choose
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.post.denoise import denoise
from flowsculpt.render.post.image import read_exr
from flowsculpt.render.scene.materials import LOOKS, Glass, Material
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig, Softbox
from flowsculpt.render.scene.scene_stage import STAGES, Stage, StagePlacement
from flowsculpt.render.scene.surface import Surface

HOME = Path(os.environ.get("BLENDER_MODULE", Path(sys.prefix) / "cycles"))
LOOK_NAMES, RIG_NAMES = ("clay", "glaze", "chrome", "glass"), ("studio", "gallery", "daylight")
DEPTH, SEEDS = 6, 3
OURS, THEIRS = (16, 64), {"raw": (16, 64), "denoised": (4, 16, 64)}
"""Samples of both."""

COMPARED = {"raw": 64, "denoised": 16}
"""Samples of ours whose error Cycles is to reach."""

LEAST, LEAST_MEDIAN = {"raw": 1.3, "denoised": 2.0}, 3.0
"""Targets: the CPU time of Cycles over ours."""

_REFLECTED_INSIDE = 0.591
"""Diffuse light that a coat of index 1.49 reflects from inside (Egan and Hilgeman 1973)."""

PREFILTERS = {"raw": (None,), "denoised": ("NONE", "ACCURATE")}

Tries = dict[str, list[list[float]]]
"""CPU seconds and errors of each seed, by samples."""


@dataclass(frozen=True)
class Cell:
    """A look under a light rig."""

    name: str
    look: Material
    lights: LightRig
    stage: Stage

    @classmethod
    def named(cls, name: str) -> Cell:
        """Return a cell by its name. Glass is clear, since volumes that absorb would hold Cycles up."""
        look_name, rig = name.split("-")
        look = LOOKS[look_name]
        if isinstance(look, Glass):
            look = replace(look, absorption=None)
        stage = STAGES["ground" if rig == "daylight" else "cyclorama"]
        if look.stage_colour is not None:
            stage = replace(stage, colour=look.stage_colour)
        return cls(name, look, LIGHTS[rig], stage)

    @property
    def depth(self) -> int:
        """Vertices of a path."""
        return max(DEPTH, self.look.min_path_depth)

    def scene(self, surface: Surface) -> Scene:
        return Scene(surface, self.look, self.lights, self.stage, StagePlacement(), CAMERA)


@dataclass(eq=False)
class Cycles:
    """A running Blender."""

    room: Path
    process: Any
    version: str = ""

    def say(self, **wanted: Any) -> dict[str, Any]:
        self.process.stdin.write(json.dumps(wanted) + "\n")
        self.process.stdin.flush()
        return self.heard()

    def heard(self) -> dict[str, Any]:
        """Return the next line of JSON; Blender prints other lines too."""
        for line in self.process.stdout:
            if line.startswith("{"):
                return dict(json.loads(line))
        raise RuntimeError(f"Blender ended: {(self.room / 'blender.log').read_text()[-2000:]}")

    def rendered(
        self, surface: Surface, samples: int, prefilter: str | None, seed: int
    ) -> tuple[float, AnyArray]:
        """Return CPU seconds and the picture of a surface that Blender has not seen yet."""
        file = self.room / "subject.npz"
        np.savez(file, vertices=surface.vertices, normals=surface.normals, faces=surface.faces)
        self.say(mesh="subject.npz")
        said = self.say(samples=samples, prefilter=prefilter, seed=seed, to="picture.exr")
        layers, _ = read_exr(self.room / "picture.exr")
        return float(said["seconds"][1]), layers["beauty"].astype(np.float64)


@contextmanager
def cycles(room: Path, size: tuple[int, int], cell: Cell) -> Iterator[Cycles]:
    """Start Blender with stage, emitters and lens, without a subject."""
    vertices, normals, faces = cell.stage.mesh()
    np.savez(room / "stage.npz", vertices=vertices, normals=normals, faces=faces)
    axes = CAMERA.axes()
    lens = np.eye(4)
    lens[:3, :3], lens[:3, 3] = np.stack([axes[0], axes[1], -axes[2]], axis=1), CAMERA.origin
    daylight, look = cell.lights.daylight, cell.look
    np.save(
        room / "sky.npy",
        daylight_map(replace(daylight, sun=0.0)) if daylight else cell.lights.sky.pixels(),
    )
    told = {
        "size": size,
        "depth": cell.depth,
        "field_of_view": CAMERA.field_of_view,
        "camera": lens.tolist(),
        "sky": "sky.npy",
        "sky_visible": cell.lights.shows_sky,
        "sun": _sun(cell.lights),
        "lamps": [_lamp(box) for box in cell.lights.softboxes],
        "stage": "stage.npz",
        "stage_colour": cell.stage.colour,
        "look": {
            "model": look.model,
            "colour": _base_colour(look),
            "roughness": look.roughness,
            "refraction": look.refraction if isinstance(look, Glass) else 1.49,
        },
    }
    (room / "scene.json").write_text(json.dumps(told))
    program = Path(__file__).with_name("blender.py")
    process = subprocess.Popen(
        [sys.executable, "-P", str(program), str(room / "scene.json")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=(room / "blender.log").open("w"),
        text=True,
        env={**os.environ, "PYTHONPATH": str(HOME)},
    )
    try:
        blender = Cycles(room, process)
        blender.version = str(blender.heard()["blender"])
        yield blender
    finally:
        process.kill()
        process.wait()


def _base_colour(look: Material) -> list[float]:
    """Return the colour that makes a look of Cycles as bright as ours.

    Light that the inside of our plastic's coat reflects meets the body again (Mitsuba's `nonlinear`).
    """
    if look.model != "plastic":
        return list(look.colour)
    return [part * (1.0 - _REFLECTED_INSIDE) / (1.0 - part * _REFLECTED_INSIDE) for part in look.colour]


def _lamp(box: Softbox) -> dict[str, Any]:
    """Return an emitter's data; it shines along its -z axis, its y axis as vertical as possible."""
    matrix = _facing(np.subtract(box.position, box.target))
    matrix[:3, 3] = box.position
    return {
        "matrix": matrix.tolist(),
        "width": box.width,
        "height": box.height,
        "radiance": box.radiance,
    }


def _sun(lights: LightRig) -> dict[str, Any] | None:
    """Return the sun's data, or None for a rig without daylight."""
    if lights.daylight is None:
        return None
    strength = daylight_exposure(lights.daylight) * lights.daylight.sun
    irradiance = strength * daylight_irradiances(lights.daylight)[0]
    matrix = _facing(np.array(lights.daylight.direction))
    return {"matrix": matrix.tolist(), "irradiance": irradiance.tolist(), "width": lights.daylight.width}


def _facing(back: AnyArray) -> AnyArray:
    """Return the transform (4, 4) of an emitter that shines against `back`."""
    back = back / np.linalg.norm(back)
    up = (0.0, 1.0, 0.0) if math.hypot(back[0], back[2]) > 1e-3 else (0.0, 0.0, -1.0)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
    return matrix


@dataclass(eq=False)
class Truth:
    """A reference picture as two independent halves."""

    one: AnyArray
    two: AnyArray

    @property
    def mean(self) -> AnyArray:
        return np.asarray((self.one + self.two) / 2.0)

    def error(self, picture: AnyArray) -> float:
        """Return the rms difference of display values, steps of 255, without the reference's own noise."""
        own = float(((shown(self.one) - shown(self.two)) ** 2).mean()) / 4.0
        square = float(((shown(picture) - shown(self.mean)) ** 2).mean()) - own
        return 255.0 * math.sqrt(max(square, 1e-10))


def measure(cell: Cell, size: tuple[int, int], reference: int, engine: Engine) -> dict[str, Any]:
    """Return the tries of both renderers in a cell, and how far apart their references are."""
    surface = subject(0.0)
    ours = _try_ours(cell, surface, size, reference, engine)
    with tempfile.TemporaryDirectory() as folder, cycles(Path(folder), size, cell) as blender:
        blender.rendered(surface, 1, "ACCURATE", 1)
        truth = Truth(*(blender.rendered(surface, reference // 2, None, 900 + i)[1] for i in (0, 1)))
        tries: dict[str, Tries] = {}
        for kind, prefilters in PREFILTERS.items():
            for prefilter in prefilters:
                tried = tries.setdefault(kind if prefilter is None else f"{kind} {prefilter}", {})
                for samples in THEIRS[kind]:
                    for seed in range(SEEDS):
                        seconds, picture = blender.rendered(surface, samples, prefilter, 10 * seed + samples)
                        tried.setdefault(str(samples), []).append([seconds, truth.error(picture)])
        version = blender.version
    put(f"cycles_{cell.name}", {"ours": ours["truth"].mean, "Cycles": truth.mean})
    means = [shown(each.mean).mean() for each in (ours["truth"], truth)]
    return {
        "blender": version,
        "ours": ours["tries"],
        "Cycles": tries,
        "apart": ours["truth"].error(truth.mean),
        "brightness": means[1] / means[0],
    }


def _try_ours(
    cell: Cell, surface: Surface, size: tuple[int, int], reference: int, engine: Engine
) -> dict[str, Any]:
    """Return our tries and our reference, without the bound on fireflies, which spreads light."""
    quality = Quality(*size, samples=16, depth=cell.depth, auxiliary_samples=16)
    halves = []
    for seed in (
        7000,
        7001,
    ):  # of photons too: a scene has one picture of them, which both halves would share
        tracer = build_scene(cell.scene(surface), replace(quality, samples=reference // 2), seed=seed).beauty
        halves.append(tracer.path_tracer.render(reference // 2, 0, seed)[..., :3])
    truth = Truth(*halves)
    tries: dict[str, Tries] = {"raw": {}, "denoised": {}}
    denoise(render_frame(cell.scene(surface), quality, 1, engine))  # compiles
    for samples in OURS:
        for seed in range(SEEDS):
            begun = time.process_time()
            frame = render_frame(cell.scene(surface), replace(quality, samples=samples), 50 + seed, engine)
            raw = time.process_time() - begun
            frame = as_read(frame)
            begun = time.process_time() - raw  # the file counts for neither
            clean = denoise(frame)
            denoised = time.process_time() - begun
            tries["raw"].setdefault(str(samples), []).append([raw, truth.error(frame["beauty"])])
            tries["denoised"].setdefault(str(samples), []).append([denoised, truth.error(clean)])
    return {"tries": tries, "truth": truth}


def ratios(measured: dict[str, Any], kind: str, samples: int) -> list[float]:
    """Return the CPU seconds of Cycles until the error of ours, over ours: of the means, and of each seed."""
    own = np.array(measured["ours"][kind][str(samples)])
    found = []
    for seeds in (slice(None), *(slice(i, i + 1) for i in range(len(own)))):
        seconds, error = _mean(own[seeds])
        theirs = [tried for name, tried in measured["Cycles"].items() if name.startswith(kind)]
        found.append(min(_until(tried, seeds, error) for tried in theirs) / seconds)
    return found


def _mean(tries: AnyArray) -> tuple[float, float]:
    """Return mean seconds, and the root of the mean square of errors, of tries (seeds, 2)."""
    return float(tries[:, 0].mean()), float(np.sqrt((tries[:, 1] ** 2).mean()))


def _until(tried: Tries, seeds: slice, error: float) -> float:
    """Return the seconds until an error.

    Beyond the most samples, the error falls as between the last two, and at least as noise does.
    """
    known = sorted(map(int, tried))
    means = [_mean(np.array(tried[str(samples)])[seeds]) for samples in known]
    (before, more), (last, least) = means[-2:]
    if error < least:
        slope = max(0.5, math.log(more / least) / math.log(last / before))
        return float(last * (least / error) ** (1.0 / slope))
    best = Best(known, [seconds for seconds, _ in means], [np.array(each) for _, each in means])
    return best.until(float, error)


def _row(name: str, measured: dict[str, Any]) -> Row:
    row: Row = {"cell": name}
    for kind, samples in COMPARED.items():
        mean, *seeds = ratios(measured, kind, samples)
        row[f"{kind}, {samples}"] = mean
        row[f"{kind}, seeds"] = f"{min(seeds):.3g} to {max(seeds):.3g}"
        row[f"{kind} is a"] = "win" if min(seeds) > 1.0 else "loss" if max(seeds) < 1.0 else "draw"
    return row | {"steps apart": measured["apart"], "brightness": measured["brightness"]}


def main(width: int = 160, reference: int = 256, *names: str) -> list[Target]:
    """Measure the cells that are not measured yet; return the targets."""
    if not HOME.is_dir():
        print("Cycles is not installed; benchmarks/requirements-cycles.txt says how")
        return []
    engine, size = choose(), (width, width * 9 // 16)
    engine.start()
    OUT.mkdir(exist_ok=True)
    path, made_by = OUT / "cycles.json", {"width": width, "reference": reference}
    stored = json.loads(path.read_text()) if path.exists() else {}
    cells = stored["cells"] if isinstance(stored, dict) and stored.get("made by") == made_by else {}
    for name in names or [f"{look}-{rig}" for look in LOOK_NAMES for rig in RIG_NAMES]:
        if name not in cells:
            cells[name] = measure(Cell.named(name), size, reference, engine)
            path.write_text(json.dumps({"made by": made_by, "cells": cells}, indent=1) + "\n")
            show(name, [_row(name, cells[name])])
    rows = [_row(name, measured) for name, measured in cells.items()]
    targets = []
    for kind, samples in COMPARED.items():
        column = f"{kind}, {samples}"
        values = [float(row[column]) for row in rows]
        targets += [
            Target(str(row["cell"]), f"Cycles: times as long, {column}", value, least=LEAST[kind])
            for row, value in zip(rows, values, strict=True)
        ]
        targets.append(
            Target("median", f"Cycles: times as long, {column}", float(np.median(values)), least=LEAST_MEDIAN)
        )
    show(
        f"{size[0]} × {size[1]}, {SEEDS} seeds: CPU seconds of Cycles until the error of ours, over ours",
        rows,
    )
    return targets


if __name__ == "__main__":
    width, reference, *names = [*sys.argv[1:], *("160", "256")[len(sys.argv) - 1 :]]
    show("Targets", [target.row for target in main(int(width), int(reference), *names)])
