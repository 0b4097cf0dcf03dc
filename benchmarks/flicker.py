"""`python -m benchmarks.flicker [WIDTH] [REFERENCE] [efforts]`: flicker of films.

A torus of clay and of glaze in the studio, WIDTH × 9/16 WIDTH pixels (480), eight frames: one film that
stands still, one that turns by half a degree a frame. Frames are rendered raw with 256 samples, and with 16
samples that are denoised, alone and with two frames to either side. Frames that have two neighbours on both
sides are measured, against REFERENCE samples (1024) of each frame that are denoised: the noise of a raw
reference would count as flicker of both.

Flicker is the standard deviation over time of the difference from the reference, steps of an 8-bit display,
its mean over pixels; the error is the root mean square of the difference. Target: 16 samples denoised over
time flicker at most half as much as 256 raw ones. Writes `benchmarks/out/flicker.json` and PNGs.

`efforts` compares the denoiser's efforts instead, in turning films of six looks: with the samples of a daily
and a final averaged over time, and those of a draft alone, and with its CPU seconds of a frame.
"""

from __future__ import annotations

import itertools
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.errors import put
from benchmarks.raw_files import as_read
from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.mesh.normals import split_at_creases
from flowsculpt.pipeline.mesh.solids import torus
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.mitsuba.engine import Engine, choose
from flowsculpt.render.post.colour import to_display
from flowsculpt.render.post.denoise import FilmDenoiser, RawFrame, denoise
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface

FRAMES, TURN = 8, math.radians(0.5)
CAMERA = Camera((2.2, 2.6, 6.0), (0.0, 0.75, 0.0))
QUALITY = Quality(480, 270, samples=16, depth=6, auxiliary_samples=16)
SHOWN = ("clay", "glaze")
LOOKS_OF_EFFORTS = ("glass", "honey", "chrome", "marble", "glaze", "clay")
EFFORTS = ("fast", "balanced", "high")
SAMPLES = {4: 0, 16: 2, 64: 2}
"""Samples of draft, daily and final, with the frames to either side that are averaged in."""

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
        shaded.vertices.astype(np.float32),
    )


def rendered(
    look: str, surface: Surface, samples: int, seed: int, engine: Engine, width: int, ways: bool = False
) -> RenderedFrame:
    quality = replace(QUALITY, width=width, height=width * 9 // 16, samples=samples)
    aovs = ("before", "after") if ways or samples == QUALITY.samples else ()
    parts = (LOOKS[look], LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), CAMERA)
    return as_read(render_frame(Scene(surface, *parts), quality, seed, engine, aovs=aovs))


def measure(
    look: str, film: str, angles: list[float], width: int, reference: int, engine: Engine
) -> list[Row]:
    """Measure flicker and error of each method over the frames that have two neighbours on both sides."""
    surfaces = [subject(angle) for angle in angles]
    inner = range(2, len(angles) - 2)

    def rendered_at(i: int, samples: int, seed: int) -> RenderedFrame:
        return rendered(look, surfaces[i], samples, seed + i, engine, width)

    frames = [rendered_at(i, QUALITY.samples, 1) for i in range(len(angles))]
    denoiser = FilmDenoiser(_reader(frames))
    made = {
        "16, raw": [frames[i]["beauty"] for i in inner],
        "16, denoised": [denoiser.light(i, [i]) for i in inner],
        "16, denoised over time": [denoiser.light(i, range(i - 2, i + 3)) for i in inner],
        "256, raw": [rendered_at(i, 256, 101)["beauty"] for i in inner],
    }
    still = len(set(angles)) == 1
    truths = [denoise(rendered_at(i, reference, 201)) for i in (inner[:1] if still else inner)]
    put(f"flicker_{look}_{film}", {way: made[way][0] for way in ("16, raw", "16, denoised over time")})
    rows: list[Row] = []
    for way, pictures in made.items():
        off = np.stack([_shown(p) - _shown(truths[0 if still else i]) for i, p in enumerate(pictures)])
        flicker, error = float(off.std(axis=0).mean()), float(np.sqrt((off**2).mean()))
        rows.append({"look": look, "film": film, "samples": way, "flicker": flicker, "error": error})
    return rows


def measure_efforts(look: str, width: int, reference: int, engine: Engine) -> list[Row]:
    """Measure flicker, error and CPU seconds of each effort over the frames that have all neighbours."""
    surfaces = [subject(TURN * (i + 1)) for i in range(FRAMES)]
    inner = range(2, FRAMES - 2)
    truths = [_shown(denoise(rendered(look, surfaces[i], reference, 201 + i, engine, width))) for i in inner]
    rows: list[Row] = []
    for samples, reach in SAMPLES.items():
        frames = [
            rendered(look, surface, samples, 1 + i, engine, width, ways=True)
            for i, surface in enumerate(surfaces)
        ]
        row: Row = {"look": look, "samples": float(samples)}
        for effort in EFFORTS:
            denoiser = FilmDenoiser(_reader(frames), effort)
            denoise(frames[0], effort)  # allocates
            begun = time.process_time()
            lights = [denoiser.light(i, range(i - reach, i + reach + 1)) for i in inner]
            taken = (time.process_time() - begun) / (len(inner) + 2 * reach)
            off = np.stack([_shown(light) - truth for light, truth in zip(lights, truths, strict=True)])
            row |= {f"{effort}: flicker": float(off.std(axis=0).mean())}
            row |= {f"{effort}: error": float(np.sqrt((off**2).mean())), f"{effort}: CPU s": taken}
        rows.append(row)
    return rows


def _reader(frames: Sequence[RenderedFrame]) -> Callable[[int], RawFrame]:
    return lambda number: RawFrame(frames[number], CAMERA, StagePlacement())


def _shown(light: AnyArray) -> AnyArray:
    return np.asarray(255.0 * to_display(light.astype(np.float32)), dtype=np.float64)


def main(width: int = 480, reference: int = 1024) -> list[Target]:
    """Measure all films; return the targets."""
    engine = choose()
    films = {"standing": [0.0] * FRAMES, "turning": [TURN * (i + 1) for i in range(FRAMES)]}
    rows: list[Row] = []
    targets = []
    for look, film in itertools.product(SHOWN, films):
        measured = measure(look, film, films[film], width, reference, engine)
        flicker = {row["samples"]: float(row["flicker"]) for row in measured}
        ratio = flicker["16, denoised over time"] / flicker["256, raw"]
        targets.append(
            Target(f"flicker, {look}, {film}", "16 denoised over time / 256 raw", ratio, most=MOST)
        )
        rows += measured
        show(f"Flicker and error of {look}, {film}, steps of 255", measured)
    keep("flicker", rows)
    return targets


def compare_efforts(width: int = 480, reference: int = 1024) -> None:
    """Measure the denoiser's efforts, print the tables and write the numbers."""
    engine, rows = choose(), list[Row]()
    for look in LOOKS_OF_EFFORTS:
        rows += measure_efforts(look, width, reference, engine)
        show(f"Efforts, {look}, steps of 255", rows[-len(SAMPLES) :])
    keep("flicker_efforts", rows)


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    if "efforts" in sys.argv:
        compare_efforts(*numbers)
    else:
        show("Targets", [target.row for target in main(*numbers)])
