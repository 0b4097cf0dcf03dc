"""The growth of a surface: forecast before it is simulated, and warned of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.plugins.authoring import growth_forecast
from flowsculpt.pipeline.plugins.authoring.growth_forecast import GrowthForecast
from tests.animation.test_growth import WINDING, shot_of
from tests.conftest import ProjectFolder
from tests.needed_plugins import needs_plugins


@pytest.mark.slow
@pytest.mark.parametrize(
    "flow",
    ["strain: {rate: 0.7}", "curl_noise: {strength: 0.4, octaves: 1}", "expansion: {rate: 0.5, radius: 3}"],
)
def test_the_largest_frame_is_forecast_within_a_factor_of_two(flow: str, tmp_path: Path) -> None:
    motion = shot_of(tmp_path, flow, edge=0.3).motion
    counts = {frame.number: len(frame.mesh.vertices) for frame in animate(motion)}
    rest = motion.mesh_at_rest()
    forecasts = list(GrowthForecast(motion, rest.vertices, rest.faces, counts[1]).frames())
    assert [forecast.frame for forecast in forecasts] == list(range(2, 31))
    assert max(counts.values()) > 1.2 * counts[1]
    assert 0.5 < max(forecast.vertices for forecast in forecasts) / max(counts.values()) < 2.0
    assert forecasts[-1].place == "flows.1" and flow.startswith(forecasts[-1].flow)


def test_faces_that_are_lines_grow_nothing(tmp_path: Path) -> None:
    motion = shot_of(tmp_path, WINDING).motion
    along = np.array([0.9, 0.3, 0.17])
    line = np.array([0.0 * along, 0.3 * along, along])
    assert list(GrowthForecast(motion, line, np.array([[0, 1, 2]]), 3).frames()) == []
    beside = np.vstack([line, [[0.0, 1.0, 0.0]]])
    for faces in ([[0, 1, 2], [0, 2, 3]], [[0, 2, 3], [0, 1, 2]]):
        forecast = GrowthForecast(motion, beside, np.array(faces), 4)
        assert all(growth.times < 100.0 for growth in forecast.frames())


def test_edges_that_become_shorter_multiply_the_vertices(tmp_path: Path) -> None:
    motion = shot_of(tmp_path, "rotation: {speed: 5}", edge="{keys: {1: 0.2, 30: 0.1}}").motion
    rest = motion.mesh_at_rest()
    *_, last = GrowthForecast(motion, rest.vertices, rest.faces, 1000).frames()
    assert last.vertices == pytest.approx(4000, rel=1e-3)


def test_a_runaway_is_warned_of_with_the_flow_and_what_lowers_it(tmp_path: Path) -> None:
    def warning(flow: str) -> str:
        motion = shot_of(tmp_path, flow, edge=0.03).motion
        rest = motion.mesh_at_rest()
        found = GrowthForecast(motion, rest.vertices, rest.faces, len(rest.vertices)).warning()
        return "" if found is None else found[1]

    said = warning("spiral_vortex: {strength: 200}")
    assert "times those of the first; flows.1 spiral_vortex stretches most. " in said
    assert "lower strength" in said and "resample.max_growth" in said
    assert warning("spiral_vortex: {strength: 2}") == ""


@needs_plugins("preview")
def test_preview_warns_of_it_before_it_simulates(
    project: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(growth_forecast, "MANY_VERTICES", 0)
    monkeypatch.setattr(growth_forecast, "RUNAWAY", 0.0)
    done = project.call("preview", "T010_tiny", "--at", "2")
    assert done.code == 0 and "T010_tiny: frame 2 takes about" in done.err
