"""Contact with other subjects: they stay apart, volume is kept, and keys know where the others are."""

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
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, torus
from flowsculpt.pipeline.plugins.contact.height_kernels import FLAT, HIGHEST
from flowsculpt.pipeline.plugins.contact.heights import Heights
from flowsculpt.pipeline.plugins.contact.squash import Press, Squash
from flowsculpt.pipeline.shot import Shot, read_shot
from flowsculpt.pipeline.statistics import self_intersections

HEIGHT = 1.4
MARGIN = 0.0005 * HEIGHT

TOGETHER = """
title: Together
frames: 1-13
subjects:
  block: {solid: box, size: [1.6, 0.8, 1.6], place: [0, -0.4, 0]BLOCK}
  ball:
    solid: icosphere
    radius: 0.7
    place: [0.2, 0.7, 0.1]
    flows:
      - translation: {rate: {ease: linear, keys: {1: [0, -1.4, 0], 13: [0, -1.4, 0]}}}
      - contact: CONTACT
resample: {max_edge_length: 0.15}
"""

SHAPES = {
    "block": box([1.6, 0.8, 1.6], 0.2, [0.0, -0.4, 0.0]),
    "ball": icosphere(12, 0.5, [0.1, -0.5, 0.0]),
    "ring": torus(0.8, 0.2, 0.1),
}

sides = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda side: np.linalg.norm(side) > 0.1)


def axes_of(side: tuple[float, ...]) -> Floats:
    up = np.array(side) / np.linalg.norm(side)
    a = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    a /= np.linalg.norm(a)
    return np.array([a, up, np.cross(a, up)])


def press_of(
    shape: str, side: tuple[float, ...], softness: float, depth: float, spreads: bool, lowest: float = -0.3
) -> Press:
    axes, mesh = axes_of(side), SHAPES[shape]
    heights = Heights.of(mesh.vertices @ axes.T, mesh.faces, 1.0 / softness)
    squash = Squash.of(0.0, softness, MARGIN, -depth, (0.1, -0.1), spreads)
    return Press(axes, heights, squash, lowest, softness)


presses = st.builds(
    press_of,
    shape=st.sampled_from(sorted(SHAPES)),
    side=sides,
    softness=st.floats(0.2, 1.5),
    depth=st.floats(0.0, 0.9),
    spreads=st.booleans(),
    lowest=st.floats(-2.0, 0.5),
)


def points_above(press: Press, seed: int, count: int = 200) -> Floats:
    """Return points of which none lies deeper in the other subject than the squash is for."""
    seen = np.random.default_rng(seed).uniform(-1.5, 1.5, (count, 3))
    lowest = press.squash.top - press.squash.span
    seen[:, 1] = relief(press, seen) + lowest + 1.2 * (seen[:, 1] + 1.5)
    points: Floats = seen @ press.axes
    return points


def relief(press: Press, seen: Floats) -> Floats:
    """Return the heights of the other subject, which become a plain below the lowest point."""
    heights, level = press.heights.at(seen), press.lowest - press.softness
    plain = level - (level - heights) / np.hypot(1.0, (level - heights) / press.softness)
    return np.where(heights < level, plain, heights)


def gaps(press: Press, points: Floats) -> Floats:
    seen = points @ press.axes.T
    return seen[:, 1] - relief(press, seen)


@settings(max_examples=40, deadline=None)
@given(presses, st.integers(0, 1000))
def test_no_point_stays_within_the_other_subject_and_the_inverse_is_exact_to_a_billionth(press, seed):
    points = points_above(press, seed)
    pressed = press.apply(points)
    assert gaps(press, pressed).min() >= -1e-9
    assert np.abs(press.undo(pressed) - points).max() < 1e-9


@settings(max_examples=40, deadline=None)
@given(presses, st.integers(0, 1000))
def test_the_determinant_of_the_jacobian_is_positive_and_one_where_volume_is_kept(press, seed):
    points = points_above(press, seed, 40)
    # next to the deepest point, lengths shrink to less than a step
    points = points[gaps(press, points) > press.squash.top - press.squash.span + 0.1]
    step = 1e-5
    moved = [press.apply(points + sign * step * axis) for axis in np.eye(3) for sign in (1.0, -1.0)]
    columns = [(moved[2 * k] - moved[2 * k + 1]) / (2.0 * step) for k in range(3)]
    determinants = np.linalg.det(np.stack(columns, axis=2))
    assert (determinants > 0.0).all()
    if press.squash.spreads:
        assert np.abs(determinants - 1.0).max() < 1e-3


