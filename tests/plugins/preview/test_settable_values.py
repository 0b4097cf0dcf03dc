"""Values that an editor shows of a shot file: all that can be keyed, and the times of flows."""

from __future__ import annotations

import typing
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from flowsculpt.pipeline.plugins.preview.settable_values import SECTIONS, SettableShot, settable_values
from flowsculpt.pipeline.shot.documents.curves import Keyed, OverTime, OverTimeTriple
from flowsculpt.pipeline.shot.documents.shot_documents import ShotDocument
from tests.needed_plugins import needs_plugins

SHOT = """\
title: Times
frames: 1-6
subjects:
  ring:
    solid: torus
    radius: 1
    flows:
      - repeated: {period: 3, flows: [{twist: {axis: y, amount: {keys: {1: 0, 3: 30}}}}]}
  motes: {cloud: {solid: icosphere}, count: 10, radius: 0.1}
resample: {max_edge_length: 0.3}
flows:
  - reversed:
      flows:
        - placed: {translate: [1, 0, 0], flows: [{vortex: {strength: {keys: {1: 0, 6: 1}}}}]}
  - vortex: {strength: 1}
"""


def listed(text: str) -> SettableShot:
    return settable_values(Path("T010_times.yaml"), text)


def can_be_keyed(kind: Any, seen: set[Any]) -> bool:
    """Tell whether keys can stand somewhere in a value of an annotation."""
    if isinstance(kind, type):
        if issubclass(kind, Keyed | OverTime | OverTimeTriple):
            return True
        if kind in seen or not issubclass(kind, BaseModel):
            return False
        seen.add(kind)
        return any(can_be_keyed(field.annotation, seen) for field in kind.model_fields.values())
    return any(can_be_keyed(part, seen) for part in typing.get_args(kind))


def test_every_entry_of_a_shot_that_can_hold_keys_is_listed() -> None:
    keyed = {
        name for name, field in ShotDocument.model_fields.items() if can_be_keyed(field.annotation, set())
    }
    assert {"flows", "subjects", "camera"} <= keyed <= set(SECTIONS)


@needs_plugins("points")
def test_looks_and_rigs_that_the_show_names_are_proposed_with_the_others() -> None:
    named = "looks: {ink: {material: glaze}}\nrigs: {duotone: {exposure: 1}}\nlook: ink\nlights: studio\n"
    names = {".".join(map(str, value.where)): value.names for value in listed(SHOT + named).values}
    assert {"ink", "clay"} <= set(names["look.material"]) and {"duotone", "studio"} <= set(names["lights"])


@needs_plugins("points")
def test_values_of_each_of_several_subjects_are_listed_by_their_paths_in_the_file() -> None:
    values = {".".join(map(str, value.where)): value for value in listed(SHOT).values}
    assert values["subjects.ring.radius"].value == 1
    curve = values["subjects.ring.flows.0.repeated.flows.0.twist.amount"].curve
    assert curve is not None and [key["frame"] for key in curve.keys] == [1, 3]
    assert values["subjects.motes.radius"].form == "number"


@needs_plugins("points")
@pytest.mark.parametrize(
    ("speed", "shot", "backwards", "rounds"),
    [
        (1, None, [6, 5, 4, 3, 2, 1], [1, 2, 3, 1, 2, 3]),
        (2, [1, 3, 5, 7, 9, 11], [6, 4, 2, 0, -2, -4], [1, 3, 2, 1, 3, 2]),
    ],
)
def test_flows_have_their_own_time_by_speed_backwards_and_in_rounds(
    speed: float, shot: list[float] | None, backwards: list[float], rounds: list[float]
) -> None:
    frames = listed(f"{SHOT}speed: {speed}\n").flow_frames
    assert frames.get(("flows",)) == frames.get(("subjects", "motes", "flows")) == shot
    assert frames["flows", 0, "reversed"] == backwards
    assert frames["subjects", "ring", "flows", 0, "repeated"] == rounds


@needs_plugins("points")
def test_a_curve_is_sampled_as_far_as_the_time_of_a_flow_goes() -> None:
    curves = {value.where: value.curve for value in listed(f"{SHOT}speed: 2\n").values}
    curve = curves["flows", 0, "reversed", "flows", 0, "placed", "flows", 0, "vortex", "strength"]
    assert curve is not None and curve.frames[0] <= -4 and curve.frames[-1] >= 11
