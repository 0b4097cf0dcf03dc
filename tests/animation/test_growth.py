"""The growth of a surface: forecast before it is simulated, warned of, and stopped where the shot says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.animation.motion_forecast import MotionForecast
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


@pytest.mark.slow
@pytest.mark.parametrize(
    "flow", ["strain: {rate: 0.7}", "curl_noise: {strength: 0.4}", "expansion: {rate: 0.5, radius: 3}"]
)
def test_the_largest_frame_is_forecast_within_a_factor_of_two(flow: str, tmp_path: Path) -> None:
    motion = shot_of(tmp_path, flow).motion
    counts = {frame.number: len(frame.mesh.vertices) for frame in animate(motion)}
    rest = motion.mesh_at_rest()
    forecasts = list(MotionForecast(motion).growth(rest.vertices, rest.faces, counts[1]))
    assert [forecast.frame for forecast in forecasts] == list(range(2, 31))
    assert max(counts.values()) > 1.2 * counts[1]
    assert 0.5 < max(forecast.vertices for forecast in forecasts) / max(counts.values()) < 2.0
    assert forecasts[-1].place == "flows.1" and flow.startswith(forecasts[-1].flow)


def test_faces_that_are_lines_grow_nothing(motion: Motion) -> None:
    along = np.array([0.9, 0.3, 0.17])
    line = np.array([0.0 * along, 0.3 * along, along])
    assert list(MotionForecast(motion).growth(line, np.array([[0, 1, 2]]), 3)) == []
    beside = np.vstack([line, [[0.0, 1.0, 0.0]]])
    for faces in ([[0, 1, 2], [0, 2, 3]], [[0, 2, 3], [0, 1, 2]]):
        assert all(
            growth.times < 100.0 for growth in MotionForecast(motion).growth(beside, np.array(faces), 4)
        )


def test_edges_that_become_shorter_multiply_the_vertices(tmp_path: Path) -> None:
    motion = shot_of(tmp_path, "rotation: {speed: 5}", edge="{keys: {1: 0.2, 30: 0.1}}").motion
    rest = motion.mesh_at_rest()
    *_, last = MotionForecast(motion).growth(rest.vertices, rest.faces, 1000)
    assert last.vertices == pytest.approx(4000, rel=1e-3)


def test_a_runaway_is_warned_of_with_the_flow_and_what_lowers_it(tmp_path: Path) -> None:
    def warning(flow: str) -> str:
        motion = shot_of(tmp_path, flow, edge=0.03).motion
        rest = motion.mesh_at_rest()
        found = MotionForecast(motion).growth_warning(rest.vertices, rest.faces, len(rest.vertices))
        return "" if found is None else str(found)

    said = warning("spiral_vortex: {strength: 200}")
    assert "times those of the first; flows.1 spiral_vortex stretches most. " in said
    assert "lower strength" in said and "resample.max_growth" in said
    assert warning("spiral_vortex: {strength: 2}") == ""


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