@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_the_heights_are_above_the_surface_and_meet_its_highest_place(shape):
    mesh, softness = SHAPES[shape], 0.7
    heights = Heights.of(mesh.vertices, mesh.faces, 1.0 / softness)
    size = float(np.ptp(mesh.vertices, axis=0).max())
    above = heights.at(mesh.vertices) - mesh.vertices[:, 1]
    assert above.min() > -0.001 * size
    assert abs(above[np.argmax(mesh.vertices[:, 1])]) < 0.001 * size


@settings(max_examples=20, deadline=None)
@given(presses, st.integers(0, 1000))
def test_a_point_arrives_at_the_same_bits_whichever_points_go_with_it(press, seed):
    """Flat and other places are computed in different ways, and many points at a time."""
    points = points_above(press, seed)
    together = press.apply(points)
    assert np.array_equal(np.concatenate([press.apply(points[k : k + 1]) for k in range(40)]), together[:40])
    assert np.array_equal(press.apply(points[::-1].copy())[::-1], together)


def test_a_point_that_an_earlier_flow_lost_stays_lost_and_others_do_not_notice():
    press = press_of("ball", (0.0, 1.0, 0.0), 0.7, 0.4, True)
    points = points_above(press, 1)
    broken = points.copy()
    broken[::3, 0] = np.nan
    pressed = press.apply(broken)
    assert np.isnan(pressed[::3, 0]).all()
    assert np.array_equal(pressed[1::3], press.apply(points)[1::3])


@pytest.mark.parametrize("turn", [0.0, 30.0])
def test_a_flat_top_is_flat_up_to_near_its_edges_and_as_high_as_it_is(turn):
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    turned = SHAPES["block"].vertices @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    heights = Heights.of(turned, SHAPES["block"].faces, 1.0)
    left, low, right, high = heights.numbers[FLAT : FLAT + 4]
    assert heights.numbers[HIGHEST] == pytest.approx(0.0, abs=1e-12)
    assert min(right - left, high - low) > (1.5 if turn == 0.0 else 0.8)
    corners = np.array([[x, 0.0, z] for x in (left, right) for z in (low, high)])
    outside = corners * 1.0001
    assert np.array_equal(heights.at(corners), np.full(4, heights.numbers[HIGHEST]))
    assert np.abs(heights.at(outside)).max() < 1e-9


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(sorted(SHAPES)), st.tuples(*[st.floats(-2.0, 2.0)] * 3))
def test_moved_heights_are_those_of_the_moved_subject(shape, by):
    mesh = SHAPES[shape]
    heights = Heights.of(mesh.vertices, mesh.faces, 1.0)
    seen = np.random.default_rng(1).uniform(-1.5, 1.5, (100, 3))
    moved = heights.moved(np.array(by)).at(seen + by)
    assert np.abs(moved - by[1] - heights.at(seen)).max() < 1e-9


TURN = "{rotation: {axis: y, speed: 60}}, {translation: {rate: [0.1, -0.2, 0.3]}}"

TILT = "{rotation: {axis: z, speed: 60}}"

BEND = "{bend: {amount: {keys: {1: 0, 13: 40}}}}"


@pytest.mark.parametrize("flows, turns", [(TURN, True), (TILT, False), (BEND, False)])
def test_a_relief_fits_the_subject_and_turns_with_one_that_turns_about_the_side_it_is_met_from(
    tmp_path, flows, turns
):
    ball = shot_of(tmp_path, block=f", flows: [{flows}]").of_subject("ball")
    (obstacle,) = ball.motion.flow.members[0].obstacles
    for time in (0.1, 0.4):
        axes, heights = obstacle.relief(time, 1.0 / 0.7)
        seen = obstacle.surface.points(time) @ axes.T
        again = Heights.of(seen, obstacle.surface.mesh.faces, 1.0 / 0.7)
        assert np.abs(heights.at(seen) - again.at(seen)).max() < 1e-5
        assert (np.abs(axes - obstacle.axes).max() > 0.05) == turns


