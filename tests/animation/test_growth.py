"""The growth of a surface is stopped where the shot says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.request.manifest import mesh_keys
from flowsculpt.pipeline.shot import Motion, Shot, read_shot
from tests.animation.motions import resampled, same

SHOT = """\
title: Growth
frames: 1-30
subject: {{solid: icosphere, radius: 1}}
resample: {{max_edge_length: {edge}{more}}}
flows: [{{rotation: {{speed: 20}}}}, {{{flow}}}]
look: clay
"""

WINDING = "spiral_vortex: {strength: 15}"


def shot_of(folder: Path, flow: str, edge: object = 0.2, more: str = "") -> Shot:
    path = folder / "growth.yaml"
    path.write_text(SHOT.format(flow=flow, edge=edge, more=more))
    return read_shot(path)


def test_a_run_stops_at_the_growth_that_the_shot_allows(tmp_path: Path) -> None:
    shot = shot_of(tmp_path, WINDING, more=", max_growth: 1.3")
    frames = []
    with pytest.raises(
        FrameError, match=r"max_growth 1\.3 times the [0-9]+ of frame 1; slow the flows"
    ) as stopped:
        frames.extend(animate(shot))
    assert stopped.value.frame == len(frames) + 1 > 2
    with pytest.raises(FrameError, match=r"max_growth 1\.3") as again:
        list(animate(shot, resume=frames[-2]))
    assert str(again.value) == str(stopped.value), "a resumed run stops where the whole one does"
    earlier = replace(frames[-2], report=replace(frames[-2].report, start_vertices=None))
    with pytest.raises(FrameError, match=r"max_growth 1\.3") as resumed:
        list(animate(shot, resume=earlier))
    assert str(resumed.value) == str(stopped.value), (
        "also from frames of versions that did not note the start"
    )


def test_a_limit_of_growth_changes_neither_keys_nor_bits(motion: Motion, tmp_path: Path) -> None:
    plain, limited = (shot_of(tmp_path, WINDING, more=more) for more in ("", ", max_growth: 50"))
    assert mesh_keys(plain.motion) == mesh_keys(limited.motion)
    short = replace(motion, frames=FrameRange.parse("5-8"))
    for one, other in zip(animate(short), animate(resampled(short, max_growth=50.0)), strict=True):
        assert same(one, other)
