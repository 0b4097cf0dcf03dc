"""Moves: where points arrive, that each step is undone exactly, and that far parts are late."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.api import ShotError
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.shot import Shot, read_shot

SWING = "{keys: {1: [0, 0, 0], 13: [1, 0.5, 0], 25: [0, 0, 0]}}, turn: {keys: {1: 0, 25: 70}}, axis: z"

ALONG = ["", ", along: [0, 1, 0]", ", along: [1, 0, 0.5], leads: [0.2, 0, 0]"]


def shot_of(
    flows: str, resample: str = "{max_edge_length: 0.2}", subject: str = "{solid: icosphere}"
) -> Shot:
    text = f"title: A\nframes: 1-25\nsubject: {subject}\nresample: {resample}\nflows:\n{flows}\n"
    return read_shot("a.yaml", text)


def test_a_subject_arrives_where_its_keys_say_by_the_ease():
    shot = shot_of("  - move: {by: {keys: {1: [0, 3, 0], 25: [0, 0, 0]}, ease: drop 0}}", "off")
    heights = [frame.mesh.vertices[:, 1].mean() for frame in animate(shot)]
    assert heights[0] == pytest.approx(0.0, abs=1e-12)  # the way counts from the first frame on
    assert heights[12] == pytest.approx(-0.75) and heights[24] == pytest.approx(-3.0)


def test_a_turn_is_about_an_axis_that_goes_along():
    way = "by: {keys: {1: [0, 0, 0], 25: [4, 0, 0]}}, turn: {keys: {1: 0, 25: 90}}"
    flows = f"  - move: {{{way}, axis: z, centre: [0, -1, 0]}}"
    *_, frame = animate(shot_of(flows, "off"))
    first = next(iter(animate(shot_of(flows, "off")))).mesh.vertices
    expected = np.stack([4.0 - (first[:, 1] + 1.0), first[:, 0] - 1.0, first[:, 2]], axis=1)
    assert np.abs(frame.mesh.vertices - expected).max() < 1e-12


@settings(max_examples=30, deadline=None)
@given(st.floats(0.0, 0.2), st.sampled_from(ALONG), st.integers(0, 24), st.integers(0, 1000))
def test_a_step_there_and_back_returns_points_to_a_billionth(lag: float, along: str, frame: int, seed: int):
    flow = shot_of(f"  - move: {{by: {SWING}, lag: {lag}{along}}}").motion.flow
    points = np.random.default_rng(seed).uniform(-1.2, 1.2, (300, 3))
    time = frame / 24.0
    moved = flow.displace(points, 0.0, time)
    assert np.abs(flow.displace(moved, time, -time) - points).max() < 1e-9
    halves = flow.displace(flow.displace(points, 0.0, 0.5 * time), 0.5 * time, 0.5 * time)
    assert np.abs(halves - moved).max() < 1e-9


def test_far_parts_are_where_near_ones_were_by_the_lag():
    rod = "{solid: rod, length: 2, radius: 0.1}"
    flow = shot_of(
        f"  - move: {{by: {SWING}, lag: 0.25, leads: [0, -1, 0], reach: 2}}", subject=rod
    ).motion.flow
    prompt = shot_of(f"  - move: {{by: {SWING}}}", subject=rod).motion.flow
    for share in (0.25, 0.5, 1.0):
        point = np.array([[0.0, -1.0 + 2.0 * share, 0.0]])
        round_off = 0.05 * 2
        late = 0.25 / 2 * (np.hypot(2 * share, round_off) - round_off)
        late_one, before = flow.displace(point, 0.0, 0.5), prompt.displace(point, 0.0, 0.5 - late)
        assert np.abs(late_one - before).max() < 1e-6


def test_along_a_direction_parts_are_late_by_how_far_ahead_they_are_and_those_behind_are_not():
    block = "{solid: box, size: [2, 2, 2]}"
    keys = "by: {keys: {1: [0, 0, 0], 13: [0, 0, 1], 25: [0, 0, 3]}}"
    prompt = shot_of(f"  - move: {{{keys}}}", subject=block).motion.flow
    flow = shot_of(f"  - move: {{{keys}, lag: 0.25, along: [0, 2, 0]}}", subject=block).motion.flow
    for height, late in ((1.0, 0.25), (0.5, 0.125), (-1.0, 0.0)):
        points = np.array([[-1.0, height, 0.0], [1.0, height, 0.7]])
        expected = prompt.displace(points, 0.0, 0.5 - late)
        assert np.abs(flow.displace(points, 0.0, 0.5) - expected).max() < 0.002


def test_shifts_across_the_direction_need_no_longer_keys():
    keys = "by: {keys: {1: [0, 0, 0], 5: [6, 0, 0]}}, lag: 1.5"
    assert (
        shot_of(f"  - move: {{{keys}, along: [0, 1, 0]}}")
        .motion.flow.displace(np.ones((1, 3)), 0.0, 0.2)
        .size
    )
    with pytest.raises(FlowsculptError, match="parts pass through each other"):
        shot_of(f"  - move: {{{keys}, along: [1, 0, 0]}}").motion.flow.displace(np.ones((1, 3)), 0.0, 0.2)


def test_along_no_direction_is_refused():
    with pytest.raises(ShotError, match=r"along has no direction\. Write along: \[0, 1, 0\]"):
        shot_of("  - move: {by: [0, 0, 0], along: [0, 0, 0]}")


def test_other_flows_act_on_the_subject_in_its_own_place():
    twist = "  - twist: {amount: {keys: {1: 0, 25: 60}}}"
    alone = [frame.mesh.vertices for frame in animate(shot_of(twist, "off"))]
    moved = animate(shot_of(f"{twist}\n  - move: {{by: {{keys: {{1: [0, 0, 0], 25: [9, 0, 0]}}}}}}", "off"))
    assert np.abs(list(moved)[-1].mesh.vertices - [9.0, 0.0, 0.0] - alone[-1]).max() < 1e-11


def test_a_moved_subject_keeps_to_the_floor_of_contact():
    down = "{keys: {1: [0, 0, 0], 12: [0, -1, 0]}, ease: drop}"
    flows = f"  - move: {{by: {down}, lag: 0.1}}\n  - contact: {{softness: 1}}"
    lowest = [frame.mesh.vertices[:, 1].min() for frame in animate(shot_of(flows))]
    assert min(lowest) >= -1.0 - 0.002


def test_keys_follow_what_came_before_and_not_what_comes_after():
    def data(flows: str) -> object:
        return shot_of(flows).motion.flow.cache_data(0.25, 1.0 / 24.0)

    before = f"  - move: {{by: {SWING}, lag: 0.1}}"
    assert data(before) != data(before.replace("[1, 0.5, 0]", "[1, 0.6, 0]"))
    assert data(before) != data(before.replace("0.1}", "0.2}"))
    assert data(before) == data(before.replace("25: [0, 0, 0]", "25: [0, 7, 0]"))


def test_a_lag_in_which_parts_would_meet_is_refused_with_one_that_works():
    flows = "  - move: {by: {keys: {1: [0, 0, 0], 5: [6, 0, 0]}}, lag: 2}"
    with pytest.raises(FlowsculptError, match=r"parts pass through each other.*Write lag: 0\.\d+ or less"):
        list(animate(shot_of(flows)))
    with pytest.raises(ShotError, match="acts on a whole subject"):
        shot_of("  - placed: {translate: [1, 0, 0], flows: [{move: {by: [1, 0, 0]}}]}")