def test_a_relief_shows_what_moves_between_the_columns_of_a_fine_grid(tmp_path):
    rows = np.linspace(-0.8, 0.8, 128)
    lines = [f"v {x:.6f} 0 {z:.6f}" for z in rows for x in rows]
    lines += [f"f {k} {k + 128} {k + 129} {k + 1}" for k in range(1, 127 * 128) if k % 128]
    (tmp_path / "grid.obj").write_text("\n".join(lines), encoding="utf-8")
    region = "{sphere: {radius: 0.18, centre: [0.6, 0, 0.6]}}"
    bump = f"{{within: {{region: {region}, flows: [{{translation: {{rate: [0, 1, 0]}}}}]}}}}"
    block = "solid: box, size: [1.6, 0.8, 1.6], place: [0, -0.4, 0]BLOCK"
    text = TOGETHER.replace(block, f"model: grid.obj, flows: [{bump}]")
    (tmp_path / "A010_grid.yaml").write_text(text.replace("CONTACT", "{others: [block]}"), encoding="utf-8")
    (obstacle,) = read_shot(tmp_path / "A010_grid.yaml").of_subject("ball").motion.flow.members[0].obstacles
    _, heights = obstacle.relief(0.2, 1.0)
    assert heights.at(np.array([[0.6, 0.0, 0.6]]) @ obstacle.axes.T)[0] > 0.1


def test_far_from_the_other_subject_nothing_moves():
    press = press_of("block", (0.0, 1.0, 0.0), 0.5, 0.4, True)
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 3)) * 0.5
    for away in ([0.0, 3.0, 0.0], [9.0, 0.0, 0.0], [0.0, 0.0, -9.0]):
        assert np.array_equal(press.apply(points + away), points + away)


def shot_of(folder: Path, contact: str = "{others: [block], softness: 0.7}", block: str = "") -> Shot:
    path = folder / "A010_together.yaml"
    path.write_text(TOGETHER.replace("CONTACT", contact).replace("BLOCK", block), encoding="utf-8")
    return read_shot(path)


