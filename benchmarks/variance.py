"""`python -m benchmarks.variance [WIDTH] [REPEATS]`: variance per CPU second, against Mitsuba's `path`.

A torus of each material under each light rig, WIDTH pixels wide (128). Ours is `render_frame`, as the
pipeline calls it, with one auxiliary sample: scene, photons, samples, features, and fireflies spread.
Mitsuba's is the same scene, loaded for every picture, and `path` with `multijitter`, all samples in one call.
No denoiser takes part. Both render REPEATS pictures (6) of 16 and of 64 samples in turn.

Error is the squared difference of a pixel's luminance from a reference of 512 samples of ours, relative to
the square of the reference (at least 2% of the picture's mean), as mean over pictures and pixels. The
variance between pictures would call a caustic that no picture has found noiseless. The 2% of pixels with the
greatest errors of both together are left out: fireflies would decide alone. `all pixels` counts them.
The gain is the error times the CPU seconds of Mitsuba's over that of ours. `typical pixel` is the geometric
mean of the pixels' gains. Energy is the mean luminance of ours over Mitsuba's less 1, by all pictures of
both, with its standard error.

Targets: a gain of at least 1 in every cell, 2 with all pixels, and 3 in the median, and energies within 0.1%
and two standard errors. `--quick` renders four pictures 64 pixels wide. Names of materials and rigs measure
those alone. Writes `benchmarks/out/variance.json`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.flicker import CAMERA, subject
from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.mitsuba import emitters, materials
from flowsculpt.render.mitsuba.engine import Engine, choose
from flowsculpt.render.mitsuba.mitsuba_scene import build_scene
from flowsculpt.render.mitsuba.sensor import sensor
from flowsculpt.render.mitsuba.shapes import mesh, stage_shapes
from flowsculpt.render.mitsuba.texture_coordinates import texture_coordinates
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.sky import Environment
from flowsculpt.render.scene.surface import Surface

MATERIALS = ("clay", "glaze", "chrome", "glass", "marble")
RIGS = ("studio", "gallery", "daylight", "HDRI")
SAMPLES = (16, 64)
DEPTH = 6
MIN_LUMINANCE, LEFT_OUT = 0.02, 0.02
REFERENCE = 512
"""Samples of the reference, whose own variance adds an eighth to that of 64 samples."""

LEAST, LEAST_ALL, LEAST_MEDIAN, MOST_ENERGY = 1.0, 2.0, 3.0, 0.001
"""Targets."""

_LUMA = np.array([0.2126, 0.7152, 0.0722])


@dataclass(eq=False)
class Pictures:
    """Luminances (H, W) of independent pictures, and the CPU seconds of all."""

    luminances: list[AnyArray] = field(default_factory=list)
    seconds: float = 0.0

    def add(self, render: Callable[[int], AnyArray]) -> None:
        begun = time.process_time()
        picture = render(len(self.luminances))
        self.seconds += time.process_time() - begun
        self.luminances.append(np.asarray(picture[..., :3] @ _LUMA))

    def error(self, reference: AnyArray) -> AnyArray:
        """Return the mean over pictures of the squared difference from a reference."""
        return np.asarray(np.mean([(each - reference) ** 2 for each in self.luminances], axis=0))


def hdri(path: Path) -> LightRig:
    """Write an environment map of a sky with a small bright sun and a dim ground; return a rig of it."""
    import OpenImageIO as oiio

    height, width = 128, 256
    row, column = np.mgrid[0:height, 0:width] + 0.5
    elevation, azimuth = np.pi * (0.5 - row / height), 2.0 * np.pi * column / width
    up = np.sin(elevation)[..., None]
    sky = np.where(up > 0.0, (1.0 - up) * [0.9, 0.95, 1.0] + up * [0.2, 0.4, 0.9], [0.25, 0.22, 0.2])
    sun = np.array([np.cos(0.6) * np.cos(1.0), np.cos(0.6) * np.sin(1.0), np.sin(0.6)])
    direction = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    cosine = np.einsum("i,ihw->hw", sun, direction)
    light = sky + np.exp((cosine - 1.0) / 2e-4)[..., None] * [6000.0, 5200.0, 4000.0]
    spec = oiio.ImageSpec(width, height, 3, oiio.FLOAT)
    file = oiio.ImageBuf(spec)
    file.set_pixels(oiio.ROI.All, light.astype(np.float32))
    if not file.write(str(path)):
        raise OSError(file.geterror())
    return LightRig(environment=Environment("benchmark", path=str(path)))


def scene_of(material: str, lights: LightRig) -> Scene:
    """Return the scene of a material under a light rig, on the stage that shots give the material."""
    surface, look = subject(0.3), LOOKS[material]
    surface = replace(surface, rest=surface.vertices)
    stage = replace(STAGES["cyclorama"], colour=look.stage_colour or STAGES["cyclorama"].colour)
    return Scene(surface, look, lights, stage, StagePlacement(), CAMERA)


def render_bare(scene: Scene, quality: Quality, seed: int) -> AnyArray:
    """Load a scene in Mitsuba and render it by `path`, as a script would."""
    import mitsuba as mi

    (subject,), size = scene.subjects, (quality.width, quality.height)
    assert isinstance(subject.geometry, Surface)
    split, coordinates = texture_coordinates(subject.geometry, subject.material)
    bsdf = materials.surface_bsdf(subject.material, (), coordinates, scene.placement.size)
    path = materials.path_integrator([subject.material], quality.depth)
    loaded = mi.load_dict(
        {
            "type": "scene",
            "sensor": sensor(scene.camera, size),
            "subject": mesh("subject", split, bsdf, coordinates.values),
            **stage_shapes(scene, size),
            **emitters.emitters(scene.lights, scene.placement.matrix()),
        }
    )
    integrator = mi.load_dict({**path, "hide_emitters": not scene.lights.shows_sky})
    return np.array(mi.render(loaded, integrator=integrator, spp=quality.samples, seed=seed))


def measure(
    material: str, rig: str, lights: LightRig, size: tuple[int, int], repeats: int, engine: Engine
) -> list[Row]:
    """Return a row for each number of samples."""
    scene = scene_of(material, lights)
    whole = Quality(*size, samples=REFERENCE, depth=DEPTH, auxiliary_samples=1)
    tracer = build_scene(scene, whole).beauty.path_tracer
    reference = np.asarray(tracer.render(REFERENCE, 0, 1)[..., :3] @ _LUMA)
    rows: list[Row] = []
    for samples in SAMPLES:
        quality = replace(whole, samples=samples)

        def render_ours(seed: int, quality: Quality = quality) -> AnyArray:
            return render_frame(scene, quality, 1000 + seed, engine)["beauty"]

        def render_theirs(seed: int, quality: Quality = quality) -> AnyArray:
            return render_bare(scene, quality, 2000 + seed)

        ours, theirs = Pictures(), Pictures()
        render_ours(-1), render_theirs(-1)  # compile
        for _ in range(repeats):
            ours.add(render_ours)
            theirs.add(render_theirs)
        rows.append(
            {"material": material, "rig": rig, "samples": samples, **compare(ours, theirs, reference)}
        )
    return rows


def compare(ours: Pictures, theirs: Pictures, reference: AnyArray) -> Row:
    """Return errors, CPU seconds, gain and energy of ours against Mitsuba's."""
    square = np.maximum(reference, MIN_LUMINANCE * reference.mean()) ** 2
    errors = np.stack([each.error(reference) / square for each in (ours, theirs)])
    total = errors.sum(axis=0)
    kept = errors[:, total <= np.quantile(total, 1.0 - LEFT_OUT)].mean(axis=1)
    both = errors.mean(axis=(1, 2))
    slower = ours.seconds / theirs.seconds
    logs = np.diff(np.log(np.maximum(errors, 1e-20)), axis=0).mean()
    energies = [[each.mean() for each in pictures.luminances] for pictures in (ours, theirs)]
    means = [float(np.mean(each)) for each in energies]
    noise = [float(np.std(each, ddof=1)) / len(each) ** 0.5 / each[0] for each in energies]
    return {
        "error, ours": float(kept[0]),
        "times less": float(kept[1] / kept[0]),
        "CPU s, ours": ours.seconds / len(ours.luminances),
        "CPU, times Mitsuba's": slower,
        "gain": float(kept[1] / kept[0]) / slower,
        "typical pixel": float(np.exp(logs)) / slower,
        "all pixels": float(both[1] / both[0]) / slower,
        "energy, %": 100.0 * (means[0] / means[1] - 1.0),
        "± %": 100.0 * float(np.hypot(*noise)),
    }


