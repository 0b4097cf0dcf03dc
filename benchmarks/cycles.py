"""`python -m benchmarks.cycles [WIDTH] [REFERENCE]`: time to equal error, against Blender's Cycles.

The scene is a clay torus in the studio that turns by half a degree a frame, WIDTH pixels wide (256). Both
renderers get the same triangles, stage, emitters, sky and lens, six vertices to a path, a box filter and
Intel's denoiser (`benchmarks/blender.py` has the settings). Each renders three frames in turn: raw, denoised,
and, here only, denoised over time with two frames to either side. Seconds include building the scene and the
auxiliary features.

Each renderer is compared with its own reference of REFERENCE samples (1024), so that it does not matter which
of the two is right; the distance between the references is printed. The references' noise is estimated from
their halves, and subtracted. Errors are root mean squares of display values. The time of Cycles is
interpolated between powers of two of samples, as in `benchmarks.equal_quality`.

Targets: half the time, and a quarter with denoising over time; by the clock, and in CPU seconds, which other
work does not lengthen. Writes `benchmarks/out/cycles.json` and PNGs. Needs
`benchmarks/requirements-cycles.txt`.
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
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.equal_quality import Best
from benchmarks.errors import put, shown
from benchmarks.flicker import CAMERA, TURN, moment_of, subject
from benchmarks.report import Row, Target, keep, show
from pipeline.arrays import AnyArray
from render.frame.render_frame import render_frame
from render.mitsuba.engine import Engine, choose
from render.post.image import read_exr
from render.post.temporal_denoise import DenoisedFrame, temporal_denoise
from render.scene.aovs import RenderedFrame
from render.scene.lights import LIGHTS, Softbox
from render.scene.materials import LOOKS
from render.scene.quality import Quality
from render.scene.scene import Scene
from render.scene.stage import STAGES, StagePlacement
from render.scene.surface import Surface

HOME = Path(sys.prefix) / "cycles"
DEPTH, RIG, LOOK, STAGE = 6, LIGHTS["studio"], LOOKS["clay"], STAGES["cyclorama"]
FRAMES, AROUND = 3, 2
RAW, DENOISED = (16, 64, 256), (16, 64, 256)
"""Samples of Cycles."""

LEAST, LEAST_OVER_TIME = 2.0, 4.0
"""Targets: the time of Cycles over ours."""


Spent = AnyArray
"""(2,): seconds by the clock, and CPU seconds of all threads, which other work does not lengthen."""


def now() -> Spent:
    return np.array([time.perf_counter(), time.process_time()])


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

    def show(self, surface: Surface) -> None:
        np.savez(
            self.room / "subject.npz",
            vertices=surface.vertices,
            normals=surface.normals,
            faces=surface.faces,
        )
        self.say(mesh="subject.npz")

    def rendered(self, samples: int, denoised: bool, seed: int) -> tuple[Spent, AnyArray]:
        seconds = self.say(samples=samples, denoised=denoised, seed=seed, to="picture.exr")["seconds"]
        layers, _ = read_exr(self.room / "picture.exr")
        return np.array(seconds), layers["beauty"].astype(np.float64)


@contextmanager
def cycles(room: Path, size: tuple[int, int]) -> Iterator[Cycles]:
    """Start Blender with stage, emitters and lens, without a subject."""
    vertices, normals, faces = STAGE.mesh()
    np.savez(room / "stage.npz", vertices=vertices, normals=normals, faces=faces)
    axes = CAMERA.axes()
    lens = np.eye(4)
    lens[:3, :3], lens[:3, 3] = np.stack([axes[0], axes[1], -axes[2]], axis=1), CAMERA.origin
    told = {
        "size": size,
        "depth": DEPTH,
        "field_of_view": CAMERA.field_of_view,
        "camera": lens.tolist(),
        "sky": RIG.sky.zenith,
        "lamps": [_lamp(box) for box in RIG.softboxes],
        "stage": "stage.npz",
        "stage_colour": STAGE.colour,
        "colour": LOOK.colour,
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


def _lamp(box: Softbox) -> dict[str, Any]:
    """Return an emitter's data; it shines along its -z axis, its y axis as vertical as possible."""
    back = np.subtract(box.position, box.target)
    back = back / np.linalg.norm(back)
    up = (0.0, 1.0, 0.0) if math.hypot(back[0], back[2]) > 1e-3 else (0.0, 0.0, -1.0)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.stack([right, np.cross(back, right), back], axis=1), box.position
    return {
        "matrix": matrix.tolist(),
        "width": box.width,
        "height": box.height,
        "radiance": box.radiance,
    }


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


@dataclass(eq=False)
class Tries:
    """Seconds and errors of one method by number of samples; means over the frames."""

    spent: dict[int, list[Spent]] = field(default_factory=dict)
    squares: dict[int, list[float]] = field(default_factory=dict)

    def add(self, samples: int, spent: Spent, error: float) -> None:
        self.spent.setdefault(samples, []).append(spent)
        self.squares.setdefault(samples, []).append(error**2)

    def of(self, samples: int) -> tuple[Spent, float]:
        return np.mean(self.spent[samples], axis=0), math.sqrt(float(np.mean(self.squares[samples])))

    def until(self, wanted: float) -> Spent:
        """Return the seconds until the error is `wanted`."""
        known = sorted(self.spent)
        errors = [np.array(self.of(samples)[1]) for samples in known]
        by_clock = ([float(self.of(samples)[0][clock]) for samples in known] for clock in (0, 1))
        return np.array([Best(known, seconds, errors).until(float, wanted) for seconds in by_clock])