def volume(mesh: TriangleMesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", np.cross(a, b), c).sum() / 6.0)


def test_a_ball_pressed_to_half_its_height_on_a_block_keeps_its_volume_and_stays_out(tmp_path):
    meshes = [frame.mesh for frame in animate(shot_of(tmp_path).of_subject("ball"))]
    assert meshes[0].vertices[:, 1].min() == pytest.approx(0.0, abs=1e-9)
    pressed = meshes[-1].vertices
    within = (np.abs(pressed[:, 0]) < 0.79) & (np.abs(pressed[:, 2]) < 0.79)
    assert -0.001 * HEIGHT < pressed[within, 1].min() < 0.002 * HEIGHT
    assert pressed[:, 1].max() == pytest.approx(0.7, abs=0.01)
    assert abs(volume(meshes[-1]) / volume(meshes[0]) - 1.0) < 0.01
    assert self_intersections(meshes[-1]) == 0


def test_a_block_that_comes_from_the_side_presses_to_the_side(tmp_path):
    """The widest gap at the start, or `side`, says which way the ball gives way."""
    block = ", flows: [{translation: {rate: {ease: linear, keys: {1: [2, 0, 0], 13: [2, 0, 0]}}}}]"
    text = TOGETHER.replace("BLOCK", block).replace("CONTACT", "{others: [block], softness: 0.7}")
    text = text.replace("[0, -0.4, 0]", "[-1.4, 0.7, 0]").replace("[0, -1.4, 0]", "[0, 0, 0]")
    (tmp_path / "A010_side.yaml").write_text(text, encoding="utf-8")
    shot = read_shot(tmp_path / "A010_side.yaml").of_subject("ball")
    *_, last = (frame.mesh.vertices for frame in animate(shot))
    face = -1.4 + 0.8 + 2.0 * 0.5
    across = (np.abs(last[:, 1] - 0.7) < 0.39) & (np.abs(last[:, 2]) < 0.79)
    assert -0.001 * HEIGHT < last[across, 0].min() - face < 0.01
    assert last[:, 0].max() == pytest.approx(0.9, abs=0.01)


def test_the_key_of_a_frame_knows_where_the_other_subject_is_and_what_it_looks_like(tmp_path):
    moving = ", flows: [{translation: {rate: {ease: linear, keys: {1: [0, 0, 0], 7: [0, RATE, 0]}}}}]"

    def data(block: str) -> object:
        ball = shot_of(tmp_path, block=block).of_subject("ball").motion
        return [ball.acting_data(frame) for frame in range(2, 14)]

    rates = (moving.replace("RATE", rate) for rate in ("0.1", "0.2"))
    still, slow, fast = (data(block) for block in ("", *rates))
    assert still != slow != fast
    assert data("") == still == data(", look: chrome") == data(", resample: {max_edge_length: 0.3}")
    other = TOGETHER.replace("[1.6, 0.8, 1.6]", "[1.7, 0.8, 1.6]")
    (tmp_path / "B010_other.yaml").write_text(
        other.replace("CONTACT", "{others: [block], softness: 0.7}").replace("BLOCK", ""), encoding="utf-8"
    )
    assert read_shot(tmp_path / "B010_other.yaml").of_subject("ball").motion.acting_data(2) != still[0]


def test_validate_says_how_far_it_rises_and_is_pressed_and_warns_where_it_never_touches(tmp_path):
    def said(text: str) -> list[tuple[str, bool]]:
        text = text.replace("CONTACT", "{others: [block]}").replace("BLOCK", "")
        (tmp_path / "A010_said.yaml").write_text(text, encoding="utf-8")
        return list(read_shot(tmp_path / "A010_said.yaml").of_subject("ball").motion.flow.findings())

    ((text, is_warning),) = said(TOGETHER)
    assert not is_warning and "above block, and is pressed by up to 500" in text
    _, (text, is_warning) = said(TOGETHER.replace("[0.2, 0.7, 0.1]", "[0.2, 2.4, 0.1]"))
    assert is_warning and "floats: it is 714 thousandths of its height or more above block" in text
    assert "take block out of others" in text


def test_others_that_give_way_in_a_circle_are_refused(tmp_path):
    with pytest.raises(FlowsculptError, match="ball to block to ball: they give way in a circle"):
        shot_of(tmp_path, block=", flows: [{contact: {others: [ball]}}]")


def test_a_subject_that_is_not_there_is_refused_with_those_that_are(tmp_path):
    fact = r"contact: the shot has no other subject plinth\. Write block\."
    with pytest.raises(ShotError, match=rf"A010_together\.yaml:12:9: {fact}"):
        shot_of(tmp_path, "{others: [plinth]}")


def test_an_entry_among_the_flows_of_the_shot_is_refused_with_its_place(tmp_path):
    text = TOGETHER.replace("BLOCK", "").replace("CONTACT", "{floor: 0}")
    path = tmp_path / "A010_shared.yaml"
    path.write_text(f"{text}flows:\n  - contact: {{others: [plinth]}}\n", encoding="utf-8")
    with pytest.raises(ShotError, match=r"A010_shared\.yaml:15:5: contact: the shot has no other subject"):
        read_shot(path)


def test_a_subject_that_begins_within_another_is_refused(tmp_path):
    shot = shot_of(tmp_path, "{others: [block], side: [0, -1, 0]}").of_subject("ball")
    with pytest.raises(FlowsculptError, match=r"begins .* units within block"):
        list(animate(shot))


def test_contact_without_a_floor_and_others_is_refused(tmp_path):
    with pytest.raises(ShotError, match="contact needs a floor or others"):
        shot_of(tmp_path, "{floor: false}")


def test_in_the_flows_of_the_shot_all_subjects_but_the_named_one_give_way(tmp_path):
    text = TOGETHER.replace("      - contact: CONTACT\n", "").replace("BLOCK", "")
    text += "flows:\n  - contact: {others: [block], softness: 0.7}\n"
    text = text.replace("resample: {max_edge_length: 0.15}", "resample: off")
    # the subject's own flows act after those of the shot, so the ball falls by the shot's too
    fall = "translation: {rate: {ease: linear, keys: {1: [0, -1.4, 0], 13: [0, -1.4, 0]}}}"
    text = text.replace(f"    flows:\n      - {fall}\n", "").replace("flows:\n", f"flows:\n  - {fall}\n")
    (tmp_path / "A010_shared.yaml").write_text(text, encoding="utf-8")
    shot = read_shot(tmp_path / "A010_shared.yaml")
    block, ball = (
        [frame.mesh.vertices for frame in animate(shot.of_subject(name))] for name in ("block", "ball")
    )
    assert np.allclose(block[-1], block[0] - [0.0, 0.7, 0.0], atol=1e-9)
    assert np.allclose(ball[-1], ball[0] - [0.0, 0.7, 0.0], atol=1e-9)  # it never comes nearer


@pytest.mark.parametrize("keeps", [True, False])
def test_two_others_press_from_two_sides_and_validate_says_what_sinks_in(tmp_path, keeps):
    """What spreads before the second one may sink into the first."""
    wall = "  wall: {solid: box, size: [0.4, 4, 4], place: [1, 0, 0]}\n"
    contact = f"{{others: [block, wall], keep_volume: {str(keeps).lower()}}}"
    text = TOGETHER.replace("BLOCK", "").replace("CONTACT", contact).replace("  ball:", f"{wall}  ball:")
    text = text.replace("[0.2, 0.7, 0.1]", "[0, 0.7, 0]").replace("1: [0, -1.4, 0]", "1: [0.4, -1.4, 0]")
    (tmp_path / "A010_sides.yaml").write_text(text, encoding="utf-8")
    ball = read_shot(tmp_path / "A010_sides.yaml").of_subject("ball")
    *_, last = (frame.mesh.vertices for frame in animate(ball))
    assert last[:, 0].max() < 0.8 + 0.001 * HEIGHT
    within = (np.abs(last[:, 0]) < 0.79) & (np.abs(last[:, 2]) < 0.79)
    sinks = [said for said, is_warning in ball.motion.flow.findings() if is_warning]
    if keeps:
        assert last[within, 1].min() < -0.005 * HEIGHT
        assert len(sinks) == 1 and "thousandths of its height into block" in sinks[0]
    else:
        assert sinks == [] and -0.001 * HEIGHT < last[within, 1].min() < 0.01


def test_validate_warns_where_a_later_entry_pushes_the_subject_into_what_an_earlier_one_met(tmp_path):
    wall = "  wall: {solid: box, size: [0.4, 4, 4], place: [1, 0, 0]}\n"
    entries = "{others: [block]}\n      - contact: {others: [wall]}"
    text = TOGETHER.replace("BLOCK", "").replace("CONTACT", entries).replace("  ball:", f"{wall}  ball:")
    text = text.replace("[0.2, 0.7, 0.1]", "[0, 0.7, 0]").replace("1: [0, -1.4, 0]", "1: [0.4, -1.4, 0]")
    (tmp_path / "A010_entries.yaml").write_text(text, encoding="utf-8")
    ball = read_shot(tmp_path / "A010_entries.yaml").of_subject("ball")
    (sinks,) = [said for said, is_warning in ball.motion.flow.findings() if is_warning]
    assert "thousandths of its height into block" in sinks


def test_validate_warns_once_of_what_sinks_in_where_another_entry_follows(tmp_path):
    wall = "  wall: {solid: box, size: [0.4, 4, 4], place: [1, 0, 0]}\n"
    entries = "{others: [block, wall]}\n      - contact: {floor: -3}"
    text = TOGETHER.replace("BLOCK", "").replace("CONTACT", entries).replace("  ball:", f"{wall}  ball:")
    text = text.replace("[0.2, 0.7, 0.1]", "[0, 0.7, 0]").replace("1: [0, -1.4, 0]", "1: [0.4, -1.4, 0]")
    (tmp_path / "A010_once.yaml").write_text(text, encoding="utf-8")
    ball = read_shot(tmp_path / "A010_once.yaml").of_subject("ball")
    sinks = [said for said, _ in ball.motion.flow.findings() if "into block" in said]
    assert len(sinks) == 1


COPIES = """
title: Copies
frames: 1-13
subjects:
  drops:
    solid: icosphere
    radius: 0.4
    copies: {count: 6, RIGIDlayout: {grid: {cells: [3, 2, 1], spacing: [1.2, 1.2, 0]}}}
    flows:
      - translation: {rate: {ease: linear, keys: {1: [0, -1, 0], 13: [0, -1, 0]}}}
      - contact: {floor: -1.2, softness: 0.6}
resample: {max_edge_length: 0.12}
"""


def test_copies_are_pressed_by_the_lowest_of_all_and_none_is_flattened(tmp_path):
    (tmp_path / "A010_copies.yaml").write_text(COPIES.replace("RIGID", ""), encoding="utf-8")
    drops = read_shot(tmp_path / "A010_copies.yaml").of_subject("drops")
    first, *_, last = (frame.mesh for frame in animate(drops))
    assert -0.001 * 2.0 < last.vertices[:, 1].min() + 1.2 < 0.002
    lower = last.vertices[last.vertices[:, 1] < -0.4]
    assert 0.35 < float(np.ptp(lower[:, 1])) < 0.7
    assert volume(last) == pytest.approx(volume(first), rel=0.01)
    (said, _), (warned, is_warning) = drops.motion.flow.findings()
    assert "is pressed by up to 150" in said
    assert is_warning and "Write keep_volume: false" in warned


def test_rigid_copies_in_contact_are_refused(tmp_path):
    (tmp_path / "A010_copies.yaml").write_text(COPIES.replace("RIGID", "rigid: true, "), encoding="utf-8")
    drops = read_shot(tmp_path / "A010_copies.yaml").of_subject("drops")
    with pytest.raises(FlowsculptError, match="drops has rigid copies"):
        list(drops.motion.flow.findings())
