"""Re-timing: a shot whose flow runs at a speed of its own, and moments between frames."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.animation import animate, mesh_at_subframe
from flowsculpt.pipeline.errors import FrameError, ShotError, UsageError
from flowsculpt.pipeline.flow import EASINGS, Keyframes, keyed
from flowsculpt.pipeline.flow.keyframes import FormulaCurve, _integral, elapsed
from flowsculpt.pipeline.shot import Shot, read_shot

SHOT = """\
title: Speed
frames: 1-25
subject: {{solid: box, size: [1, 1, 1]}}
resample: {}
speed: {}
flows:
  - vortex: {{strength: 2}}
  - twist: {{amount: {{ease: linear, keys: {{1: 0, 25: 90}}}}}}
"""


def shot(speed: str, resample: str = "off", **changes: str) -> Shot:
    text = SHOT.format(resample, speed)
    for old, new in changes.items():
        text = text.replace(old, new)
    return read_shot("a.yaml", text)


@pytest.mark.slow
@pytest.mark.parametrize("ease", sorted(EASINGS))
def test_the_time_that_passes_is_the_integral_of_the_speed(ease: str) -> None:
    """Against the midpoint rule; whole ways are known: those that are symmetric take half the time."""
    speed, n = keyed((0.0, 1.2), (1.0, 3.0), ease), 20000
    for until in (0.37, 1.2, 2.0):
        rough = sum(speed.at((i + 0.5) * until / n)[0] for i in range(n)) * until / n
        assert elapsed(speed, until) == pytest.approx(rough, abs=1e-4 if ease == "constant" else 2e-6)
    if ease.endswith("in_out") or ease == "linear":
        assert elapsed(speed, 1.2) == pytest.approx(2.4, abs=1e-12)


def test_known_integrals_are_met_to_the_last_digits() -> None:
    assert elapsed(keyed((0, 2), (0, 1), "circ_in"), 2) == pytest.approx(2 - math.pi / 2, abs=1e-12)
    assert elapsed(keyed((0, 2), (0, 1), "quint_in"), 2) == pytest.approx(1 / 3, abs=1e-13)
    assert elapsed(keyed((0, 2), (0, 1), "sine_in"), 1) == pytest.approx(
        1 - 4 / math.pi * math.sin(math.pi / 4), abs=1e-13
    )
    assert elapsed(keyed((0, 2), (1, 5), "constant"), 3) == pytest.approx(7, abs=1e-13)
    wave = FormulaCurve(("1 + sin(t)",), 24.0, 1)
    assert elapsed(wave, 2.0) == pytest.approx(3 - math.cos(2.0), abs=1e-13)
    assert elapsed(0.25, 3.0) == 0.75
    loop = Keyframes((0.0, 1.0), ((0.0,), (1.0,)), ("linear",) * 2, after="ping_pong")
    assert elapsed(loop, 4.5) == pytest.approx(2.125, abs=1e-13)


KEYS = st.tuples(st.floats(-2, 2), st.floats(0.05, 1.5), st.floats(0.1, 1.5))
BEYOND = st.sampled_from(["hold", "loop", "ping_pong", "offset", "continue"])


@settings(max_examples=40, deadline=None)
@given(
    KEYS, st.sampled_from(["linear", "constant", "quad_in", "bounce_out"]), BEYOND, BEYOND, st.floats(0, 5)
)
def test_beyond_the_keys_time_passes_as_the_speed_says(
    keys: tuple[float, float, float], ease: str, before: Any, after: Any, until: float
) -> None:
    """Against the midpoint rule, in rounds of the keys or whatever follows them."""
    first, *lengths = keys
    times = (first, first + lengths[0], first + sum(lengths))
    speed = Keyframes(times, ((1.0,), (3.0,), (0.5,)), (ease,) * 3, before=before, after=after)
    n = 4000
    rough = sum(speed.at((i + 0.5) * until / n)[0] for i in range(n)) * until / n
    largest = max(1.0, *(abs(speed.at(i * until / 50)[0]) for i in range(51)))
    assert elapsed(speed, until) == pytest.approx(rough, abs=largest * (3e-2 if ease == "constant" else 4e-3))


@pytest.mark.parametrize("mode", ["loop", "ping_pong", "offset"])
def test_many_rounds_take_no_longer_than_one(mode: Any) -> None:
    """Keys a ten-thousandth of a frame apart; the sums are known."""
    _integral.cache_clear()
    length = 1e-4 / 24
    speed = Keyframes((0.0, length), ((1.0,), (2.0,)), ("linear",) * 2, after=mode)
    rounds = 2.0 / length
    expected = {"loop": 3.0, "ping_pong": 3.0, "offset": length * (1.5 * rounds + rounds * (rounds - 1) / 2)}
    assert elapsed(speed, 2.0) == pytest.approx(expected[mode], rel=1e-4)
    assert _integral.cache_info().misses < 20


@pytest.mark.parametrize("before", ["hold", "continue"])
@pytest.mark.parametrize("after", ["hold", "continue", "loop", "ping_pong", "offset"])
def test_when_a_key_comes_changes_no_bit_before_the_key_before_it(before: Any, after: Any) -> None:
    one, other = (
        Keyframes((0.21, 0.9, last), ((1.0,), (2.0,), (0.3,)), ("bounce_in",) * 3, before=before, after=after)
        for last in (1.7, 1.83)
    )
    times = [i / 48 for i in range(44)]  # up to 0.8958
    assert [elapsed(one, t).hex() for t in times] == [elapsed(other, t).hex() for t in times]
    assert elapsed(one, 1.5) != elapsed(other, 1.5)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted(EASINGS)), st.floats(0, 3), st.floats(0, 3))
def test_time_adds_up(ease: str, a: float, b: float) -> None:
    speed = keyed((0.2, 0.9, 2.0), (1.0, -0.5, 2.0), ease)
    pieces = [elapsed(speed, t) for t in (a, b)]
    doubled = keyed((0.2, 0.9, 2.0), (2.0, -1.0, 4.0), ease)
    assert [2 * piece for piece in pieces] == pytest.approx([elapsed(doubled, t) for t in (a, b)], abs=1e-12)


def test_a_shot_at_half_the_speed_is_as_far_at_its_end_as_the_other_at_its_middle() -> None:
    alone = {"  - twist": "  # twist"}
    half, whole = shot("0.5", **alone), shot("1", **alone)
    assert half.motion.clock.step(25) == (23 / 48, 24 / 48 - 23 / 48)
    last = list(animate(half))[-1]
    middle = next(frame for frame in animate(whole) if frame.number == 13)
    np.testing.assert_allclose(last.mesh.vertices, middle.mesh.vertices, atol=1e-8)


def test_at_a_speed_of_one_nothing_changes_at_all() -> None:
    plain = read_shot("a.yaml", SHOT.format("off", "1").replace("speed: 1\n", ""))
    assert plain.motion == shot("1").motion
    assert [plain.motion.step_data(n) for n in (2, 9)] == [shot("1.0").motion.step_data(n) for n in (2, 9)]


def test_steps_follow_each_other_without_a_gap() -> None:
    clock = shot("{keys: {1: 0, 13: 2, 25: 0.5}, ease: elastic_out}").motion.clock
    steps = [clock.step(number) for number in range(2, 26)]
    for (start, length), (after, _) in pairwise(steps):
        assert start + length == pytest.approx(after, abs=1e-14)
    assert sum(length for _, length in steps) == pytest.approx(elapsed(clock.speed, 1.0), abs=1e-13)


def test_a_speed_of_nought_freezes_and_below_it_runs_backwards() -> None:
    """There and back again."""
    turn = "{ease: constant, keys: {1: 1, 13: -1, 25: -1}}"
    frames = list(animate(shot(turn)))
    np.testing.assert_allclose(frames[-1].mesh.vertices, frames[0].mesh.vertices, atol=1e-6)
    assert np.abs(frames[12].mesh.vertices - frames[0].mesh.vertices).max() > 0.1
    still = list(animate(shot("0")))
    np.testing.assert_array_equal(still[-1].mesh.vertices, still[0].mesh.vertices)


def test_a_key_of_the_speed_leaves_the_frames_before_it_alone() -> None:
    one, other = (shot(f"{{keys: {{1: 1, 9: 2, 17: {last}}}}}").motion for last in (2, 3))
    same = [one.step_data(n) == other.step_data(n) for n in range(2, 26)]
    assert same == [n <= 9 for n in range(2, 26)]


def test_moving_a_key_of_the_speed_leaves_the_frames_before_the_key_before_it_alone() -> None:
    one, other = (shot(f"{{keys: {{1: 1, 9: 2, {last}: 3}}}}").motion for last in (17, 20))
    same = [one.step_data(n) == other.step_data(n) for n in range(2, 26)]
    assert all(same[:8]) and not any(same[8:18])


def test_keys_of_the_speed_that_are_close_are_fine_and_those_at_infinity_are_told() -> None:
    _integral.cache_clear()
    clock = shot("{keys: {1: 1, 1.0001: 2}}").motion.clock
    assert clock.flow_time(25) == pytest.approx(2.0, abs=1e-5)
    assert _integral.cache_info().misses < 40
    with pytest.raises(ShotError, match=r"a\.yaml:5:"):
        shot("{keys: {-1000000000000: 1, 5: 2}}")


def test_at_twice_the_speed_the_flow_has_keys_beyond_the_last_frame() -> None:
    assert shot("2", **{"25: 90": "49: 90"}).motion.clock.flow_time(25) == 2.0
    assert not shot("2", **{"25: 90": "49: 90"}).notes
    for speed, last in (("2", 50), ("1", 26)):
        (note,) = shot(speed, **{"25: 90": f"{last}: 90"}).notes
        assert "1 key is outside of the shot, which has frames 1-25" in note


@pytest.mark.parametrize("handle", ["5", "{solid: box}", "[-2, [b]]", "[]"])
def test_a_handle_of_the_speed_that_cannot_be_is_told_at_its_place(handle: str) -> None:
    with pytest.raises(ShotError, match=r"a\.yaml:5:\d+: left .*a handle is \[time, value\]"):
        shot(f"{{keys: {{1: 1, 9: {{value: 2, left: {handle}}}}}}}")


def test_a_speed_that_cannot_be_is_told_once() -> None:
    with pytest.raises(ShotError) as error:
        shot("{keys: {1: 1, 9: fast}}")
    assert error.value.messages == ("a.yaml:5:22: speed.keys.9: 'fast' is not a number",)


def test_between_frames_the_surface_is_where_the_flow_has_it() -> None:
    made = shot("{keys: {1: 0.5, 25: 2}}", "{max_edge_length: 0.4}")
    plain = shot("{keys: {1: 0.5, 25: 2}}")
    frames, raw = list(animate(made)), list(animate(plain))
    for moment in (12.0, 12.5, 13.0, 11.25):
        mesh: Any = mesh_at_subframe(plain.motion, raw[11], moment)
        assert mesh.faces.tobytes() == raw[11].mesh.faces.tobytes()
        if moment == 13.0:
            assert mesh.vertices.tobytes() == raw[12].mesh.vertices.tobytes()
        if moment == 12.0:
            np.testing.assert_array_equal(mesh.vertices, raw[11].mesh.vertices)
    back = mesh_at_subframe(plain.motion, raw[11], 11.0)
    np.testing.assert_allclose(back.vertices, raw[10].mesh.vertices, atol=1e-8)
    assert len(mesh_at_subframe(made.motion, frames[4], 5.5).vertices) == len(frames[4].mesh.vertices)
    with pytest.raises(UsageError, match="sub-frame 14 is more than a frame from frame 12"):
        mesh_at_subframe(plain.motion, raw[11], 14)


@pytest.mark.parametrize(
    ("speed", "says"),
    [
        (
            "{formula: 1 + sqrt(abs(t - 0.03) - 0.002)}",
            "speed is not finite: formula '1 + sqrt(abs(t - 0.03) - 0.002)' is nan at t 0.0",
        ),
        ("{formula: 1e50}", "speed takes the flow to 4.17e+48 s by frame 2; its time goes up to 1e12 s."),
        ("{formula: 1 / (frame - 3)}", "speed: not finite: formula '1 / (frame - 3)' is inf at"),
    ],
)
def test_a_speed_that_is_none_is_told_with_the_shot_between_half_frames_too(speed: str, says: str) -> None:
    with pytest.raises(ShotError) as told:
        shot(speed)
    (message,) = told.value.messages
    assert message.startswith("a.yaml:5:1: ") and says in message, message


def test_a_speed_that_was_never_read_fails_in_its_frame_and_leaves_keys_to_the_others() -> None:
    good = shot("1").motion
    bad = dataclasses.replace(good, speed=FormulaCurve(("sqrt(4.5 - frame)",), 24.0, 1))
    keys = [bad.step_data(number) for number in range(2, 26)]
    assert [isinstance(key, dict) for key in keys] == [number > 4 for number in range(2, 26)]
    frames = []
    with pytest.raises(FrameError, match=r"^frame 5: speed is not finite: formula .* is nan at t 0.1"):
        for frame in animate(bad):
            frames.append(frame.number)
    assert frames == [1, 2, 3, 4]
