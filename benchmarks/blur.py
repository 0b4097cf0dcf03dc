"""Motion blur: what it costs, and whether fast things strobe.

    python -m benchmarks.blur cost 70 daily
    python -m benchmarks.blur strobing 126 16

`cost`: a geodesic sphere of the given frequency slides through the picture at growing speeds. Prints a line
for each: pixels moved while the shutter is open, motion samples, CPU seconds, and their ratio to a still
frame, which is rendered before and after.

`strobing`: a small glazed sphere crosses so many pixels, with so many samples. Prints errors against a
reference of 512 motion samples, over its mean luminance: of columns (means over the rows of the streak, in
which noise averages out and ghosts remain) and of pixels. Writes raw, denoised and reference to a PNG where a
path is given.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.raw_files import as_read
from flowsculpt.pipeline.mesh.solids import icosphere
from flowsculpt.render.frame.render_frame import ShutterInterval, render_frame
from flowsculpt.render.mitsuba.engine import Engine, choose
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.post.colour import quantise, to_display
from flowsculpt.render.post.denoise import denoise
from flowsculpt.render.post.image import write_png
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import QUALITIES, Quality
from flowsculpt.render.scene.scene import MotionSample, Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface

CAMERA = Camera((0.0, 2.0, 9.0), (0.0, 1.0, 0.0))

PIXELS = (0.8, 3.2, 12.8, 50.0, 126.0)
"""Pixels that the sphere moves while the shutter is open."""

STREAK = (120, 115, 360, 175)
"""Rendered pixels of the strobing sphere."""

REFERENCE_TIMES, REFERENCE_SAMPLES = 512, 8

_LUMA = np.array([0.2126, 0.7152, 0.0722])


def print_cost(engine: Engine, frequency: int, quality: str) -> None:
    """Print the table of costs."""
    surface = _sphere(frequency, 1.0, 1.0)

    def seconds(pixels: float) -> tuple[float, int]:
        shutter = _sliding(surface, pixels, QUALITIES[quality])
        begun = time.process_time()
        frame = render_frame(_scene(surface, "clay"), QUALITIES[quality], 1, engine, shutter=shutter)
        return time.process_time() - begun, frame.facts["motion_samples"]

    seconds(0.0)  # compiles
    before = seconds(0.0)[0]
    blurred = {pixels: seconds(pixels) for pixels in PIXELS}
    still = min(before, seconds(0.0)[0])
    print(f"{len(surface.vertices)} vertices, {quality}, standing still: {still:.2f} s")
    for pixels, (spent, count) in blurred.items():
        print(f"{pixels} pixels, {count} motion samples: {spent:.2f} s, {spent / still:.2f}")


def print_strobing(engine: Engine, pixels: float, samples: int, picture: Path | None) -> None:
    """Print the errors of a fast sphere."""
    quality = Quality(480, 270, samples=samples, depth=6, auxiliary_samples=min(samples, 64), crop=STREAK)
    surface = _sphere(20, 0.35, 0.65)
    shutter = _sliding(surface, pixels, quality)
    frame = render_frame(_scene(surface, "glaze"), quality, 7, engine, shutter=shutter)
    clean = denoise(as_read(frame))
    reference = _reference(surface, shutter, quality)
    print(f"{pixels:g} pixels, {samples} samples, {frame.facts['motion_samples']} motion samples")
    for name, light in (("raw", frame["beauty"]), ("denoised", clean)):
        error = (light - reference) @ _LUMA
        mean = float((reference @ _LUMA).mean())
        columns = float(np.sqrt((error.mean(axis=0) ** 2).mean())) / mean
        print(
            f"  {name}: columns {100 * columns:.2f}%, pixels {100 * np.sqrt((error**2).mean()) / mean:.2f}%"
        )
    if picture is not None:
        rows = np.concatenate([frame["beauty"], clean, reference.astype(np.float32)])
        write_png(picture, quantise(to_display(rows, display="srgb")).repeat(3, axis=0).repeat(3, axis=1))


def _reference(surface: Surface, shutter: ShutterInterval, quality: Quality) -> NDArray[np.float64]:
    total = np.zeros(())
    for index in range(REFERENCE_TIMES):
        sample = shutter.at(shutter.offset((index + 0.5) / REFERENCE_TIMES))
        scenes = build_scene(_scene(surface, "glaze").at(sample), quality)
        first = index * REFERENCE_SAMPLES
        total = total + scenes.beauty.path_tracer.render(REFERENCE_SAMPLES, first, 99)[..., :3]
    return np.asarray(total / REFERENCE_TIMES)


def _sphere(frequency: int, radius: float, height: float) -> Surface:
    ball = icosphere(frequency)
    points = radius * ball.vertices + np.array([0.0, height, 0.0])
    return Surface(points.astype(np.float32), ball.vertices.astype(np.float32), ball.faces)


def _scene(surface: Surface, look: str) -> Scene:
    stage, lights = STAGES["cyclorama"], LIGHTS["studio"]
    return Scene(surface, LOOKS[look], lights, stage, StagePlacement(), CAMERA)


def _sliding(surface: Surface, pixels: float, quality: Quality) -> ShutterInterval:
    """Return a shutter of half a frame in which the nearest point moves by so many pixels."""
    right = CAMERA.axes()[0]

    def at(offset: float) -> MotionSample:
        moved = (surface.vertices + way * offset * right).astype(np.float32)
        return MotionSample(replace(surface, vertices=moved), StagePlacement(), CAMERA)

    way = 1.0
    way = pixels / ShutterInterval(-0.25, 0.25, at).longest_motion((quality.width, quality.height))
    return ShutterInterval(-0.25, 0.25, at)


def main(table: str, *arguments: str) -> None:
    """Print a table."""
    engine = choose(threads=2)
    engine.start()
    if table == "cost":
        print_cost(engine, int(arguments[0]), arguments[1])
    else:
        picture = Path(arguments[2]) if len(arguments) > 2 else None
        print_strobing(engine, float(arguments[0]), int(arguments[1]), picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
