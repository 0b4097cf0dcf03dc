"""Lags: that far parts are where near ones were, that steps are undone exactly, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.api import ShotError
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.shot import Shot, read_shot

SWING = "{keys: {1: 0, 10: {value: 30, ease: settle 0.3}, 25: 5}}"

FLOWS = {
    "bend": f"bend: {{centre: [0, -1, 0], length: 4, amount: {SWING}}}",
    "twist": f"twist: {{amount: {SWING}}}",
    "taper": "taper: {amount: {keys: {1: 0, 25: 0.4}}}",
    "shear": "shear: {amount: {keys: {1: 0, 25: 0.5}}}",
    "stretch": "stretch: {amount: {keys: {1: 1, 25: 1.3}}}",
    "rotation": f"rotation: {{axis: z, speed: {SWING}}}",
    "sum": "sum: [{translation: {rate: [0.3, 0, 0]}}, {strain: {rate: 0.1}}, {scaling: {rate: [0, 0.1, 0]}}]",
    "move": f"move: {{by: {{keys: {{1: [0, 0, 0], 25: [1, 0, 0]}}}}, turn: {SWING}, axis: z}}",
}
EACH = [f"  - {flow}" for flow in FLOWS.values()]

LAGS = ["0.2", "{seconds: 0.15, leads: [0, -1, 0]}", "{seconds: 0.2, along: [0, 1, 0]}", "0.08 * (y + 1)"]


def shot_of(*flows: str, frames: str = "1-25") -> Shot:
    start = f"title: A\nframes: {frames}\nsubject: {{solid: rod, length: 2, radius: 0.2}}\n"
    return read_shot("a.yaml", "\n".join([f"{start}resample: {{max_edge_length: 0.2}}\nflows:", *flows, ""]))


def rod_points(seed: int, count: int = 200) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (count, 3)) * [0.2, 1.0, 0.2]


@settings(max_examples=40, deadline=None)
@given(st.sets(st.sampled_from(EACH), min_size=1, max_size=3), st.sampled_from(LAGS), st.integers(0, 24))
def test_a_step_there_and_back_returns_points_to_a_billionth(flows: set[str], lag: str, frame: int):
    flow = shot_of(*sorted(flows), f"  - lag: {lag}").motion.flow
    points, time = rod_points(frame), frame / 24.0
    moved = flow.displace(points, 0.0, time)
    assert np.abs(flow.displace(moved, time, -time) - points).max() < 1e-9
    halves = flow.displace(flow.displace(points, 0.0, 0.4 * time), 0.4 * time, 0.6 * time)
    assert np.abs(halves - moved).max() < 1e-9


@pytest.mark.parametrize("flow", EACH)
def test_a_lag_of_nothing_is_no_lag(flow: str):
    alone, late = (shot_of(*flows).motion.flow for flows in ([flow], [flow, "  - lag: 0"]))
    points = moved = rod_points(1)
    for frame in range(12):
        moved = alone.displace(moved, frame / 24.0, 1.0 / 24.0)
    assert np.abs(late.displace(points, 0.0, 0.5) - moved).max() < 1e-6


@pytest.mark.parametrize("flow", EACH)
@pytest.mark.parametrize("lag", ["0.15 * (y + 1)", "{seconds: 0.3, along: [0, 1, 0], leads: [0, -1, 0]}"])
def test_far_parts_are_where_they_would_have_been_by_the_delay(flow: str, lag: str):
    late, prompt = (shot_of(flow, f"  - lag: {seconds}").motion.flow for seconds in (lag, "0"))
    for height in (-0.4, 0.3, 1.0):
        point = np.array([[0.1, height, 0.05]])
        before = prompt.displace(point, 0.0, 0.8 - 0.15 * (height + 1.0))
        assert np.abs(late.displace(point, 0.0, 0.8) - before).max() < 2e-3


def test_flows_before_lag_act_one_after_another_by_all_of_their_keys():
    bend, move = (f"  - {FLOWS[name]}" for name in ("bend", "move"))
    together = shot_of(bend, move, "  - lag: 0").motion.flow
    points = rod_points(2)
    bent = shot_of(bend).motion.flow.displace(points, 0.0, 0.7)
    assert (
        np.abs(together.displace(points, 0.0, 0.7) - shot_of(move).motion.flow.displace(bent, 0.0, 0.7)).max()
        < 1e-9
    )


def test_flows_up_to_one_of_a_whole_subject_act_in_its_own_place():
    late, alone = (
        shot_of(*EACH[:1], "  - lag: 0.1", *EACH[1:2], "  - lag: 0.1"),
        shot_of(*EACH[:1], "  - lag: 0.1"),
    )
    (outer,), (inner,) = late.motion.flow.flows, alone.motion.flow.flows
    assert outer.flows == (inner,)


def test_ears_that_pass_others_in_space_keep_to_their_own_place():
    """Far from the subject, a turn and a delay by height have other places that arrive at the same point."""
    turn = "  - move: {turn: {keys: {1: 0, 12: -70, 25: 20}}, axis: z, centre: [0, -2, 0]}"
    shot = shot_of(turn, "  - lag: 0.3 * (y + 0.9)")
    *_, last = animate(shot)
    flow, points = shot.motion.flow, last.mesh.vertices
    back = flow.displace(points, 1.0, -1.0)
    assert (
        np.abs(np.hypot(back[:, 0], back[:, 2])).max() < 0.2 + 1e-3 and np.abs(back[:, 1]).max() < 1.0 + 1e-3
    )


def test_frames_do_not_depend_on_how_many_there_are():
    flows = (EACH[0], "  - lag: 0.2")
    short, long = (list(animate(shot_of(*flows, frames=frames)))[5] for frames in ("1-6", "1-25"))
    assert short.mesh.vertices.tobytes() == long.mesh.vertices.tobytes()


def test_keys_follow_the_delay_and_what_came_before_and_not_what_comes_after():
    def data(bend: str, lag: str = "0.2") -> object:
        return shot_of(f"  - {bend}", f"  - lag: {lag}").motion.flow.cache_data(0.5, 1.0 / 24.0)

    bend = "bend: {amount: {ease: linear, keys: {1: 0, 10: 30, 20: 0, 25: 9}}}"
    assert data(bend) == data(bend.replace("25: 9", "25: 8"))
    assert data(bend) != data(bend.replace("10: 30", "10: 31"))
    assert data(bend) != data(bend, "0.21") and data(bend) != data(bend, "0.2*y")
    assert data(bend) != data(bend.replace("bend: {", "bend: {direction: z, "))


@pytest.mark.parametrize(
    ("flows", "said"),
    [
        (
            ["  - curl_noise:", "  - lag: 0.2"],
            r"a\.yaml:7:5: curl_noise, before lag, cannot be late.*after lag",
        ),
        (["  - lag: 0.2"], r"a\.yaml:6:5: no flow before lag can be late\. Write one of these"),
        (["  - move: {lag: 0.1}", "  - lag: 0.2"], r"a\.yaml:7:5: .*; move has a lag of its own"),
        ([*EACH[:1], "  - lag: 0.2*q"], r"a\.yaml:7:\d+: .*q is not known here"),
        (
            [*EACH[:1], "  - lag: {seconds: 0.1*y, leads: [0, 1, 0]}"],
            r"a\.yaml:7:5: .*so leads has no effect",
        ),
        ([*EACH[:1], "  - lag: {second: 0.2}"], r"a\.yaml:7:11: .*Did you mean 'seconds'"),
        (["  - sequence: {flows: [{lag: 0.2}]}"], r"a\.yaml:6:\d+: .*lag acts on a whole subject"),
    ],
)
def test_what_cannot_be_late_is_refused_at_its_place(flows: list[str], said: str):
    with pytest.raises(ShotError, match=said):
        shot_of(*flows)


@pytest.mark.parametrize(
    ("lag", "said"),
    [
        (
            "{seconds: 3, along: [0, 1, 0]}",
            r"parts pass through each other near .* Write lag: [\d.]+ or less",
        ),
        ("3*y", r"parts pass through each other near .* Multiply the formula by 0\.\d+"),
    ],
)
def test_a_lag_in_which_parts_would_meet_is_refused_with_one_that_works(lag: str, said: str):
    stretch = "  - stretch: {amount: {keys: {1: 1, 25: 2}}}"
    shot = shot_of(stretch, f"  - lag: {lag}")
    with pytest.raises(FlowsculptError, match=rf"frame \d+: .*{said}"):
        list(shot.motion.flow.findings())
    with pytest.raises(FlowsculptError, match=said) as error:
        list(animate(shot))
    if lag.startswith("{"):
        most = str(error.value).split("lag: ")[-1].split(" ")[0]
        first = int(str(error.value).split("frame ")[1].split(":")[0])
        frames = animate(shot_of(stretch, f"  - lag: {lag.replace('3,', most + ',')}"))
        assert [next(frames) for _ in range(first)], "what the message says works, up to that frame"


def test_a_delay_that_jumps_is_refused():
    flow = shot_of(f"  - {FLOWS['stretch']}", "  - lag: 0.2 if y > 0.3 else 0").motion.flow
    with pytest.raises(FlowsculptError, match=r"parts pass through each other near"):
        flow.displace(np.linspace([0.0, -1.0, 0.0], [0.0, 1.0, 0.0], 500), 0.0, 1.0)
