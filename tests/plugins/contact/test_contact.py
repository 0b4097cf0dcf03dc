"""Contact: no point passes the floor, the map has an inverse and keeps volume, and nothing accumulates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.api import ShotError
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.flow.flow_map import FlowMap
from flowsculpt.pipeline.flow.streamlines import StepPlan
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.plugins.contact.contact_flow import Squashing
from flowsculpt.pipeline.plugins.contact.squash import Squash
from flowsculpt.pipeline.shot import Shot, read_shot

HEIGHT = 2.0
MARGIN = 0.0005 * HEIGHT

DOWN_AND_UP = """
  - translation:
      rate: {ease: linear, keys: {1: [0, -3, 0], 9: [0, -3, 0], 9.01: [0, 3, 0], 18: [0, 3, 0]}}"""

PUTTY = """
title: Putty
frames: 1-18
subject: {solid: icosphere, radius: 1}
resample: RESAMPLE
flows:FLOWS
"""

squashes = st.builds(
    Squash.of,
    floor=st.floats(-3.0, 3.0),
    softness=st.floats(0.05, 3.0),
    margin=st.just(MARGIN),
    lowest=st.floats(-6.0, 4.0),
    axis=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    spreads=st.booleans(),
)


def points_above(lowest: float, seed: int, count: int = 400) -> Floats:
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3))
    points[:, 1] = lowest + HEIGHT * 0.5 * (points[:, 1] + 1.0)
    return points


def lowest_of(squash: Squash) -> float:
    return squash.top - squash.span


@settings(max_examples=200, deadline=None)
@given(squashes, st.integers(0, 1000))
def test_no_point_comes_lower_than_a_thousandth_of_the_height_below_the_floor(squash, seed):
    floor = squash.base + squash.margin
    points = points_above(lowest_of(squash), seed)
    assert squash.apply(points)[:, 1].min() >= floor - 1e-12
    far_below = points - [0.0, 50.0, 0.0]
    assert squash.apply(far_below)[:, 1].min() >= floor - 0.001 * HEIGHT


@settings(max_examples=200, deadline=None)
@given(squashes, st.integers(0, 1000))
def test_the_inverse_returns_points_to_a_billionth(squash, seed):
    points = points_above(lowest_of(squash), seed)
    assert np.abs(squash.undo(squash.apply(points)) - points).max() < 1e-9
    shown = points_above(squash.base + 1.01 * squash.margin, seed)
    assert np.abs(squash.apply(squash.undo(shown)) - shown).max() < 1e-9


@settings(max_examples=100, deadline=None)
@given(squashes, st.integers(0, 1000))
def test_above_the_zone_nothing_moves_and_heights_keep_their_order(squash, seed):
    above = points_above(squash.top, seed)
    assert np.array_equal(squash.apply(above), above)
    rising = np.zeros((300, 3))
    rising[:, 1] = np.linspace(lowest_of(squash) - 1.0, squash.top + 1.0, 300)
    assert (np.diff(squash.apply(rising)[:, 1]) > 0.0).all()


@settings(max_examples=100, deadline=None)
@given(squashes, st.integers(0, 1000))
def test_where_volume_is_kept_the_determinant_of_the_jacobian_is_one(squash, seed):
    """Derivatives are by differences of the sixth order, with steps that go by how fast the map bends."""
    kept = squash._replace(spreads=True)
    points = points_above(lowest_of(kept), seed, 50)
    scale = 0.02 * (1.0 / kept.bend if kept.bend else 1.0)
    # where the zone begins and where it ends, derivatives of the third order jump
    depth = kept.top - points[:, 1]
    points = points[(np.abs(depth) > 3.0 * scale) & (kept.span - depth > 3.0 * scale)]
    weights = {1: 45.0 / 60.0, 2: -9.0 / 60.0, 3: 1.0 / 60.0}
    columns = [
        sum(
            weight * (kept.apply(points + n * scale * axis) - kept.apply(points - n * scale * axis))
            for n, weight in weights.items()
        )
        / scale
        for axis in np.eye(3)
    ]
    determinants = np.linalg.det(np.stack(columns, axis=2))
    assert np.abs(determinants - 1.0).max(initial=0.0) < 1e-4


def test_a_subject_that_does_not_reach_the_floor_is_not_moved():
    squash = Squash.of(0.0, 1.0, MARGIN, 0.0)
    points = points_above(0.0, 1)
    assert np.array_equal(squash.apply(points), points)


def shot_of(folder: Path, flows: str, resample: str = "{max_edge_length: 0.2}") -> Shot:
    path = folder / "A010_putty.yaml"
    path.write_text(PUTTY.replace("FLOWS", flows).replace("RESAMPLE", resample), encoding="utf-8")
    return read_shot(path)


def volume(mesh: TriangleMesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", np.cross(a, b), c).sum() / 6.0)


@pytest.mark.parametrize("softness", [0.5, 1.0, 2.0])
def test_a_ball_pressed_to_half_its_height_keeps_its_volume_and_rises_as_it_was(tmp_path, softness):
    flows = f"{DOWN_AND_UP}\n  - contact: {{floor: -1, softness: {softness}}}"
    meshes = {frame.number: frame.mesh for frame in animate(shot_of(tmp_path, flows))}
    pressed, risen = meshes[9], meshes[18]
    height = float(np.ptp(pressed.vertices[:, 1]))
    assert height < (1.0 if softness <= 1.0 else 1.2) + 0.01
    assert min(mesh.vertices[:, 1].min() for mesh in meshes.values()) >= -1.0 - 0.001 * HEIGHT
    assert abs(volume(pressed) / volume(meshes[1]) - 1.0) < 0.01
    middle = 0.5 * (risen.vertices.min(axis=0) + risen.vertices.max(axis=0))
    assert np.abs(np.linalg.norm(risen.vertices - middle, axis=1) - 1.0).max() < 0.01


def test_a_frame_is_the_squash_of_the_subject_without_a_floor(tmp_path):
    """A twist, a stretch and a velocity act as if there were no floor; each frame is squashed by itself."""
    flows = f"""
  - twist: {{amount: {{keys: {{1: 0, 17: 60}}}}}}
  - stretch: {{axis: x, amount: {{keys: {{1: 1, 17: 1.4}}}}}}{DOWN_AND_UP}"""
    free = [frame.mesh.vertices for frame in animate(shot_of(tmp_path, flows, "off"))]
    kept = shot_of(tmp_path, f"{flows}\n  - contact: {{floor: -1.2}}", "off")
    for frame, vertices in zip(animate(kept), free, strict=True):
        time = kept.motion.clock.time(frame.number)
        squash = kept.motion.flow.members[0].meetings_at(time)[0].map
        assert np.abs(squash.apply(vertices) - frame.mesh.vertices).max() < 1e-9
        assert vertices[:, 1].min() >= lowest_of(squash) - 0.02 or vertices[:, 1].min() >= -1.2


def test_it_runs_backwards_to_where_it_began(tmp_path):
    motion = shot_of(tmp_path, f"{DOWN_AND_UP}\n  - contact: {{floor: -1.1}}").motion
    points = motion.mesh_at_rest().vertices
    there = motion.flow.displace(points, 0.0, 0.25)
    assert np.abs(there - points).max() > 0.1
    assert np.abs(motion.flow.displace(there, 0.25, -0.25) - points).max() < 1e-9


def test_a_new_vertex_arrives_where_one_is_that_was_there_from_the_start(tmp_path):
    """It is squashed once, in the last frame: squashes that the next frame undoes are left out."""
    twist = "\n  - twist: {amount: {keys: {1: 0, 18: 40}}}"
    motion = shot_of(tmp_path, f"{twist}{DOWN_AND_UP}\n  - contact: {{floor: -1}}").motion
    rest = motion.mesh_at_rest().vertices
    points, carried = rest.copy(), FlowMap()
    for number in range(2, 12):
        step = motion.step_into(motion.flow, number)
        points = step.apply(points)
        carried.add(step)
        assert np.abs(carried.carry(rest) - points).max() < 1e-9


def test_carrying_new_vertices_squashes_them_in_the_first_and_the_last_frame_alone(tmp_path, monkeypatch):
    motion = shot_of(tmp_path, f"{DOWN_AND_UP}\n  - contact: {{floor: -1}}").motion
    carried, done = FlowMap(), []
    monkeypatch.setattr(StepPlan, "of_kernel_row", lambda *_: None)  # so that squashes are asked one by one
    monkeypatch.setattr(Squashing, "displace", lambda flow, points, *_: done.append(flow) or points)
    for number in range(2, 12):
        carried.add(motion.step_into(motion.flow, number))
    carried.carry(motion.mesh_at_rest().vertices)
    assert [flow.is_inverse for flow in done] == [True, False]


def test_keys_follow_what_came_before_and_not_what_comes_after(tmp_path):
    def data(flows: str) -> object:
        return shot_of(tmp_path, flows).motion.flow.cache_data(0.25, 1.0 / 24.0)

    before = DOWN_AND_UP + "\n  - contact: {floor: -1.1}"
    assert data(before) != data(before.replace("-1.1", "-1.2"))
    assert data(before) != data(before.replace("-3", "-2.9"))
    later = before.replace("18: [0, 3, 0]", "18: [0, 4, 0]")
    assert data(before) == data(later)


def test_a_subject_that_begins_below_the_floor_is_refused_with_the_remedy(tmp_path):
    shot = shot_of(tmp_path, f"{DOWN_AND_UP}\n  - contact: {{floor: -0.5}}")
    with pytest.raises(
        FlowsculptError, match=r"lowest point at -1, below the floor at -0\.5\. Write floor: -1"
    ):
        list(shot.motion.flow.findings())
    with pytest.raises(FlowsculptError, match="Write floor: -1"):
        list(animate(shot))


def test_a_flow_after_contact_that_leads_below_the_floor_is_refused(tmp_path):
    shot = shot_of(tmp_path, f"\n  - contact: {{floor: -1}}{DOWN_AND_UP}")
    with pytest.raises(FlowsculptError, match="Make contact the last entry of flows"):
        list(animate(shot))


def test_a_floor_that_is_true_is_the_height_of_the_lowest_point_at_the_start(tmp_path):
    heights = [
        [frame.mesh.vertices[:, 1].min() for frame in animate(shot_of(tmp_path, DOWN_AND_UP + floor))]
        for floor in ("\n  - contact: {floor: -1}", "\n  - contact: {floor: true}", "\n  - contact:")
    ]
    assert heights[0] == heights[1] == heights[2]
    with pytest.raises(ShotError, match="floor"):
        shot_of(tmp_path, "\n  - contact: {floor: false}")


def test_findings_say_how_far_the_subject_is_pressed_and_whether_it_floats(tmp_path):
    def said(floor: str) -> list[tuple[str, bool]]:
        return list(
            shot_of(tmp_path, f"{DOWN_AND_UP}\n  - contact: {{floor: {floor}}}").motion.flow.findings()
        )

    ((text, is_warning),) = said("true")
    assert not is_warning and "rises up to 42 thousandths" in text and "pressed by up to 500" in text
    (_, is_warning), (text, floats) = said("-2.2")
    assert not is_warning and floats and "floats: it is 100 thousandths" in text
    assert "Write floor: -2, or floor: true." in text


def test_validate_asks_for_a_floor_that_stands_still(tmp_path):
    """Where the stage's floor follows the lowest point, nothing is seen to fall."""
    from flowsculpt.pipeline.plugins.authoring.first_frame import FirstFrames
    from flowsculpt.pipeline.plugins.authoring.scene_rules import findings

    flows = f"{DOWN_AND_UP}\n  - contact: {{floor: -1.5}}"
    shot = shot_of(tmp_path, flows)
    first = FirstFrames().of(shot.motion)
    (found,) = (each for each in findings(shot, first) if each.where == ("camera", "follow"))
    assert "moves by" in found.text and found.text.endswith("Write follow: 0.")
    still = read_shot(
        "a.yaml", PUTTY.replace("FLOWS", flows).replace("RESAMPLE", "off") + "camera: {follow: 0}\n"
    )
    assert not [each for each in findings(still, first) if each.where == ("camera", "follow")]


def test_within_a_composition_it_is_refused(tmp_path):
    with pytest.raises(ShotError, match="acts on a whole subject"):
        shot_of(tmp_path, "\n  - placed: {translate: [1, 0, 0], flows: [{contact: {floor: -1}}]}")
