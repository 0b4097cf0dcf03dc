"""Between frames: the same points on the very flow, as fast as it is, and straight on at the ends."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import MeshFrame, animate, mesh_at_subframe
from flowsculpt.pipeline.mesh.normals import split_at_creases
from flowsculpt.pipeline.production.request.framing import Framing
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shading import (
    Shading,
    SurfaceMotion,
    framing_at,
    turning_motion,
)
from flowsculpt.pipeline.production.request.shot_source import ShotSource
from flowsculpt.pipeline.resample import Thresholds
from flowsculpt.pipeline.shot import Shot, read_shot
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.scene_stage import StagePlacement
from tests.needed_plugins import shot_rows

pytestmark = pytest.mark.quick

HEAD = "title: T\nframes: 1-6\n"
BALL = HEAD + "subject: {solid: icosphere, radius: 1}\nresample: {max_edge_length: 0.6}\n"
SLIDING = "flows:\n  - translation: {rate: [2.4, 0, -1.2]}\n"
SPINNING = "flows:\n  - rotation: {axis: y, speed: 240}\n"
LATE = "flows:\n  - translation: {rate: {ease: linear, keys: {1: [0, 0, 0], 3: [0, 0, 0], 6: [8, 0, 0]}}}\n"
CLOUD = HEAD + "subject: {cloud: {solid: icosphere, radius: 1}, count: 40, radius: 0.06}\n"
NET = HEAD + "subject: {net: {solid: tube}}\nsmooth: {tessellate: 2}\n"


def shot_of(text: str) -> Shot:
    return read_shot(Path("a.yaml"), text)


def movement(text: str, number: int) -> tuple[Shot, MeshFrame, SurfaceMotion]:
    shot = shot_of(text)
    frame = next(frame for frame in animate(shot) if frame.number == number)
    resampling = shot.motion.resampling_at(number)
    thresholds = resampling.thresholds if resampling else Thresholds(1.0)
    return shot, frame, Shading.of(frame, thresholds, shot.picture.tessellate).moved_by(shot.motion)


@pytest.mark.parametrize("subject", shot_rows([BALL, BALL + "smooth: {tessellate: 2}\n", CLOUD, NET]))
@pytest.mark.parametrize("number", [1, 3, 6])
def test_what_slides_has_the_same_velocity_everywhere_and_always(subject: str, number: int) -> None:
    _, _, moving = movement(subject + SLIDING, number)
    vertices = moving.at(0.0)[0]
    assert moving.velocity() == pytest.approx(np.tile([2.4, 0.0, -1.2], (len(vertices), 1)), abs=1e-9)
    for offset in (-1.0, -0.3, 0.7, 1.0):
        assert moving.displacement(offset) == pytest.approx(
            np.tile(np.multiply([2.4, 0.0, -1.2], offset / 24.0), (len(vertices), 1)), abs=1e-9
        )


@pytest.mark.parametrize("number", [1, 3, 6])
def test_what_spins_is_as_fast_as_it_is_far_out(number: int) -> None:
    _, _, moving = movement(BALL + SPINNING, number)
    points, normals = moving.at(0.0)
    speed = math.radians(240.0)
    assert normals is not None
    assert moving.velocity() == pytest.approx(np.cross([0.0, speed, 0.0], points), abs=2e-3)
    if number == 3:
        angle = 0.5 * speed / 24.0
        turn = np.array(
            [[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]]
        )
        moved, turned = moving.at(0.5)
        assert moved == pytest.approx(points @ turn.T, abs=1e-6)
        assert turned is not None and turned == pytest.approx(normals @ turn.T, abs=5e-3)


def test_moments_are_on_the_flow_with_the_points_of_their_frame() -> None:
    shot, frame, moving = movement(BALL + SPINNING, 4)
    for offset in (-0.25, 0.25, 1.0):
        there = mesh_at_subframe(shot.motion, frame, 4 + offset).vertices
        assert moving.at(offset)[0][: len(there)] == pytest.approx(there, abs=1e-12)


def test_between_frames_creases_and_faces_stay_and_normals_turn_smoothly() -> None:
    box = HEAD + "subject: {solid: box, size: [2, 2, 2]}\nresample: {max_edge_length: 0.5}\n"
    twist = "flows:\n  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 6: 300}}}\n"
    _, frame, moving = movement(box + twist, 4)
    split = split_at_creases(frame.mesh, shot_of(box).motion.resampling_at(4).thresholds.hard_angle)
    ways = [moving.at(offset) for offset in (-0.02, -0.01, 0.0, 0.01, 0.02)]
    assert {len(points) for points, _ in ways} == {len(split.vertices)}
    for (a, n), (b, m) in pairwise(ways):
        assert np.abs(b - a).max() < 0.05
        assert np.einsum("ij,ij->i", n, m).min() > 0.99
        assert np.linalg.norm(m, axis=1) == pytest.approx(1.0)


def test_where_the_flow_rests_nothing_moves() -> None:
    assert not movement(BALL + LATE, 2)[2].velocity().any()
    assert not movement(BALL + SLIDING + "speed: 0\n", 3)[2].velocity().any()
    assert not movement(BALL + LATE, 1)[2].displacement(-0.5).any()


def test_beyond_the_last_frame_points_go_straight_on() -> None:
    _, _, moving = movement(BALL + SPINNING, 6)
    pace = moving.velocity() / 24.0
    assert moving.displacement(0.5) == pytest.approx(0.5 * pace, abs=1e-9)
    assert moving.displacement(1.0) == pytest.approx(pace, abs=1e-9)


def test_a_turntable_turns_by_as_much_as_its_pictures_are_apart() -> None:
    points = np.array([[1.0, 0.0, 1.0], [-1.0, 0.0, -1.0], [1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
    moving = turning_motion(points, points, 0.0, math.radians(5.0), 24.0)
    there, normals = moving.at(1.0)
    assert np.linalg.norm(there, axis=1) == pytest.approx(np.linalg.norm(points, axis=1))
    assert normals == pytest.approx(there)
    assert moving.velocity()[0] == pytest.approx(math.radians(120.0) * np.array([1.0, 0.0, -1.0]), rel=1e-4)


def test_cameras_go_from_picture_to_picture_and_on_at_the_ends() -> None:
    def framing(x: float) -> Framing:
        return Framing(Camera((x, 1.0, 9.0), (0.0, 1.0, 0.0)), StagePlacement((x, 0.0, 0.0), 1.0 + x))

    framings = {n: framing(float(n)) for n in (3, 4, 5)}
    found = {o: framing_at(framings, n, o).camera.origin[0] for n, o in ((4, 0.25), (4, -0.5), (5, 0.3))}
    assert found == pytest.approx({0.25: 4.25, -0.5: 3.5, 0.3: 5.3})
    assert framing_at(framings, 3, -0.25).placement.size == pytest.approx(3.75)
    assert framing_at({3: framing(3.0)}, 3, 0.5) == framing(3.0)


def take_of(text: str) -> RenderRequest:
    return RenderRequest(ShotSource(text, Path("T010_tiny.yaml")), "draft", "none", (1,))


def raw_keys(text: str) -> list[str]:
    request = take_of(text)
    framings = {n: Framing(Camera((0, 1, 9), (0, 1, 0)), StagePlacement()) for n in request.angles}
    return [request.keys.raw(n, framings) for n in request.angles]


def test_a_shutter_and_layers_change_pictures_and_nothing_before_them() -> None:
    plain = take_of(BALL + SPINNING)
    for more in ("shutter: {angle: 180}\n", "aovs: [velocity]\n", "aovs: {beauty: float}\n"):
        changed = take_of(BALL + SPINNING + more)
        assert changed.keys.mesh(3) == plain.keys.mesh(3)
        assert changed.keys.normals(3) == plain.keys.normals(3)
        assert changed.keys.cameras == plain.keys.cameras
        assert not set(raw_keys(BALL + SPINNING)) & set(raw_keys(BALL + SPINNING + more))
    for same in ("shutter: {angle: 0}\n", "aovs: []\n"):
        assert raw_keys(BALL + SPINNING + same) == raw_keys(BALL + SPINNING)


def test_a_shutter_that_opens_late_leaves_the_pictures_before_alone() -> None:
    keyed = "shutter: {angle: {ease: constant, keys: {1: 0, 4: 180}}}\n"
    before, after = raw_keys(BALL + SPINNING), raw_keys(BALL + SPINNING + keyed)
    assert [a == b for a, b in zip(before, after, strict=True)] == [True] * 3 + [False] * 3


def test_what_acts_after_a_frame_counts_for_one_whose_shutter_is_open_then() -> None:
    """A key at frame 6 acts from frame 3 on: on the picture of 3 only while its shutter is open after it."""
    text, other = BALL + LATE, BALL + LATE.replace("[8, 0, 0]", "[9, 0, 0]")

    def changed(shutter: str) -> list[bool]:
        return [a != b for a, b in zip(raw_keys(text + shutter), raw_keys(other + shutter), strict=True)]

    assert changed("") == [False] * 3 + [True] * 3
    assert changed("shutter: {angle: 180}\n") == [False] * 2 + [True] * 4
    assert changed("shutter: {angle: 180, phase: -180}\n") == [False] * 3 + [True] * 3
