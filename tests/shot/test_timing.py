"""Values that change in time in a shot file: keys, handles, loops and formulas, and their errors."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.flow import Keyframes
from flowsculpt.pipeline.flow.keyframes import Handle
from flowsculpt.pipeline.flow.parameters import number_at, vector_at
from flowsculpt.pipeline.shot import read_shot

SHOT = """\
title: Keys
frames: 1-49
subject: {{solid: box}}
resample: {{max_edge_length: 0.25}}
flows:
  - vortex: {{{}}}
"""


def vortex(parameters: str) -> Any:
    flow: Any = read_shot("a.yaml", SHOT.format(parameters)).motion.flow
    return flow.flows[0].field


def told(parameters: str) -> list[str]:
    with pytest.raises(ShotError) as error:
        vortex(parameters)
    return list(error.value.messages)


def test_keys_stand_between_frames_and_in_seconds() -> None:
    strength = vortex('strength: {ease: linear, keys: {1: 0, 12.5: 2, "1.25s": 4}}').strength
    assert strength.times == (0.0, 11.5 / 24, 1.25)


def test_handles_are_so_far_from_their_key_in_frames_or_seconds() -> None:
    own = "{value: 4, ease: bezier, left: [-0.25s, 0], right: [0, 2]}"
    keys = f"{{1: {{value: 0, right: [6, 1]}}, 25: {own}, 49: 1}}"
    strength = vortex(f"strength: {{keys: {keys}}}").strength
    assert strength.eases == ("bezier", "bezier", "sine_in_out")
    assert strength.right == (Handle(0.25, (1.0,)), Handle(0.0, (2.0,)), None)
    assert strength.left == (None, Handle(-0.25, (0.0,)), None)


def test_handles_take_the_unit_of_their_parameter() -> None:
    text = SHOT.format("strength: 1").replace(
        "vortex: {strength: 1}", "rotation: {speed: {keys: {1: {value: 90, right: [6, 45]}, 49: 0}}}"
    )
    flow: Any = read_shot("a.yaml", text).motion.flow
    assert flow.flows[0].field.speed.right[0] == Handle(0.25, (math.radians(45),))


def test_vectors_have_vectors_for_handles() -> None:
    centre = vortex("centre: {keys: {1: {value: [0, 0, 0], right: [8, [0, 3, 0]]}, 25: [1, 0, 0]}}").centre
    assert vector_at(centre, 0.5)[1] > 0.5 and vector_at(centre, 1.0) == (1.0, 0.0, 0.0)


def test_curves_go_on_as_told() -> None:
    strength = vortex(
        "strength: {ease: linear, keys: {1: 0, 13: 4}, after: ping_pong, before: continue}"
    ).strength
    assert (strength.before, strength.after) == ("continue", "ping_pong")
    assert number_at(strength, 1.0) == pytest.approx(0.0) and number_at(strength, 0.75) == pytest.approx(2.0)


def test_parameters_are_formulas_over_time() -> None:
    field = vortex('strength: {formula: "4*sin(2*pi*t)"}, centre: {formula: [cos(t), "0", frame / 49]}')
    assert number_at(field.strength, 0.25) == pytest.approx(4.0)
    assert vector_at(field.centre, 2.0) == pytest.approx((math.cos(2.0), 0.0, 1.0))


def test_a_camera_and_a_threshold_may_move_the_same_ways() -> None:
    text = SHOT.format("strength: 1").replace(
        "{max_edge_length: 0.25}", "{max_edge_length: {keys: {1: 0.25, 13: 0.3}, after: ping_pong}}"
    )
    shot = read_shot("a.yaml", text + "camera: {azimuth: {formula: 30 * sin(t)}}\n")
    assert shot.picture.camera.at(1.0)[0] == pytest.approx(math.radians(30 * math.sin(1.0)))
    now = shot.motion.resampling_at(25)
    assert now is not None and now.thresholds.max_edge_length == pytest.approx(0.25)


def test_a_key_changed_leaves_the_curve_before_the_key_before_it() -> None:
    """With handles that draw themselves a key counts one way further."""

    def at(last: float, ease: str) -> Keyframes:
        found: Keyframes = vortex(
            f"strength: {{ease: {ease}, keys: {{1: 0, 13: 4, 25: 5, 49: {last}}}}}"
        ).strength
        return found

    frames = [i / 24 for i in range(49)]
    for ease, until in (("sine_in_out", 24), ("elastic_out", 24), ("bezier", 12)):
        one, other = at(9, ease), at(2, ease)
        same = [one.at(t) == other.at(t) for t in frames]
        assert all(same[: until + 1]) and not same[until + 6]


TRIMMED = """\
title: Trimmed
frames: 1-58
subject: {solid: box}
resample: {max_edge_length: {keys: {1: 0.3, 58: 0.2}}}
flows:
  - vortex: {strength: {ease: bezier, keys: {1: 0, 12.5: 2, 58: 4}}}
  - within: {region: {sphere: {radius: {keys: {1: 1, 58: 3}}}}, flows: [twist: {amount: 2}]}
