"""`validate` says how near a loop comes to its first frame."""

from __future__ import annotations

import pytest

from flowsculpt.pipeline.plugins.authoring.first_frame import FirstFrames
from flowsculpt.pipeline.plugins.authoring.scene_rules import loop_report
from tests.shot.test_loops import SHOT, TURNS, shot


def report(text: str) -> tuple[str, list[str]]:
    looped = shot(text)
    words, findings = loop_report(looped, FirstFrames().of(looped.motion))
    return words, [finding.text for finding in findings]


def test_validation_measures_how_far_a_loop_ends_from_its_beginning():
    assert report(SHOT) == (
        "loop: frame 13, the first again, is 0.00% of the subject's size from it, at most 0.00%",
        [],
    )
    assert report(TURNS)[1] == []
    words, (fault,) = report(TURNS.replace("13: 0}", "13: 10}"))
    assert words.endswith("at most 6.17%")  # the ends turn by 5°: 2 sin 2.5° × half a diagonal
    assert fault.startswith("the flows do not return: in frame 13 points are up to 6.17%")
    assert report(SHOT.replace("true", "{dissolve: 4}")) == (
        "loop: frames 9-12 dissolve into 1-4; movies have 8 frames",
        [],
    )
    assert report(SHOT.replace("loop: true", "")) == ("", [])


@pytest.mark.parametrize(
    ("camera", "name"),
    [("azimuth: {keys: {1: 0, 13: 90}}", "azimuth"), ("orbit: 100", "azimuth"),
     ("roll: {keys: {1: 0, 13: 20}}", "roll"),
     ("target: {keys: {1: [0, 0, 0], 13: [0, 1, 0]}}", "target"), ("dolly: {keys: {1: 1, 13: 2}}", "dolly")],
)  # fmt: skip
def test_validation_names_what_of_the_camera_does_not_return(camera, name):
    (fault,) = report(TURNS.replace("azimuth: {keys: {1: 0, 13: 360}}", camera))[1]
    assert fault.startswith(f"the camera does not return: {name} differs between frame 13")
    assert report(TURNS.replace("azimuth: {keys: {1: 0, 13: 360}}", "orbit: 720"))[1] == []
