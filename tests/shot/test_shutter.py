"""Shutters and layers in shot files: what can be said, and how what is wrong is told."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.shot import Shot, read_shot

HEAD = "title: T\nframes: 1-24\nsubject: {solid: box}\nresample: off\n"


def shot_of(text: str) -> Shot:
    return read_shot(Path("a.yaml"), HEAD + text)


def test_without_a_word_pictures_show_one_moment_and_no_layers_more() -> None:
    picture = shot_of("").picture
    assert picture.shutter.open_at(0.5) is None
    assert picture.aovs.precision == picture.aovs.extra == ()
    assert shot_of("shutter: {angle: 0}\n").picture.shutter.open_at(0.5) is None


def test_a_shutter_opens_half_its_angle_before_the_frame_unless_it_says_when() -> None:
    assert shot_of("shutter: {}\n").picture.shutter.open_at(0.0) == pytest.approx((-0.25, 0.25))
    assert shot_of("shutter: {angle: 90}\n").picture.shutter.open_at(0.0) == pytest.approx((-0.125, 0.125))
    late = shot_of("shutter: {angle: 180, phase: 0}\n").picture.shutter
    assert late.open_at(0.0) == pytest.approx((0.0, 0.5))
    widest = shot_of("shutter: {angle: 360, phase: -360}\n").picture.shutter.open_at(0.0)
    assert widest == pytest.approx((-1.0, 0.0)) and widest[0] >= -1.0


def test_a_shutter_may_be_keyed() -> None:
    shot = shot_of("shutter: {angle: {ease: linear, keys: {1: 0, 24: 360}}}\n")
    shutter, clock = shot.picture.shutter, shot.motion.clock
    assert shutter.open_at(clock.time(1)) is None
    middle = shutter.open_at(clock.time(12.5))
    assert middle == pytest.approx((-0.25, 0.25))
    assert shutter.open_at(clock.time(24)) == pytest.approx((-0.5, 0.5))
    assert math.isclose(shot.picture.shutter.angle.at(clock.time(24))[0], 2 * math.pi)


def test_layers_are_named_or_given_a_precision() -> None:
    by_name = shot_of("aovs: [noise, velocity]\n").picture.aovs
    assert by_name.precision == (("velocity", "half"), ("noise", "half"))
    exactly = shot_of("aovs: {position: half, rest: float, velocity: float}\n").picture.aovs
    assert exactly.precision == (("position", "half"), ("velocity", "float"), ("rest", "float"))
    assert exactly.extra == ("velocity", "rest")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("shutter: {angel: 180}\n", "a.yaml:5:11: shutter.angel: unknown name. Did you mean 'angle'?"),
        (
            "shutter: {angle: 400}\n",
            "a.yaml:5:11: shutter.angle: 400 is out of range; it must be at most 360",
        ),
        ("shutter: {angle: -1}\n", "it must be at least 0"),
        (
            "shutter: {phase: 10}\n",
            "shutter.phase: 10 is out of range; it must be at most 0",
        ),
        (
            "shutter: {angle: {formula: 30 * frame}}\n",
            "375 at frame 12.5 is out of range; it must stay from 0 to 360",
        ),
        ("aovs: [velocty]\n", "a.yaml:5:8: aovs.0: 'velocty' is not an AOV. Did you mean 'velocity'?"),
        ("aovs: {rast: half}\n", "'rast' is not an AOV. Did you mean 'rest'?"),
        (
            "aovs: {rest: full}\n",
            "a.yaml:5:8: aovs.rest: 'full' is not allowed; it must be 'half' or 'float'",
        ),
    ],
)
def test_mistakes_are_told_at_their_line(text: str, told: str) -> None:
    with pytest.raises(ShotError) as error:
        shot_of(text)
    assert told in str(error.value)
