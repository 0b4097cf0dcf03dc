"""Rigid copies: the flow carries and turns each as a whole, and their shape stays."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.animation import MeshFrame, animate, descent, moved_to_subframe
from flowsculpt.pipeline.errors import FrameError, ShotError
from flowsculpt.pipeline.mesh.placed_copies import Placements, nearest_rotations
from flowsculpt.pipeline.production.request.shading import Shading
from flowsculpt.pipeline.shot import Motion, read_shot
from flowsculpt.pipeline.statistics import mesh_statistics
from tests.needed_plugins import needs_plugins, shot_rows

SHOT = """
title: Tiles
frames: 1-6
subjects:
  tiles:
    solid: box
    size: [0.3, 0.1, 0.2]
    copies: {count: 5, seed: 3, rigid: true, region: {sphere: {radius: 1.2}}}
resample: {max_edge_length: 0.1}
flows:
  - FLOW
"""

CLOUD, CURVED = "cloud: {solid: box}\n    radius: 0.1", "{curvature: {edges_per_turn: 9}}"
VORTEX = "vortex_ring: {radius: 0.8, core: 0.3, strength: 6}"


def motion_of(flow: str = VORTEX, text: str = SHOT) -> Motion:
    return read_shot("a.yaml", text.replace("FLOW", flow)).subjects[0].motion


MOTION = motion_of()


def lengths(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, :, None] - points[:, None], axis=3)


@settings(deadline=None, max_examples=8)
@given(
    st.floats(-40, 40),
    st.sampled_from(
        [
            "vortex_ring: {strength: S}",
            "shear: {amount: S}",
            "curl_noise: {strength: S}",
            "twist: {amount: S}",
        ]
    ),
)
@needs_plugins("fields")
def test_all_distances_in_a_copy_stay(strength: float, flow: str) -> None:
    frames = list(animate(motion_of(flow.replace("S", str(strength)))))
    before, after = (f.mesh.vertices.reshape(5, -1, 3) for f in (frames[0], frames[-1]))
    assert np.abs(lengths(after) - lengths(before)).max() < 1e-12


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31))
def test_a_rotation_turns_copies_by_exactly_that_rotation(seed: int) -> None:
    """Also by more than 90° a frame; the flow maps points exactly here, without an integrator."""
    (turn,) = nearest_rotations(np.random.default_rng(seed).standard_normal((1, 3, 3)))
    first, *_, last = animate(MOTION, flow=lambda points, time, dt: points @ turn.T)
    assert np.abs(last.mesh.vertices - first.mesh.vertices @ np.linalg.matrix_power(turn.T, 5)).max() < 1e-12


def test_the_flow_of_a_rotation_turns_copies_as_it_turns_points() -> None:
    motion = motion_of("rotation: {axis: [1, 2, 0.5], speed: 300}")
    first, *_, last = animate(motion)
    points = first.mesh.vertices
    for number in range(2, 7):
        points = motion.step_into(motion.flow, number).apply(points)
    assert np.abs(last.mesh.vertices - points).max() < 1e-6


@given(st.integers(0, 2**31))
def test_the_nearest_rotation_of_a_stretch_of_a_rotation_is_that_rotation(seed: int) -> None:
    random = np.random.default_rng(seed)
    turns = nearest_rotations(random.standard_normal((4, 3, 3)))
    assert np.abs(turns @ turns.swapaxes(1, 2) - np.eye(3)).max() < 1e-12
    assert np.abs(np.linalg.det(turns) - 1.0).max() < 1e-12
    stretch = random.standard_normal((4, 3, 3))
    stretch = stretch @ stretch.swapaxes(1, 2) + 0.1 * np.eye(3)
    assert np.abs(nearest_rotations(turns @ stretch) - turns).max() < 1e-9


def test_a_shear_turns_a_copy_on_and_on_and_never_by_a_jump() -> None:
    """The whole gradient of a shear turns by less than 90°; along the path, half the vorticity turns it."""
    placed, angle = Placements.of(np.zeros((1, 3))), []
    for _ in range(400):
        placed = placed.moved(0.1, lambda p: p + 0.02 * np.outer(p[:, 1], (1.0, 0.0, 0.0)))
        turn = placed.matrices[0, :, :3]
        angle.append(np.arctan2(turn[1, 0], turn[0, 0]))
    steps = np.diff(np.unwrap(angle))
    assert np.allclose(steps, -np.arctan(0.01), atol=1e-12)
    assert np.unwrap(angle)[-1] < -np.pi


def test_a_frame_is_stored_as_one_copy_and_resumes_to_the_same_bits() -> None:
    motion = MOTION
    frames = list(animate(motion))
    arrays = frames[2].to_arrays()
    assert len(arrays["vertices"]) == len(frames[2].mesh.vertices) / 5
    read = MeshFrame.from_arrays(arrays, frames[2].number)
    assert np.array_equal(read.mesh.vertices, frames[2].mesh.vertices)
    last = list(animate(motion, resume=read))[-1]
    assert np.array_equal(last.mesh.vertices, frames[-1].mesh.vertices)
    assert len(descent(frames).mixed(frames[0].mesh.vertices)) == len(last.mesh.vertices)


def test_copies_within_the_shutter_are_rigid_and_meet_the_next_frame() -> None:
    motion = MOTION
    frames = list(animate(motion))
    now, after = frames[2], frames[3]
    assert np.array_equal(moved_to_subframe(motion, now, 4).mesh.vertices, after.mesh.vertices)
    shading = Shading.of(now, motion.thresholds_at(3), 2)
    shown, arrays = shading.moved_by(motion), shading.arrays()
    points, normals = shown.at(0.0)
    assert np.allclose(points, arrays["vertices"], atol=1e-6)
    assert np.allclose(normals, arrays["normals"], atol=1e-6)
    half, turned = (values.reshape(5, -1, 3) for values in shown.at(0.5))
    assert np.abs(lengths(half) - lengths(points.reshape(5, -1, 3))).max() < 1e-12
    assert np.abs(np.linalg.norm(turned, axis=2) - 1.0).max() < 1e-12
    speeds = Shading.vertex_motion(motion, now).velocity().reshape(5, -1, 3)
    away = now.mesh.vertices.reshape(5, -1, 3) - now.copies.origins[:, None]
    stretch = np.einsum("nvi,nvi->nv", away, speeds - speeds.mean(axis=1, keepdims=True))
    assert np.abs(stretch).max() < 1e-3 * np.abs(speeds).max(), "a rigid body does not stretch"


def test_statistics_are_those_of_all_copies() -> None:
    motion = motion_of(text=SHOT.replace("rigid: true", "rigid: true, size: [0.4, 1]"))
    *_, last = animate(motion)
    found, whole = last.report.statistics, mesh_statistics(last.mesh, count_crossings=False)
    assert found is not None and found.crossings is None
    for name in ("mean_edge", "diameter", "median_dihedral", "area"):
        assert getattr(found, name) == pytest.approx(getattr(whole, name), rel=1e-7)


def test_more_vertices_than_can_be_drawn_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flowsculpt.pipeline.animation.simulated_surfaces.MOST_SHOWN", 300)
    with pytest.raises(FrameError, match="5 copies of 78 vertices are 390, and 300 are the most"):
        next(animate(MOTION))


def test_material_positions_and_copies_are_told_by_order() -> None:
    motion = MOTION
    first, *_, last = animate(motion)
    count = len(first.own.vertices)
    assert np.array_equal(motion.copy_indices(last.mesh.vertices), np.repeat(np.arange(5), count))
    assert np.allclose(last.mesh.attributes["material"], first.mesh.vertices)


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    shot_rows(
        [
            ("solid: box\n    size: [0.3, 0.1, 0.2]", CLOUD, "points have no shape"),
            ("max_edge_length: 0.1", f"max_edge_length: {CURVED}", "rigid copies keep the shape"),
        ]
    ),
)
def test_what_cannot_be_rigid_is_refused(old: str, new: str, fault: str) -> None:
    assert old in SHOT
    with pytest.raises(ShotError, match=fault):
        motion_of(text=SHOT.replace(old, new))
