"""`flowsculpt flows` and the table of the docs list all flows."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.authoring.shot_schemas import BEGIN, END, default_text, facts, markdown
from tests.needed_plugins import SHIPPED, needs_plugins

DOCS = Path(__file__).parents[3] / "docs"


def test_a_flow_can_be_asked_for_by_name() -> None:
    fact = facts("vortex")
    assert json.loads(json.dumps(fact)) == fact
    assert fact["kind"] == "velocity" and facts("twist")["kind"] == "map"
    strength = next(p for p in fact["parameters"] if p["name"] == "strength")
    assert (strength["unit"], strength["default"], strength["keyed"]) == ("units²/s", 1.0, True)
    with pytest.raises(UsageError, match=r"'vortx' is not a flow\. Did you mean 'vortex'"):
        facts("vortx")


@needs_plugins(*SHIPPED)
def test_the_table_of_the_docs_is_that_of_the_code() -> None:
    page = (DOCS / "flows.md").read_text("utf-8")
    assert page[page.index(BEGIN) : page.index(END) + len(END)] == markdown()
    for picture in re.findall(r"\((pictures/\S+)\)", markdown()):
        assert (DOCS / picture).is_file()


@needs_plugins("fields", "python")
def test_flows_of_a_shots_own_making_are_listed_too() -> None:
    through, speed, *_ = facts("wind")["parameters"]
    assert (through["name"], through["unit"], through["required"]) == ("through", "units", True)
    assert (speed["name"], speed["keyed"], speed["default"]) == ("speed", True, 1.0)
    kinds = [facts(name)["kind"] for name in ("formula", "curl_noise", "python")]
    assert kinds == ["velocity", "velocity", "function"]
    mesh = next(p for p in facts("attraction")["parameters"] if p["name"] == "mesh")
    assert not mesh["required"] and mesh["default"] is None and default_text(mesh) == "none"