def main(
    width: int = 128,
    repeats: int = 6,
    materials: tuple[str, ...] = MATERIALS,
    rigs: tuple[str, ...] = RIGS,
) -> list[Target]:
    """Measure all cells; return the targets."""
    engine = choose()
    engine.start()
    rows: list[Row] = []
    with TemporaryDirectory() as folder:
        lights = {**LIGHTS, "HDRI": hdri(Path(folder) / "place.exr")}
        for material, rig in product(materials, rigs):
            rows += measure(material, rig, lights[rig], (width, width * 9 // 16), repeats, engine)
    show("Variance per CPU second, over Mitsuba's", rows)
    keep("variance", rows)
    gains = np.array([float(row["gain"]) for row in rows])
    excess = [abs(float(row["energy, %"])) - 2.0 * float(row["± %"]) for row in rows if row["samples"] == 64]
    return [
        Target("variance per CPU second", "least gain", float(gains.min()), least=LEAST),
        Target(
            "variance per CPU second",
            "least gain, all pixels",
            min(float(row["all pixels"]) for row in rows),
            least=LEAST_ALL,
        ),
        Target("variance per CPU second", "median gain", float(np.median(gains)), least=LEAST_MEDIAN),
        Target("energy", "beyond two standard errors", max(excess) / 100.0, most=MOST_ENERGY),
    ]


def _chosen(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return those of the names that the command line has, or all."""
    return tuple(name for name in names if name in sys.argv) or names


if __name__ == "__main__":
    numbers = [int(each) for each in sys.argv[1:] if each.isdigit()]
    size = [64, 4] if "--quick" in sys.argv else [128, 6]
    size[: len(numbers)] = numbers
    targets = main(size[0], size[1], _chosen(MATERIALS), _chosen(RIGS))
    show("Targets", [target.row for target in targets])
