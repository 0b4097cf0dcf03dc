"""Cost of motion blur: the same frame with the same samples, with and without motion samples.

    python -m benchmarks.blur 70 daily

A geodesic sphere of the given frequency slides through the picture at growing speeds, which need 1, 2, 4, 8
and 16 motion samples where the samples can be divided by as many. Prints a line for each speed: pixels moved
while the shutter is open, motion samples, seconds, and their ratio to a still frame, which is rendered before
and after.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

from pipeline.mesh.solids import icosphere
from render.frame.render_frame import render_frame
from render.frame.sample_batches import ShutterInterval
from render.mitsuba.engine import choose
from render.scene.aovs import RenderedFrame
from render.scene.camera import Camera
from render.scene.lights import LIGHTS
from render.scene.materials import LOOKS
from render.scene.quality import QUALITIES
from render.scene.scene import MotionSample, Scene
from render.scene.stage import STAGES, StagePlacement
from render.scene.surface import Surface

CAMERA = Camera((0.0, 2.0, 9.0), (0.0, 1.0, 0.0))

PIXELS = (0.8, 1.6, 3.2, 6.4, 12.8)
"""Pixels that the sphere moves while the shutter is open."""


def main(frequency: int, quality: str) -> None:
    """Print the table."""
    ball = icosphere(frequency)
    normals, points = ball.vertices.astype(np.float32), ball.vertices + np.array([0.0, 1.0, 0.0])
    surface, engine = Surface(points.astype(np.float32), normals, ball.faces), choose(threads=2)

    def rendered(shutter: ShutterInterval | None) -> tuple[float, RenderedFrame]:
        begun = time.perf_counter()
        scene = Scene(surface, LOOKS["clay"], LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), CAMERA)
        layers = render_frame(scene, QUALITIES[quality], 1, engine, shutter=shutter)
        return time.perf_counter() - begun, layers

    rendered(None)  # compiles
    before = rendered(None)[0]
    blurred = {pixels: rendered(_sliding(surface, pixels, QUALITIES[quality].width)) for pixels in PIXELS}
    still = min(before, rendered(None)[0])
    print(f"{len(points)} vertices, {quality}, standing still: {still:.2f} s")
    for pixels, (seconds, layers) in blurred.items():
        print(
            f"{pixels} pixels, {layers.facts['motion_samples']} motion samples: {seconds:.2f} s, "
            f"{seconds / still:.2f}"
        )


def _sliding(surface: Surface, pixels: float, width: int) -> ShutterInterval:
    """Return a shutter of half a frame in which the nearest point moves by so many pixels."""
    right = CAMERA.axes()[0]

    def at(offset: float) -> MotionSample:
        moved = (surface.vertices + way * offset * right).astype(np.float32)
        return MotionSample(replace(surface, vertices=moved), StagePlacement(), CAMERA)

    way = 1.0
    way = pixels / ShutterInterval(-0.25, 0.25, at).longest_motion((width, width * 9 // 16))
    return ShutterInterval(-0.25, 0.25, at)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2])
