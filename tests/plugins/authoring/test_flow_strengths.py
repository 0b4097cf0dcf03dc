"""Recorded strengths of flows."""

from __future__ import annotations

import pytest
from ruamel.yaml import YAML

from flowsculpt.pipeline.plugins.authoring.shot_templates import usual_strength
from tests.plugins.authoring.flow_strengths import GROWTHS, RECORD, growth_at, strength_of


@pytest.mark.slow
@pytest.mark.parametrize("flow", ["twist", "strain", "vortex"])
def test_recorded_strengths_of_flows_grow_a_ball_as_they_say(flow: str) -> None:
    recorded = usual_strength(flow)
    assert recorded is not None
    parameter, values = recorded
    for value, growth in zip(values, GROWTHS, strict=False):
        assert growth_at(flow, parameter, value) == pytest.approx(growth, rel=0.2)


@pytest.mark.soak
def test_strengths_of_all_flows_are_recorded() -> None:
    recorded = YAML(typ="safe").load(RECORD)
    for flow in recorded:
        assert strength_of(flow) == (next(iter(recorded[flow])), next(iter(recorded[flow].values())))
