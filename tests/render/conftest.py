"""A small sphere on a small stage, rendered in this process by the engine chosen here."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.mitsuba.engine import Engine, choose
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface

CAMERA = Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0))
TINY = Quality(48, 27, samples=4, depth=3, auxiliary_samples=4)


def ball(rings: int = 12, sides: int = 24) -> Surface:
    """A sphere of radius 1 that stands on the floor."""
    latitude = np.linspace(0.0, math.pi, rings + 1)[:, None]
    longitude = np.linspace(0.0, 2.0 * math.pi, sides, endpoint=False)[None, :]
    normals = np.stack(
        [
            np.sin(latitude) * np.cos(longitude),
            np.cos(latitude) * np.ones_like(longitude),
            np.sin(latitude) * np.sin(longitude),
        ],
        axis=-1,
    ).reshape(-1, 3)
    i = np.arange(rings)[:, None] * sides
    j = np.arange(sides)[None, :]
    k = (j + 1) % sides
    a, b, c, d = i + j, i + k, i + sides + k, i + sides + j
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    vertices = normals + np.array([0.0, 1.0, 0.0])
    return Surface(vertices.astype(np.float32), normals.astype(np.float32), faces.astype(np.int32))


@pytest.fixture(scope="session")
def engine() -> Engine:
    chosen = choose(threads=2)
    chosen.start()
    return chosen


@pytest.fixture(scope="session")
def sphere() -> Surface:
    return ball()


@pytest.fixture(scope="session")
def rendered(sphere: Surface, engine: Engine) -> Callable[..., RenderedFrame]:
    """The clay sphere in the studio, with any of render_frame's arguments changed."""

    def render(**changes: Any) -> RenderedFrame:
        arguments: dict[str, Any] = {
            "surface": sphere,
            "look": LOOKS["clay"],
            "lights": LIGHTS["studio"],
            "stage": STAGES["cyclorama"],
            "placement": StagePlacement(),
            "camera": CAMERA,
            "quality": TINY,
            "seed": 7,
            "engine": engine,
            **changes,
        }
        parts = [
            arguments.pop(name) for name in ("surface", "look", "lights", "stage", "placement", "camera")
        ]
        return render_frame(Scene(*parts), **arguments)

    return render


@pytest.fixture(scope="session")
def picture(rendered: Callable[..., RenderedFrame]) -> RenderedFrame:
    return rendered()
