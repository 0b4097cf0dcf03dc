"""`python -m benchmarks.flicker [WIDTH] [REFERENCE]`: flicker of films.

A glazed torus in the studio, WIDTH × 9/16 WIDTH pixels (480), eight frames: one film that stands still, one
that turns by half a degree a frame. Frames are rendered raw with 256 samples, here and by Mitsuba alone (its
path tracer and multijitter sampler, in passes of 16), and with 16 samples that are denoised, alone and with
two frames to either side. Frames that have two neighbours on both sides are measured. The reference is the
mean of REFERENCE samples (1024).

Flicker is the standard deviation over time of the difference from the reference, steps of an 8-bit display,
its mean over pixels; the error is the root mean square of the difference. Target: 16 samples flicker at most
half as much as 256 raw samples of Mitsuba. Writes `benchmarks/out/flicker.json` and PNGs.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from benchmarks.errors import put
from benchmarks.report import Row, Target, keep, show
from pipeline.arrays import AnyArray
from pipeline.mesh.normals import split_at_creases
from pipeline.mesh.solids import torus
from render.frame.render_frame import render_frame
from render.mitsuba.engine import Engine, choose
from render.mitsuba.scene import build_scene
from render.post.colour import to_display
from render.post.denoise import denoise
from render.post.temporal_denoise import DenoisedFrame, removed_noise, temporal_denoise
from render.scene.aovs import RenderedFrame
from render.scene.camera import Camera
from render.scene.lights import LIGHTS
from render.scene.materials import LOOKS
from render.scene.quality import Quality
from render.scene.scene import Scene
from render.scene.stage import STAGES, StagePlacement
from render.scene.surface import Surface

FRAMES, TURN = 8, math.radians(0.5)
CAMERA = Camera((2.2, 2.6, 6.0), (0.0, 0.75, 0.0))
QUALITY = Quality(480, 270, samples=16, depth=6, auxiliary_samples=16)
PASS = 16
MOST = 0.5
"""Target: flicker over that of 256 raw samples."""


def subject(angle: float) -> Surface:
    """Return the torus on edge, turned about the vertical, with its vertices one frame before and after."""
    shaded = split_at_creases(torus(1.0, 0.4, 0.05), math.radians(40))
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])

    def at(turn: float, points: AnyArray) -> AnyArray:
        c, s = math.cos(turn), math.sin(turn)
        return np.asarray(points @ upright.T @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T)

    here = at(angle, shaded.vertices)
    step = TURN if angle else 0.0
    ways = {
        "before": at(angle - step, shaded.vertices) - here,
        "after": at(angle + step, shaded.vertices) - here,
    }
    lifted = here + np.array([0.0, 1.4, 0.0])
    return Surface(
        lifted.astype(np.float32),
        at(angle, shaded.normals).astype(np.float32),
        shaded.faces,
        {name: way.astype(np.float32) for name, way in ways.items()},
    )


def rendered(surface: Surface, samples: int, seed: int, engine: Engine, width: int) -> RenderedFrame:
    quality = replace(QUALITY, width=width, height=width * 9 // 16, samples=samples)
    look, lights, stage = LOOKS["glaze"], LIGHTS["studio"], STAGES["cyclorama"]
    aovs = ("before", "after") if samples == QUALITY.samples else ()
    scene = Scene(surface, look, lights, stage, StagePlacement(), CAMERA)
    return render_frame(scene, quality, seed, engine, aovs=aovs)


def by_mitsuba(surface: Surface, samples: int, seed: int, width: int) -> AnyArray:
    """Render with Mitsuba's own path tracer, without clamping."""
    quality = replace(QUALITY, width=width, height=width * 9 // 16)
    described = Scene(
        surface, LOOKS["glaze"], LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), CAMERA
    )
    scene = build_scene(described, quality).beauty
    passes = range(samples // PASS)
    return np.asarray(sum(scene.render(PASS, 1000 * seed + i)[..., :3] for i in passes) / len(passes))


def moment_of(layers: RenderedFrame) -> DenoisedFrame:
    light = denoise(layers)
    known = {name: layers[name] for name in ("position", "normal", "matte", "before", "after")}
    return DenoisedFrame(
        light, removed_noise(layers["beauty"], light), **known, camera=CAMERA, placement=StagePlacement()
    )


def measure(name: str, angles: list[float], width: int, reference: int, engine: Engine) -> list[Row]:
    """Measure flicker and error of each method over the frames that have two neighbours on both sides."""
    surfaces = [subject(angle) for angle in angles]
    inner = range(2, len(angles) - 2)

    def raw(samples: int, seed: int, frames: Iterable[int]) -> list[AnyArray]:
        return [rendered(surfaces[i], samples, seed + i, engine, width)["beauty"] for i in frames]

    moments = {i: moment_of(rendered(s, 16, 1 + i, engine, width)) for i, s in enumerate(surfaces)}
    around = {i: {n: moments[n] for n in moments if abs(n - i) <= 2} for i in inner}
    made = {
        "16, raw": raw(16, 1, inner),
        "16, denoised": [moments[i].light for i in inner],
        "16, denoised over time": [temporal_denoise(around[i], i) for i in inner],
        "256, raw": raw(256, 101, inner),
        "256, Mitsuba": [by_mitsuba(surfaces[i], 256, 101 + i, width) for i in inner],
    }
    still = len(set(angles)) == 1
    truths = raw(reference, 201, inner[:1] if still else inner)
    put(f"flicker_{name}", {"16": made["16, raw"][0], "over time": made["16, denoised over time"][0]})
    rows: list[Row] = []
    for way, pictures in made.items():
        off = np.stack([_shown(p) - _shown(truths[0 if still else i]) for i, p in enumerate(pictures)])
        rows.append(
            {
                "film": name,
                "samples": way,
                "flicker": float(off.std(axis=0).mean()),
                "error": float(np.sqrt((off**2).mean())),
            }
        )
    return rows


def _shown(light: AnyArray) -> AnyArray:
    return np.asarray(255.0 * to_display(light.astype(np.float32)), dtype=np.float64)


def main(width: int = 480, reference: int = 1024) -> list[Target]:
    """Measure both films; return the targets."""
    engine = choose()
    rows = measure("still", [0.0] * FRAMES, width, reference, engine)
    rows += measure("turning", [TURN * (i + 1) for i in range(FRAMES)], width, reference, engine)
    show("Flicker and error, steps of 255", rows)
    keep("flicker", rows)
    found = {(row["film"], row["samples"]): float(row["flicker"]) for row in rows}
    return [
        Target(
            f"flicker, {film}",
            "16 denoised over time / 256 raw of Mitsuba",
            found[film, "16, denoised over time"] / found[film, "256, Mitsuba"],
            most=MOST,
        )
        for film in ("still", "turning")
    ]


if __name__ == "__main__":
    show("Targets", [target.row for target in main(*map(int, sys.argv[1:]))])
