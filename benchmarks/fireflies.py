"""`python -m benchmarks.fireflies [WIDTH]`: light that is lost to fireflies.

A torus in all looks and all light rigs, WIDTH × 9/16 WIDTH pixels (160), with 16 and 64 samples: the light
that pictures with `fireflies: soft` lack, of that of the same samples with `keep`; and what of it is spread
over other pixels, or left in its own because it is too bright for that. `firm` removes both. Daylight is
taken twice, once with the sun in the picture. Targets: 0.5% lost with 16 samples and 0.1% with 64, in the
worst cell. Writes `benchmarks/out/fireflies.json`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.flicker import CAMERA, subject
from benchmarks.report import Row, Target, keep, show
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.mitsuba.engine import Engine, choose
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement

DEPTH = 10
MOST = {16: 0.5, 64: 0.1}
"""Targets: percent of the light, by samples."""


def scenes() -> Iterator[tuple[str, str, Scene]]:
    """Yield the names of look and light rig, and the scene."""
    plain = subject(0.3)
    attributes = {**plain.attributes, "speed": np.abs(plain.vertices[:, :1]), "strain": plain.vertices[:, :1]}
    surface = replace(plain, rest=plain.vertices, attributes=attributes)
    low = Camera((0.0, 0.5, 8.0), (0.0, 1.5, 0.0), field_of_view=math.radians(60.0))
    day = LIGHTS["daylight"].daylight
    assert day is not None
    sunset = replace(day, elevation=math.radians(12.0), azimuth=math.radians(165.0), visible=True)
    rigs = {name: (rig, CAMERA) for name, rig in LIGHTS.items()}
    rigs["sun in view"] = replace(LIGHTS["daylight"], daylight=sunset), low
    for look, material in LOOKS.items():
        for name, (rig, camera) in rigs.items():
            stage = STAGES["ground" if rig.daylight else "cyclorama"]
            yield look, name, Scene(surface, material, rig, stage, StagePlacement(), camera)


def measure(scene: Scene, samples: int, width: int, engine: Engine) -> Row:
    """Return the percents of the light that are lost, spread and left."""
    quality = Quality(width, width * 9 // 16, samples, DEPTH, auxiliary_samples=1, fireflies="soft")
    soft = render_frame(scene, quality, 1, engine)
    light, mean = (
        float(frame["beauty"].sum(dtype=np.float64))
        for frame in (soft, render_frame(scene, replace(quality, fireflies="keep"), 1, engine))
    )
    moved = {f"{name} {samples}, %": 100.0 * soft.facts[f"light_{name}"] for name in ("spread", "left")}
    return {f"lost {samples}, %": round(100.0 * abs(mean - light) / mean, 5), **moved}


def main(width: int = 160) -> list[Target]:
    """Measure all looks and rigs; return the targets."""
    engine = choose()
    engine.start()
    rows: list[Row] = []
    for look, rig, scene in scenes():
        row: Row = {"look": look, "lights": rig}
        for samples in MOST:
            row |= measure(scene, samples, width, engine)
        rows.append(row)
        print(".", end="", flush=True)
    show("Light lost to fireflies", rows)
    keep("fireflies", rows)
    return [
        Target(
            "fireflies", f"% lost at {samples} samples, worst", max(float(r[name]) for r in rows), most=most
        )
        for samples, most in MOST.items()
        for name in [f"lost {samples}, %"]
    ]


if __name__ == "__main__":
    show("Targets", [target.row for target in main(*map(int, sys.argv[1:]))])
