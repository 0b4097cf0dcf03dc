"""`python -m benchmarks.subsurface [WIDTH] [REPEATS]`: the cost of subsurface scattering.

A torus of clay, marble, cream and honey in the studio, WIDTH pixels wide (128), with the radius that the
documentation advises and without. REPEATS pictures (6) of 16 samples of both by our path tracer, in turn.
"CPU, times" is the time over that of the surface alone, "error, times" the mean relative variance over its
own, both of the whole picture without the noisiest 2% of pixels; their product is the cost at equal noise.
Writes `benchmarks/out/subsurface.json`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.flicker import CAMERA, subject
from benchmarks.report import Row, keep, show
from benchmarks.variance import DEPTH, MIN_LUMINANCE, Pictures
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.render.mitsuba.engine import choose
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.scene.materials import LOOKS, Material, Subsurface
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement

RADII = {
    "clay": (0.02, 0.02, 0.02),
    "marble": (0.05, 0.05, 0.05),
    "cream": (0.1, 0.07, 0.04),
    "honey": (1.0, 1.0, 1.0),
}
SAMPLES = 16


def measure(name: str, width: int, repeats: int) -> Row:
    """Return the costs of one look."""
    surface = subject(0.3)
    surface = replace(surface, rest=surface.vertices)

    def render_with(look: Material) -> Callable[[int], AnyArray]:
        scene = Scene(surface, look, LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), CAMERA)
        quality = Quality(width, width * 9 // 16, SAMPLES, depth=DEPTH)
        tracer = build_scene(scene, quality).beauty.path_tracer
        return lambda seed: np.asarray(tracer.render(SAMPLES, 0, 1000 + seed))

    plain, scattering = Pictures(), Pictures()
    parts = (None, Subsurface(RADII[name]))
    renders = [render_with(LOOKS[name].with_values(subsurface=part)) for part in parts]
    for render in renders:
        render(-1)  # compile
    for _ in range(repeats):
        for pictures, render in zip((plain, scattering), renders, strict=True):
            pictures.add(render)
    errors = []
    for each in (plain, scattering):
        square = np.maximum(each.mean, MIN_LUMINANCE * each.mean.mean()) ** 2
        relative = each.variance / square
        errors.append(float(relative[relative <= np.quantile(relative, 0.98)].mean()))
    seconds, error = scattering.seconds / plain.seconds, errors[1] / errors[0]
    return {"look": name, "CPU, times": seconds, "error, times": error, "equal noise, times": seconds * error}


def main(width: int = 128, repeats: int = 6) -> None:
    """Measure all looks."""
    choose().start()
    rows = [measure(name, width, repeats) for name in RADII]
    show("Cost of subsurface scattering", rows)
    keep("subsurface", rows)


if __name__ == "__main__":
    main(*(int(each) for each in sys.argv[1:3]))
