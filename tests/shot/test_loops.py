"""Loops: the frame after the last one is the first."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.animation.loop import step_into
from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.shot import Shot, read_shot
from flowsculpt.pipeline.shot.motion import Clock, Loop

SHOT = """\
title: Loop
frames: 1-12
subject: {solid: box, size: [1, 1, 1]}
resample: {max_edge_length: 0.3}
flows:
  - vortex: {strength: 2}
  - twist: {amount: {ease: linear, keys: {1: 0, 12: 90}}}
loop: true
"""

TURNS = """\
title: Loop
frames: 1-12
subject: {solid: box, size: [1, 1, 1]}
resample: {max_edge_length: 0.3}
flows: [{twist: {amount: {keys: {1: 0, 7: 90, 13: 0}}}}]
camera: {azimuth: {keys: {1: 0, 13: 360}}}
loop: turns
"""


def shot(text: str = SHOT) -> Shot:
    return read_shot("a.yaml", text)


@given(st.integers(-5, 5), st.integers(2, 60), st.sampled_from([0.5, 1.0, 3.0]), st.floats(0.0, 1.0))
def test_the_flows_time_runs_to_the_middle_of_a_loop_and_back(first, count, speed, share):
    clock = Clock(FrameRange.of(range(first, first + count)), FrameRate.of(24), speed, Loop("back"))
    away = share * count
    there, back = clock.flow_time(first + away), clock.flow_time(first + count - away)
    assert there == pytest.approx(back, abs=1e-9)
    assert clock.flow_time(first + count / 2) == pytest.approx(speed * count / 48)
    assert 0.0 <= there <= speed * count / 48 + 1e-12


def test_a_shot_that_loops_returns_to_its_first_frame():
    motion = shot().motion
    first, *_, last = animate(motion)
    points = last.mesh.vertices
    after = step_into(motion, motion.flow, 13).apply(points.copy())
    assert np.abs(after).max() == pytest.approx(0.5, abs=1e-6)
    inside = np.abs(after).max(axis=1)
    assert np.allclose(inside, 0.5, atol=1e-6)  # each vertex lies on the box at rest
    assert np.ptp(first.mesh.vertices) == pytest.approx(1.0)


@pytest.mark.parametrize("loop", ["true", "turns"])
def test_keys_of_a_loop_may_stand_at_the_frame_that_is_the_first_again(loop):
    looped = shot(TURNS.replace("turns", loop))
    assert looped.loop is not None and not looped.notes


@pytest.mark.parametrize("loop", ["false", "{dissolve: 3}"])
def test_that_frame_is_outside_of_other_shots(loop):
    (note,) = shot(TURNS.replace("turns", loop)).notes
    assert "2 keys are outside of the shot" in note


def test_a_dissolve_needs_twice_its_frames():
    assert shot(SHOT.replace("true", "{dissolve: 6}")).loop == Loop("dissolve", 6)
    with pytest.raises(
        ShotError, match=r"a.yaml:8:8: a dissolve of 7 frames needs 14, and the shot has 12\."
    ):
        shot(SHOT.replace("true", "{dissolve: 7}"))


@pytest.mark.parametrize(
    ("loop", "message"),
    [
        ("turn", "Did you mean 'turns'?"),
        ("1", "1 is not true or false"),
        ("{dissolve: 0}", "must be at least 1"),
        ("{dissolve: 1s}", "Write 24 for 1 s"),
        ("{fade: 3}", "fade"),
    ],
)
def test_other_loops_are_refused(loop, message):
    with pytest.raises(ShotError) as error:
        shot(SHOT.replace("true", loop))
    assert len(error.value.messages) == 1
    assert message in str(error.value)
