"""`python -m benchmarks.sizzle [WIDTH]`: the effect of resampling on a mirror, against the exact picture.

A chrome sphere among long lamps, so near that it fills the picture, turns by 2.5° a frame and is resampled
in each: its maximum edge length is a formula of the position, so that triangles that turn towards +x merge
and others are split. The exact picture is of Mitsuba's own sphere, which looks the same at every angle. All
pictures, WIDTH pixels wide (240), use the same random numbers, so that differences come from the surface and
not from noise. Each row is a placement, normals and a tessellation (`smooth: {tessellate}`) with the error of
normals, degrees rms; the error of pictures, rms; and the standard deviation of pictures over time, its mean
over pixels: sizzle. Pictures are measured in steps of a display. Writes `benchmarks/out/sizzle.json` and a
PNG.
"""

from __future__ import annotations

import sys
from typing import Literal

import numpy as np

from benchmarks.equal_quality import one_pass
from benchmarks.errors import put, shown
from benchmarks.normals import angles
from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.animation import MeshFrame, animate
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.flow import Streamlines
from flowsculpt.pipeline.flow.catalogue.basic import Rotation
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.production.request.shading import Shading
from flowsculpt.pipeline.resample import Report, ThresholdFormula, Thresholds
from flowsculpt.pipeline.shot import Motion, Resampling, Solid
from flowsculpt.render.mitsuba import emitters, materials
from flowsculpt.render.mitsuba.engine import choose
from flowsculpt.render.mitsuba.mitsuba_scene import SceneRenderer, build_scene
from flowsculpt.render.mitsuba.sensor import sensor
from flowsculpt.render.mitsuba.shapes import stage_shapes
from flowsculpt.render.mitsuba.texture_coordinates import ScaledCoordinates
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import BATCH_SAMPLES, Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface

Way = Literal["chord", "curved", "exact"]
Normals = Literal["carried", "geometric"]

MODES: dict[str, tuple[Way, Normals, int]] = {
    "chord, geometric": ("chord", "geometric", 1),
    "curved, geometric": ("curved", "geometric", 1),
    "exact, geometric": ("exact", "geometric", 1),
    "exact, geometric, 3 pieces": ("exact", "geometric", 3),
    "exact, carried": ("exact", "carried", 1),
    "exact, carried, 3 pieces": ("exact", "carried", 3),
}
LAST, LOOKED_AT = 12, 6
"""Frames, and the number of frames that pictures are made of."""

TURN = np.radians(60.0)
"""Radians a second, of 24 frames."""

LOOK, RIG, STAGE, PLACEMENT = LOOKS["chrome"], LIGHTS["gallery"], STAGES["cyclorama"], StagePlacement()
CAMERA = Camera((1.4, 1.9, 3.6), (0.0, 1.0, 0.0), field_of_view=np.radians(19.0))
DEPTH, SEED, PASSES = 6, 5, 2


def film(placement: Way, normals: Normals) -> Motion:
    """Return the shot of a sphere of radius 1 about the origin, its edges between 0.07 and 0.13."""
    resampling = Resampling(
        Thresholds(ThresholdFormula("0.1 + 0.03 * x")), placement=placement, normals=normals
    )
    flow = Streamlines(Rotation(speed=float(TURN)))
    return Motion(
        FrameRange.parse(f"0-{LAST}"), FrameRate.of(24), Solid.of("icosphere", {}), flow, resampling
    )


def measure(name: str, size: tuple[int, int], truth: AnyArray) -> tuple[Row, AnyArray]:
    """Measure one mode; return its row and its last picture."""
    placement, normals, pieces = MODES[name]
    motion = film(placement, normals)
    assert motion.resampling is not None
    pictures, off, operations = [], [], 0
    for frame in animate(motion):
        operations += _operations(frame)
        if frame.number > LAST - LOOKED_AT:
            arrays = Shading.of(frame, motion.resampling.thresholds, pieces).arrays()
            points, turned = arrays["vertices"].astype(np.float64), arrays["normals"].astype(np.float64)
            off.append(angles(turned, points / np.linalg.norm(points, axis=1, keepdims=True)))
            lifted = (points + np.array([0.0, 1.0, 0.0])).astype(np.float32)
            pictures.append(_picture(Surface(lifted, arrays["normals"], arrays["faces"]), size))
    seen = 255.0 * np.stack([shown(picture) for picture in pictures])
    row: Row = {
        "mode": name,
        "splits and collapses a frame": operations / LAST,
        "normals off, degrees": float(np.degrees(np.sqrt(np.mean(np.concatenate(off) ** 2)))),
        "error": float(np.sqrt(((seen - 255.0 * shown(truth)) ** 2).mean())),
        "sizzle": float(seen.std(axis=0).mean()),
    }
    return row, pictures[-1]


def _operations(frame: MeshFrame) -> int:
    report = frame.report.resampling if frame.report else None
    return report.splits + report.collapses if isinstance(report, Report) else 0


def _picture(surface: Surface, size: tuple[int, int]) -> AnyArray:
    scene = Scene(surface, LOOK, RIG, STAGE, PLACEMENT, CAMERA)
    return _rendered(build_scene(scene, Quality(*size, samples=BATCH_SAMPLES, depth=DEPTH)).beauty)


def _rendered(made: SceneRenderer) -> AnyArray:
    return np.asarray(sum(one_pass(made, SEED + i) for i in range(PASSES)) / PASSES)


def exact(size: tuple[int, int]) -> AnyArray:
    """Return the picture of a true sphere."""
    import mitsuba as mi

    of_metal = materials.surface_bsdf(LOOK, (), ScaledCoordinates(np.zeros((1, 2))), PLACEMENT.size)
    scene = {
        "type": "scene",
        "sensor": sensor(CAMERA, size),
        "subject": {"type": "sphere", "center": [0.0, 1.0, 0.0], "radius": 1.0, "material": of_metal},
        **stage_shapes(STAGE, PLACEMENT, CAMERA, size),
        **emitters.emitters(RIG, PLACEMENT.matrix()),
    }
    path = {**materials.path_integrator([LOOK], DEPTH), "hide_emitters": not RIG.shows_sky}
    loaded = mi.load_dict(scene, parallel=False, optimize=False)
    return _rendered(SceneRenderer(loaded, mi.load_dict(path, parallel=False, optimize=False)))


def main(width: int = 240) -> list[Target]:
    """Measure all modes; return the target, the gain of carried normals."""
    choose().start()
    size = (width, width * 9 // 16)
    truth, rows = exact(size), []
    pictures = {"exact": truth}
    for name in MODES:
        row, pictures[name] = measure(name, size, truth)
        rows.append(row)
    show(f"A chrome sphere, {PASSES * BATCH_SAMPLES} samples, steps of 255", rows)
    keep("sizzle", rows)
    put("sizzle", {name: pictures[name] for name in ("exact", "chord, geometric", "exact, carried")})
    by_name = {str(row["mode"]): float(row["sizzle"]) for row in rows}
    ratio = by_name["exact, carried"] / by_name["chord, geometric"]
    return [Target("chrome sphere", "sizzle, carried / of the triangles", ratio, most=0.25)]


if __name__ == "__main__":
    show("Targets", [target.row for target in main(*map(int, sys.argv[1:]))])
