"""Documents, list and docs of the flows are made from the flows, and agree with them."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.flow import Flow, VelocityField
from flowsculpt.pipeline.flow.catalogue.deformations import Bend
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex, VortexRing
from flowsculpt.pipeline.flow.parameters import parameters_of, shot_name, summary
from flowsculpt.pipeline.flow.velocity import PluginField
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.documents.flow_documents import FLOW_DOCUMENTS
from flowsculpt.pipeline.shot.motion import Clock
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext

CLOCK = Clock(FrameRange.parse("1-24"), FrameRate.of(24))
each = pytest.mark.parametrize("name", FLOW_DOCUMENTS)

SHOT = """\
title: Any
frames: 1-24
subject: {{solid: box}}
resample: {{max_edge_length: 0.25}}
flows:
  - {flow}
"""


def built(flow: str) -> Any:
    """The flow of a shot with one."""
    return read_shot("a.yaml", SHOT.format(flow=flow)).motion.flow.flows[0]  # type: ignore[attr-defined]


def told(flow: str) -> str:
    with pytest.raises(ShotError) as error:
        built(flow)
    return str(error.value)


def needed(name: str, folder: Path) -> dict[str, Any]:
    """The least that a shot has to say of a flow."""
    (folder / "mine.py").touch()
    axis = np.linspace(-1, 1, 3)
    np.savez(folder / "w.npz", x=axis, y=axis, z=axis, velocity=np.ones((3, 3, 3, 3)))
    own: dict[str, dict[str, Any]] = {
        "formula": {"velocity": ["-y", "x", 0]},
        "attraction": {"points": [[0.0, 0.0, 0.0]]},
        "wind": {"through": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]},
        "sampled": {"file": "w.npz"},
        "become": {"solid": "icosphere"},
        "lag": {"seconds": 0.2},
        "python": {"file": "mine.py", "function": "swirl"},
    }
    parameters = FLOW_DOCUMENTS[name].parameters
    return own.get(name, {}) | {
        p.name: [0.5, 0.0, 0.0] if p.form == "vector" else 0.5 for p in parameters if p.needed
    }


def parsed(name: str, said: dict[str, Any], folder: Path) -> Any:
    document = FLOW_DOCUMENTS[name].model_validate(said, context={"parse_context": ParseContext(folder)})
    return document.build(CLOCK)


@each
def test_a_file_that_says_the_least_has_the_defaults_of_the_code(name: str, tmp_path: Path) -> None:
    flow = parsed(name, needed(name, tmp_path), tmp_path)
    flow = flow.field if isinstance(flow, PluginField) else flow
    for parameter in FLOW_DOCUMENTS[name].parameters:
        if not parameter.needed:
            assert getattr(flow, parameter.name) == parameter.default
    assert isinstance(flow, Flow | VelocityField)


@each
def test_every_parameter_says_what_it_means(name: str) -> None:
    flow = FLOW_DOCUMENTS[name].flow
    assert summary(flow).endswith(".") and len(summary(flow)) < 100
    for parameter in (*parameters_of(flow), *FLOW_DOCUMENTS[name].own):
        assert parameter.doc.text, parameter.name
        assert parameter.form != "choice" or parameter.choices
    assert "other" not in {parameter.form for parameter in parameters_of(flow)}
    if not FLOW_DOCUMENTS[name].own:
        assert {p.name for p in parameters_of(flow)} == {field.name for field in dataclasses.fields(flow)}


@each
def test_defaults_written_out_in_a_file_build_the_same_flow(name: str, tmp_path: Path) -> None:
    least = needed(name, tmp_path)
    everything = {
        p.name: p.default_in_file for p in (*FLOW_DOCUMENTS[name].parameters, *FLOW_DOCUMENTS[name].own)
    }
    spelt, short = parsed(name, everything | least, tmp_path), parsed(name, least, tmp_path)
    for field in dataclasses.fields(spelt):
        one, other = getattr(spelt, field.name), getattr(short, field.name)
        assert one == pytest.approx(other, rel=1e-9) if isinstance(one, float) else one == other


def test_angles_are_degrees_in_the_file_and_radians_in_the_code() -> None:
    bend = built("bend: {amount: {ease: linear, keys: {1: 0, 24: 90}}, length: 3}")
    assert isinstance(bend, Bend) and bend.length == 3.0
    assert bend.amount.at(CLOCK.time(24))[0] == pytest.approx(math.pi / 2)  # type: ignore[union-attr]


def test_names_of_two_words_are_joined() -> None:
    assert shot_name(VortexRing) == "vortex_ring" and built("vortex_ring: {core: 0.2}").name == "vortex_ring"
    assert "ABC" not in FLOW_DOCUMENTS and "abc" in FLOW_DOCUMENTS


def test_a_flow_that_is_not_known_is_told_with_the_nearest() -> None:
    assert told("vortex_rng: {}") == (
        "a.yaml:6:5: flows.0.vortex_rng: unknown name. Did you mean 'vortex_ring'?"
    )


@pytest.mark.parametrize(
    ("flow", "message"),
    [
        (
            "vortex_ring: {radius: 0}",
            "a.yaml:6:19: flows.0.vortex_ring.radius: 0 is out of range; it must be above 0",
        ),
        (
            "vortex_ring: {cor: 0.1}",
            "a.yaml:6:19: flows.0.vortex_ring.cor: unknown name. Did you mean 'core'?",
        ),
        (
            "scaling: {}",
            "a.yaml:6:5: flows.0.scaling.rate: missing; it has no default",
        ),
        (
            "vortex_pair: {turning: both}",
            "a.yaml:6:19: flows.0.vortex_pair.turning: 'both' is not allowed; it must be 'against' "
            "or 'together'",
        ),
        (
            "bend: {amount: 3, direction: y}",
            "a.yaml:6:5: bend is turned along its own axis; direction must lie across axis. "
            "Turn one of them.",
        ),
    ],
)
def test_mistakes_are_told_with_line_and_column(flow: str, message: str) -> None:
    assert told(flow) == message


def test_a_document_refuses_what_the_flow_does_not_take() -> None:
    assert set(FLOW_DOCUMENTS["vortex"].model_fields) == set(Vortex.__dataclass_fields__)
