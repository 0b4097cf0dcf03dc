"""Scenes on the border of what is possible give numbers everywhere, not only where the sums leave NaN out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flowsculpt.render.frame.render_frame import ShutterInterval
from flowsculpt.render.frame.sample_sums import SampleSums
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS, Absorption, Diffuse, Glass, Metal, Plastic, Subsurface
from flowsculpt.render.scene.patterns import Pigment
from flowsculpt.render.scene.render_camera import WideCamera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import MotionSample
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig, Softbox
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.sky import BRIGHTEST, Daylight, Environment
from flowsculpt.render.scene.surface import Surface
from tests.render.conftest import CAMERA, ball

BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
BALL = replace(ball(), rest=ball().vertices)
SIDES = np.float32([1, -1, 1])[np.arange(len(BALL.vertices)) % 3, None]
SKY = np.full((16, 32, 3), 1e-38, np.float32)
SKY[3, 4], SKY[0, 5] = BRIGHTEST, 1e6
CHIPS = Pigment(
    "chips", (BLACK, WHITE, WHITE), 3e-6, turbulence=1.0, share=0.0, softness=0.0, gap=1.0, sizes=3
)
PATCHED = replace(CHIPS, heights=(0.0, 1.0, 0.5))


class MadeSky(Environment):
    """A map that no file holds: dark, with a pixel as bright as can be, and one at the zenith."""

    def pixels(self) -> Any:
        return SKY


def broken() -> Surface:
    """A sphere with normals that point inwards, faces without area, and slivers."""
    points, (a, b, c) = BALL.vertices.copy(), BALL.faces[::7].T
    points[a[::2]], points[a[1::2]] = points[b[::2]], (points[b[1::2]] + points[c[1::2]]) / 2 + 1e-7
    faces = np.concatenate([BALL.faces, [[0, 0, 0], [3, 4, 3]]]).astype(np.int32)
    return replace(BALL, vertices=points, normals=BALL.normals * SIDES, faces=faces, rest=points)


def pane(thickness: float) -> Surface:
    """Two squares, back to back."""
    square = np.float32([[-1, 0.2, 0], [1, 0.2, 0], [1, 1.8, 0], [-1, 1.8, 0]])
    points = np.concatenate([square, square - np.float32([0, 0, thickness])])
    normals = np.repeat(np.float32([[0, 0, 1], [0, 0, -1]]), 4, axis=0)
    return Surface(points, normals, np.int32([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]]), rest=points)


BARE = replace(BALL, normals=BALL.normals * (np.arange(len(BALL.normals)) < 100)[:, None].astype(np.float32))
POINT = replace(BALL, vertices=np.zeros_like(BALL.vertices) + np.float32([0, 1, 0]))
CLOUDY = Subsurface((1e-4, 1.0, 100.0))
LOW = LightRig(daylight=Daylight(elevation=1e-7, turbidity=10.0))
BRIGHT = LightRig(environment=MadeSky("made"))
NO_DAY = LightRig(daylight=Daylight(sun=0.0, sky=0.0))
TOUCHING = LightRig(tuple(Softbox((0.0, y, 0.0), 1e-6, 1.0, (1e6,) * 3, (0.0, 9.0, 0.0)) for y in (0.0, 1.0)))
CATCHER = replace(STAGES["cyclorama"], shadow_catcher=True)
SCENES: dict[str, dict[str, Any]] = {
    "no normals, matt": {"surface": BARE, "lights": LIGHTS["daylight"]},
    "no normals, glass": {"surface": BARE, "look": LOOKS["glass"]},
    "no normals, scratches": {"surface": BARE, "look": LOOKS["brushed"]},
    "mirrors, slivers": {"surface": broken(), "look": Metal(WHITE, 0.0), "stage": STAGES["turntable"]},
    "relief, slivers": {"surface": broken(), "look": Plastic(WHITE, pigment=PATCHED)},
    "bright pixels": {"surface": broken(), "look": Metal(BLACK, 0.0), "lights": BRIGHT},
    "low sun, caustics": {"look": Glass(WHITE), "lights": LOW},
    "no light, caustics": {"look": Glass(WHITE), "lights": NO_DAY},
    "light groups, caustics": {"look": Glass(BLACK), "lights": LIGHTS["daylight"].grouped({})},
    "softboxes in glass": {"look": Glass(WHITE), "lights": TOUCHING},
    "collapsed glass": {"surface": POINT, "look": LOOKS["glass"]},
    "thin glass": {
        "surface": pane(1e-6),
        "look": Glass(WHITE, absorption=Absorption((1e-9, 0.5, 1.0), 1e-4)),
    },
    "no glass at all": {"surface": pane(0.0), "look": Glass(WHITE, 0.3, refraction=1.0001)},
    "below the surface": {"surface": broken(), "look": Plastic(BLACK, 0.0, subsurface=CLOUDY)},
    "cloudy glass": {"surface": broken(), "look": Glass(WHITE, subsurface=CLOUDY)},
    "shadow catcher": {"surface": BARE, "look": Diffuse(BLACK), "stage": CATCHER},
    "a still shutter": {"shutter": ShutterInterval(-0.25, 0.25, lambda offset: STILL)},
    "all directions": {"camera": WideCamera(CAMERA.origin, CAMERA.target), "look": Plastic(WHITE)},
}
STILL = MotionSample(BALL, StagePlacement(), CAMERA)


@pytest.mark.parametrize("name", SCENES)
def test_no_sample_of_a_hostile_scene_is_nan(
    name: str, rendered: Callable[..., RenderedFrame], engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    if engine.variant == "scalar_rgb":
        pytest.skip("most of these need a compiled variant")
    from flowsculpt.render.integrator import path_tracer

    seen, add = [], SampleSums.add

    def added(sums: SampleSums, means: np.ndarray, *others: Any) -> None:
        seen.append(bool(np.isfinite(means).all()))
        add(sums, means, *others)

    monkeypatch.setattr(SampleSums, "add", added)
    monkeypatch.setattr(path_tracer, "_finite", lambda parts: parts)  # else such light is black
    scene = {"surface": BALL, "quality": Quality(32, 18, 32, depth=8, auxiliary_samples=4), **SCENES[name]}
    following = replace(STILL, subject=scene["surface"], camera=scene.get("camera", CAMERA))
    frame = rendered(**scene, aovs=("motion", "rest", "noise", "samples"), following=following)
    assert len(seen) > 1 and all(seen)
    assert all(np.isfinite(layer).all() for layer in frame.arrays.values())