camera: {azimuth: {ease: bezier, keys: {1: -30, 20: 10, 58: 0}}, roll: {keys: {1: 0, 3: 4}, before: loop}}
speed: {keys: {1: 1, 58: 2}}
"""


def test_keys_outside_of_a_trimmed_shot_shape_its_curves_as_before() -> None:
    whole, kept = (read_shot("a.yaml", TRIMMED.replace("1-58", frames)) for frames in ("1-58", "30-40"))
    assert not whole.notes
    assert kept.notes == (
        "a.yaml:4:37: 14 keys are outside of the shot, which has frames 30-40; curves keep their shape.",
    )
    for frame in range(30, 41):
        before, now = whole.motion.clock.time(frame), kept.motion.clock.time(frame)
        for name in ("azimuth", "roll"):
            of_whole, of_kept = (getattr(each.picture.camera, name) for each in (whole, kept))
            assert number_at(of_kept, now) == pytest.approx(number_at(of_whole, before), abs=1e-12)
        assert number_at(kept.motion.speed, now) == pytest.approx(number_at(whole.motion.speed, before))
        lengths = [each.motion.resampling_at(frame).thresholds for each in (whole, kept)]
        assert lengths[0].max_edge_length == pytest.approx(lengths[1].max_edge_length, abs=1e-12)


BAD = [
    ("strength: {keys: {1: 0, 25: 3, 1s: 1}}",
     "6:45: key 1s is at the same time as key 25; a time has one value. Remove one of them."),
    ("strength: {keys: {1: 0, 36: 3, 1s: 1}}",
     "6:45: key 1s comes after key 36; keys go forward in time. Sort them."),
    ("strength: {keys: {1: 0, 2 sec: 3}}",
     "6:38: key '2 sec' is not a time; write a frame, such as 12, or seconds, such as 0.5s"),
    ("strength: {keys: {1: 0, .nan: 3}}",
     "6:38: key nan is not a time; write a frame, such as 12, or seconds, such as 0.5s"),
    ("strength: {keys: {1: 0, 2: 4s}}",
     "6:38: flows.0.vortex.strength.keys.2: '4s' is not a number. Did you mean 4?"),
    ("strength: {keys: {1: 0, 2: 1}, after: pingpong}",
     "6:45: flows.0.vortex.strength.after: 'pingpong' is not an extrapolation. Did you mean 'ping_pong'?"),
    ("strength: {keys: {1: 0, 9: {value: 2, left: [-2, 1]}}}",
     "6:52: left is a handle beside a segment that is not Bézier. Write ease: bezier with the key before, "
     "or leave left out."),
    ("strength: {keys: {1: {value: 2, ease: linear, right: [2, 1]}}}",
     "6:60: right is a handle beside a segment that is not Bézier. Write ease: bezier with the key, "
     "or leave right out."),
    ("strength: {keys: {1: {value: 2, right: [-2, 1]}}}",
     "6:46: right has -2 for its time, which must be positive there. Turn it round."),
    ("strength: {keys: {1: {value: 2, right: [soon, 1]}}}",
     "6:46: right has 'soon' for its time, which is frames, or seconds as 0.5s; a handle is [time, value] "
     "away from its key, such as [6, 0.5]"),
    ("strength: {keys: {1: {value: 2, right: 3}}}",
     "6:46: right is 3; a handle is [time, value] away from its key, such as [6, 0.5]"),
    ("strength: {keys: {1: {value: 2, right: [3, big]}}}",
     "6:46: right has 'big' for its value; a handle is [time, value] away from its key, such as [6, 0.5]"),
    ("centre: {keys: {1: {value: [0, 0, 0], right: [3, 1]}}}",
     "6:52: right has 1 number and its key 3; they need as many. Write all of them."),
    ("strength: {formula: 4*sinn(t)}", "6:36: sinn is not a function here. Did you mean 'sin'?"),
    ("strength: {formula: __import__('os')}", "6:34: __import__ is not a function here. There are: "),
    ("strength: {formula: 1 / (frame - 13)}",
     "6:14: flows.0.vortex.strength: not finite: formula '1 / (frame - 13)' is inf "
     "at t 0.5, frame 13; "
     "it must be finite everywhere. Guard it with max, clamp or `… if … else …`."),
    ("radius: {formula: 1 - t}",
     "6:14: flows.0.vortex.radius: 0 at frame 25 is out of range; it must stay above 0"),
    ("radius: {keys: {1: 1, 49: 0.05}, ease: back_out}",
     "6:14: flows.0.vortex.radius: -0.004689 at frame 22"),
    ("centre: {formula: [1, 2]}",
     "6:23: flows.0.vortex.centre.formula: 2 items; it must have at least 3"),
]  # fmt: skip


@pytest.mark.parametrize(("parameters", "message"), BAD, ids=[p[:60] for p, _ in BAD])
def test_a_mistake_in_time_is_told_with_its_place(parameters: str, message: str) -> None:
    lines = told(parameters)
    assert lines[0].startswith(f"a.yaml:{message}"), lines
    assert len(lines) == 1


def test_the_page_of_another_folder_is_not_needed(tmp_path: Path) -> None:
    assert read_shot(tmp_path / "a.yaml", SHOT.format("strength: 2")).name == "a"
