"""A film of ten thousand frames whose vertices all keep to the exact surface."""

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.mesh import validate
from flowsculpt.pipeline.resample import Report
from flowsculpt.pipeline.shot import read_shot

TURN = 50
"""Frames that a flow has: half of them there, half of them back, about a centre that every turn moves."""

SHOT = """\
title: There and back
frames: 1-10000
subject: {{solid: icosphere, radius: 1}}
resample: {{max_edge_length: 0.25, placement: exact, rest_interval: 100}}
flows:
  - vortex: {{axis: z, centre: {centre}, radius: 0.6, strength: {first}}}
  - strain: {{rate: {second}}}
  - vortex: {{axis: x, centre: {centre}, radius: 0.5, strength: {third}}}
  - twist: {{axis: y, amount: {fourth}}}
"""


def turns(which: int, there: float, back: float) -> str:
    """Keys that repeat every four turns, and are those of rest in the other three."""
    start = which * TURN
    quarter, half = TURN // 4, TURN // 2
    keys = {1: 0, start + 1: 0, start + 1 + quarter: there}
    if back:
        keys |= {start + 1 + half: 0, start + 1 + half + quarter: back}
    keys |= {start + 1 + TURN: 0, 4 * TURN + 1: 0}
    return "{after: loop, keys: {" + ", ".join(f"{key}: {value}" for key, value in keys.items()) + "}}"


@pytest.mark.soak
def test_ten_thousand_frames_with_exact_placement_keep_every_promise(tmp_path: Path) -> None:
    turn = f"floor((frame - 1) / {TURN})"
    centre = f'{{formula: ["0.5 * sin(2 * {turn})", "0.5 * cos(3 * {turn})", "0"]}}'
    file = tmp_path / "long.yaml"
    file.write_text(
        SHOT.format(
            centre=centre,
            first=turns(0, 6, -6),
            second=turns(1, 0.7, -0.7),
            third=turns(2, -7, 7),
            fourth=turns(3, 100, 0),
        )
    )
    seen = 0
    for frame in animate(read_shot(file)):
        found = validate(frame.mesh).require(closed=True, name=f"frame {frame.number}")
        assert found.euler == 2, frame.number
        assert np.abs(frame.mesh.vertices).max() < 3, frame.number
        report = frame.report.resampling
        if isinstance(report, Report):  # the first frame is the subject as it is
            assert report.too_long == 0 and report.longest <= 0.25, frame.number
            assert report.too_short == sum(report.refused.values()), frame.number
        seen += 1
    assert seen == 10_000