def ours(surface: Surface, size: tuple[int, int], samples: int, seed: int, engine: Engine) -> RenderedFrame:
    quality = Quality(*size, samples=samples, depth=DEPTH, auxiliary_samples=16)
    scene = Scene(surface, LOOK, RIG, STAGE, StagePlacement(), CAMERA)
    return render_frame(scene, quality, seed, engine, aovs=("before", "after"))


def main(width: int = 256, reference: int = 1024) -> list[Target]:
    """Measure three frames; return the targets."""
    if not HOME.is_dir():
        print("Cycles is not installed; benchmarks/requirements-cycles.txt says how")
        return []
    engine, size = choose(), (width, width * 9 // 16)
    engine.start()
    numbers = range(1 - AROUND, FRAMES + 1 + AROUND)
    surfaces = {n: subject(TURN * (n + AROUND)) for n in numbers}
    tries = {name: Tries() for name in ("ours, raw", "ours, denoised", "ours, over time")}
    tries |= {"Cycles, raw": Tries(), "Cycles, denoised": Tries()}
    apart: list[float] = []
    ours(surfaces[1], size, 16, 1, engine)  # compiles
    moments: dict[int, DenoisedFrame] = {}
    made: dict[int, Spent] = {}
    for number in numbers:
        begun = now()
        moments[number] = moment_of(ours(surfaces[number], size, 16, number + 10, engine))
        made[number] = now() - begun
    temporal_denoise(moments, 1)  # compiles
    with tempfile.TemporaryDirectory() as folder, cycles(Path(folder), size) as blender:
        blender.show(surfaces[1])
        blender.rendered(1, True, 1)
        for number in range(1, FRAMES + 1):
            surface = surfaces[number]
            blender.show(surface)
            truth = _ours_at_last(surface, size, reference, engine)
            for samples in (16, 64):
                begun = now()
                layers = ours(surface, size, samples, number + 50, engine)
                raw = now() - begun
                moment = moment_of(layers)
                denoised = now() - begun
                tries["ours, raw"].add(samples, raw, truth.error(layers["beauty"]))
                tries["ours, denoised"].add(samples, denoised, truth.error(moment.light))
            begun = now()
            around = {n: moments[n] for n in range(number - AROUND, number + AROUND + 1)}
            quiet = temporal_denoise(around, number)
            seconds = now() - begun + made[number]
            tries["ours, over time"].add(16, seconds, truth.error(quiet))
            theirs = Truth(*(blender.rendered(reference // 2, False, 900 + i)[1] for i in (0, 1)))
            for name, denoised_too, wanted in (
                ("Cycles, raw", False, RAW),
                ("Cycles, denoised", True, DENOISED),
            ):
                for samples in wanted:
                    spent, picture = blender.rendered(samples, denoised_too, 10 * number + samples)
                    tries[name].add(samples, spent, theirs.error(picture))
            apart.append(truth.error(theirs.mean))
        version = blender.version
    put("cycles_truths", {"ours": truth.mean, "Cycles": theirs.mean, "16 over time": quiet})
    rows: list[Row] = [
        {
            "made by": name,
            "samples": float(samples),
            "s": float(tried.of(samples)[0][0]),
            "CPU s": float(tried.of(samples)[0][1]),
            "error": tried.of(samples)[1],
        }
        for name, tried in tries.items()
        for samples in sorted(tried.spent)
    ]
    show(f"{FRAMES} frames of {size[0]} × {size[1]}, Blender {version}; errors in steps of 255", rows)
    means = [shown(each.mean).mean(axis=(0, 1)) for each in (truth, theirs)]
    print(
        f"converged, they are {np.mean(apart):.3g} steps apart; Cycles's means are "
        + ", ".join(f"{factor:.4f}" for factor in means[1] / means[0])
        + " of ours"
    )
    keep("cycles", [*rows, {"made by": "apart, converged", "error": float(np.mean(apart))}])
    return [
        *_targets(tries, "ours, raw", 64, "Cycles, raw", LEAST),
        *_targets(tries, "ours, denoised", 16, "Cycles, denoised", LEAST),
        *_targets(tries, "ours, over time", 16, "Cycles, denoised", LEAST_OVER_TIME),
    ]


def _targets(tries: dict[str, Tries], who: str, samples: int, whom: str, least: float) -> list[Target]:
    spent, error = tries[who].of(samples)
    ratios = tries[whom].until(error) / spent
    return [
        Target(f"{who}, {samples} samples", f"{whom}: times as long, {by}", float(ratio), least=least)
        for by, ratio in zip(("by the clock", "CPU"), ratios, strict=True)
    ]


def _ours_at_last(surface: Surface, size: tuple[int, int], samples: int, engine: Engine) -> Truth:
    """Return our reference, without firefly clamping, which removes light."""
    return Truth(*(_unguarded(surface, size, samples // 2, 7000 + i) for i in (0, 1)))


def _unguarded(surface: Surface, size: tuple[int, int], samples: int, seed: int) -> AnyArray:
    from benchmarks.equal_quality import PASS, one_pass
    from render.mitsuba.scene import build_scene

    scene = Scene(surface, LOOK, RIG, STAGE, StagePlacement(), CAMERA)
    beauty = build_scene(scene, Quality(*size, samples=PASS, depth=DEPTH)).beauty
    count = max(1, samples // PASS)
    return np.asarray(sum(one_pass(beauty, 1000 * seed + i) for i in range(count)) / count)


if __name__ == "__main__":
    show("Targets", [target.row for target in main(*map(int, sys.argv[1:]))])
