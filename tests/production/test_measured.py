"""Looks that show how fast the flow is: what they need, and what decides their pictures."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.production.request.framing import Framing
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shading import Shading
from flowsculpt.pipeline.production.request.shot_source import ShotSource
from flowsculpt.pipeline.resample import Thresholds
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.palettes import colour_map
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.scene_stage import StagePlacement

BALL = "title: T\nframes: 1-6\nsubject: {solid: icosphere, radius: 1}\nresample: {max_edge_length: 0.6}\n"
SPINNING = "flows:\n  - rotation: {axis: y, speed: 120}\n"
LATE = "flows:\n  - translation: {rate: {ease: linear, keys: {1: [0, 0, 0], 3: [0, 0, 0], 6: [8, 0, 0]}}}\n"


def take_of(text: str) -> RenderRequest:
    return RenderRequest(ShotSource(text, Path("T010_tiny.yaml")), "draft", "none", (1,))


def raw_keys(request: RenderRequest) -> list[str]:
    framings = {n: Framing(Camera((0, 1, 9), (0, 1, 0)), StagePlacement()) for n in request.angles}
    return [request.keys.raw(n, framings) for n in request.angles]


def changed(look: str) -> list[bool]:
    """Tell which pictures have other keys once the last key of a late motion changes."""
    text = BALL + f"look: {look}\n"
    before = raw_keys(take_of(text + LATE))
    after = raw_keys(take_of(text + LATE.replace("[8, 0, 0]", "[9, 0, 0]")))
    return [a != b for a, b in zip(before, after, strict=True)]


@pytest.mark.parametrize("number", [1, 4, 6])
def test_what_spins_is_faster_the_further_out_it_is(number: int) -> None:
    shot = read_shot("a.yaml", BALL + SPINNING)
    frame = next(frame for frame in animate(shot) if frame.number == number)
    shading = Shading.of(frame, Thresholds(1.0), 1)
    out = np.linalg.norm(shading.arrays()["vertices"][:, [0, 2]], axis=1)
    found = shading.speeds(shot.motion)
    assert found.shape == (len(out), 1)
    assert found[:, 0] == pytest.approx(math.radians(120.0) * out, rel=1e-3, abs=1e-3)


def test_a_speed_just_after_a_frame_is_part_of_its_picture_and_a_stretch_is_not() -> None:
    assert changed("clay") == changed("strain") == [False] * 3 + [True] * 3
    assert changed("speed") == [False] * 2 + [True] * 4


def test_previews_show_what_is_measured() -> None:
    from flowsculpt.pipeline.plugins.preview.sketch import shape_of

    arrays = {
        "vertices": np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]),
        "normals": np.float32([[0, 0, 1]] * 3),
        "faces": np.int32([[0, 1, 2]]),
        "material": np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]),
    }
    speed = np.float32([[0], [4], [9]])
    shown = shape_of({**arrays, "speed": speed}, LOOKS["speed"]).colours
    ends = colour_map("viridis")[[0, -1, -1]]
    assert shown is not None and np.abs(shown - ends).max() < 1e-6
    points = {"vertices": arrays["vertices"], "radii": np.float32([1, 1, 1]), "material": arrays["material"]}
    balls = shape_of({**points, "speed": speed}, LOOKS["speed"])
    assert balls.colours is not None and len(balls.colours) == len(balls.vertices)
    assert np.abs(balls.colours[0] - ends[0]).max() < 1e-6
