"""Cost of clouds: spheres as triangles, built into a scene and rendered.

    python -m benchmarks.clouds 20000 draft

Prints spheres, quality, triangles, seconds of building and of rendering, and the peak memory of the process.
"""

from __future__ import annotations

import resource
import sys

import numpy as np

from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.mitsuba.engine import choose
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import QUALITIES
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Spheres

CAMERA = Camera((0.0, 2.0, 9.0), (0.0, 1.0, 0.0))


def main(count: int, quality: str) -> None:
    """Render one frame of a normally distributed cloud; radii shrink as the count grows."""
    centres = 0.4 * np.random.default_rng(1).normal(size=(count, 3)) + (0.0, 1.0, 0.0)
    cloud = Spheres(centres.astype(np.float32), np.full(count, 0.2 * count ** (-1 / 3), np.float32))
    scene = Scene(cloud, LOOKS["clay"], LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), CAMERA)
    layers = render_frame(scene, QUALITIES[quality], 1, choose(threads=2))
    seconds = " + ".join(f"{layers.seconds[part]:.1f}" for part in ("building", "rendering"))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    print(f"{count} {quality}: {layers.facts['surface_faces']} triangles, {seconds} s, {peak} MiB")


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2])
