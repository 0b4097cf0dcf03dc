"""Compositions in shot files: what they become, and what bad ones are told."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.flow import (
    Blend,
    Flow,
    Repeated,
    Reversed,
    Sequence,
    Streamlines,
    Sum,
    Transform,
    Within,
    keyed,
)
from flowsculpt.pipeline.flow.catalogue.basic import Rotation
from flowsculpt.pipeline.flow.catalogue.deformations import Twist
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.flow.composition import Mirror, RegionField, ScaledField, TransformedField
from flowsculpt.pipeline.flow.regions import (
    BoxRegion,
    CapsuleRegion,
    CylinderRegion,
    HalfSpaceRegion,
    Region,
    SphereRegion,
)
from flowsculpt.pipeline.shot import read_shot

SHOT = """\
title: Composed
frames: 1-49
subject: {{solid: box}}
resample: {{max_edge_length: 0.25}}
flows:
{}
"""

TWIST = Twist(amount=keyed((0.0, 2.0), (0.0, math.radians(60))))


def flows_of(entries: str) -> tuple[Flow, ...]:
    flow: Any = read_shot("a.yaml", SHOT.format(entries)).motion.flow
    assert isinstance(flow, Sequence)
    return flow.flows


def told(entry: str) -> list[str]:
    with pytest.raises(ShotError) as error:
        flows_of(f"  - {entry}")
    return list(error.value.messages)


def test_a_flow_within_a_region_is_weighed_by_its_kind() -> None:
    (flow,) = flows_of(
        """\
  - within:
      region: {sphere: {centre: [0, 1, 0], radius: 0.5}, falloff: 0.3}
      flows:
        - vortex: {strength: 2}
        - twist: {amount: {keys: {1: 0, 49: 60}}}
"""
    )
    ball = SphereRegion(centre=(0.0, 1.0, 0.0), radius=0.5, falloff=0.3)
    assert flow == Sequence((Streamlines(RegionField(Vortex(strength=2.0), ball)), Within(TWIST, ball)))


REGIONS: list[tuple[str, Region]] = [
    ("{box: {size: [1, 2, 3]}, invert: true}", BoxRegion(size=(1.0, 2.0, 3.0), invert=True)),
    ("{half_space: {normal: [0, 1, 1], centre: [0, 1, 0]}, falloff_type: sine, falloff: 0.5}",
     HalfSpaceRegion((0.0, 1.0, 0.0), (0.0, 1.0, 1.0), falloff=0.5, falloff_type="sine")),
    ("{capsule: {axis: x, length: 2, radius: 0.5}}", CapsuleRegion((1.0, 0.0, 0.0), length=2.0, radius=0.5)),
    ("{cylinder: {length: 2, radius: 0.5}, falloff_type: linear}",
     CylinderRegion(length=2.0, radius=0.5, falloff_type="linear")),
    ("{sphere: {radius: {keys: {1: 1, 49: 2}}}, falloff: {keys: {1: 0, 49: 2}}}",
     SphereRegion(radius=keyed((0.0, 2.0), (1.0, 2.0)), falloff=keyed((0.0, 2.0), (0.0, 2.0)))),
]  # fmt: skip


@pytest.mark.parametrize(("text", "region"), REGIONS, ids=[text[:20] for text, _ in REGIONS])
def test_every_region_has_its_words(text: str, region: Region) -> None:
    entry = f"  - within: {{region: {text}, flows: [{{rotation: {{speed: 90}}}}]}}"
    (flow,) = flows_of(entry)
    assert flow == Sequence((Streamlines(RegionField(Rotation(speed=math.radians(90)), region)),))


def test_frames_and_mirrors_nest() -> None:
    (flow,) = flows_of(
        """\
  - mirrored:
      normal: x
      centre: [0.5, 0, 0]
      flows:
        - placed:
            rotate: {keys: {1: [0, 0, 0], 49: [0, 90, 0]}}
            scale: 2
            flows: [{vortex: {strength: 2}}]
"""
    )
    turning = Transform(rotate=keyed((0.0, 2.0), ((0.0, 0.0, 0.0), (0.0, math.radians(90), 0.0))), scale=2.0)
    field = TransformedField(
        TransformedField(Vortex(strength=2.0), turning), Mirror((1.0, 0.0, 0.0), (0.5, 0.0, 0.0))
    )
    assert flow == Sequence((Sequence((Streamlines(field),)),))


def test_fields_are_blended_to_a_field_and_maps_to_a_map() -> None:
    weight = keyed((0.0, 2.0), (0.0, 1.0))
    fields, maps, alone = flows_of(
        """\
  - blend: {weight: {keys: {1: 0, 49: 1}}, flows: [{vortex: }, {sum: [{rotation: {speed: 90}}]}]}
  - blend: {weight: 0.5, flows: [{sequence: {flows: [{vortex: }, {vortex: }]}}, {vortex: }]}
  - blend: {weight: 0.5, flows: [{vortex: }]}
"""
    )
    turning = Sum((Rotation(speed=math.radians(90)),))
    assert fields == Streamlines(
        Sum((ScaledField(Vortex(), weight, rest=True), ScaledField(turning, weight)))
    )
    assert maps == Blend(Sequence((Streamlines(Vortex()),) * 2), Streamlines(Vortex()), 0.5)
    assert alone == Streamlines(Sum((ScaledField(Vortex(), 0.5),)))


def test_time_is_turned_and_repeated_in_frames_or_seconds() -> None:
    text = "flows: [{twist: {amount: {keys: {1: 0, 49: 60}}}}]"
    there, back, again, often = flows_of(
        f"  - reversed: {{duration: 24, {text}}}\n  - reversed: {{{text}}}\n"
        f"  - repeated: {{period: 1.5s, {text}}}\n  - repeated: {{period: 12, {text}}}\n"
    )
    inner = Sequence((TWIST,))
    assert (there, back) == (Reversed(inner, 1.0), Reversed(inner, 2.0))
    assert (again, often) == (Repeated(inner, 1.5), Repeated(inner, 0.5))


def test_under_sum_everything_acts_at_once() -> None:
    (flow,) = flows_of(
        """\
  - sum:
      - vortex:
      - within:
          region: {sphere: {radius: 1}, falloff: 0.5}
          flows: [{rotation: {speed: 90}}, {mirrored: {flows: [{vortex: }]}}]
      - blend: {weight: 0.25, flows: [{vortex: }, {placed: {scale: 2, flows: [{vortex: }]}}]}
"""
    )
    assert isinstance(flow, Streamlines)
    points = np.random.default_rng(1).normal(size=(50, 3))
    inner = Rotation(speed=math.radians(90)).velocity(points, 0.0) + TransformedField(
        Vortex(), Mirror()
    ).velocity(points, 0.0)
    plain, large = (
        Vortex().velocity(points, 0.0),
        TransformedField(Vortex(), Transform(scale=2.0)).velocity(points, 0.0),
    )
    weights = SphereRegion(radius=1.0, falloff=0.5).weight(points, 0.0)[:, None]
    expected = plain + weights * inner + 0.75 * plain + 0.25 * large
    np.testing.assert_allclose(flow.field.velocity(points, 0.0), expected, atol=1e-14)


BAD = [
    ("within: {region: {sphere: {radius: 0}}, flows: [{vortex: }]}",
     ["6:32: flows.0.within.region.sphere.radius: 0 is out of range; it must be above 0"]),
    ("within: {region: {box: {size: [1, 0, 1]}}, flows: [{vortex: }]}",
     ["6:39: flows.0.within.region.box.size.1: 0 is out of range; it must be above 0"]),
    ("within: {region: {sphere: {radius: {keys: {1: 1, 9: 0}}}}, flows: [{vortex: }]}",
     ["6:54: flows.0.within.region.sphere.radius.keys.9: 0 is out of range; it must be above 0"]),
    ("within: {region: {sphere: {radius: 1}, falloff: -1}, flows: []}",
     ["6:44: flows.0.within.region.falloff: -1 is out of range; it must be at least 0",
      "6:58: flows.0.within.flows: empty; it must have at least 1 item"]),
    ("within: {region: {falloff: 1}, flows: [{votex: }]}",
     ["6:14: flows.0.within.region: a region is one of sphere, box, half_space, capsule, cylinder, mesh, "
      "and this has none. Write one, such as {sphere: {radius: 1}}.",
      "6:45: flows.0.within.flows.0.votex: unknown name. Did you mean 'vortex'?"]),
    ("within: {region: {sphere: }, flows: [{vortex: }]}",
     ["6:14: flows.0.within.region: sphere is empty. Write {sphere: {radius: 1}}."]),
    ("within: {region: {sphere: {radius: 1}, falloff_type: smoth}, flows: [{vortex: }]}",
     ["6:44: flows.0.within.region.falloff_type: 'smoth' is not a falloff type. Did you mean 'smooth'?"]),
    ("within: {region: {sphere: {radius: 1}, fall: sine}, flows: [{vortex: }]}",
     ["6:44: flows.0.within.region.fall: unknown name. Did you mean 'falloff'?"]),
    ("within: {region: {half_space: {normal: [0, 0, 0]}}, flows: [{vortex: }]}",
     ["6:36: normal [0, 0, 0] has no direction. Write x, y, z or a vector."]),
    ("blend: {weight: 1.5, flows: [{vortex: }]}",
     ["6:13: flows.0.blend.weight: 1.5 is out of range; it must be at most 1"]),
    ("blend: {weight: 1, flows: [{vortex: }, {vortex: }, {vortex: }]}",
     ["6:24: flows.0.blend.flows: 3 items; it must have at most 2 items"]),
    ("blend: {weight: {ease: back_out, keys: {1: 0, 40: 1}}, flows: [{vortex: }]}",
     ["6:13: flows.0.blend.weight: 1.002 at frame 15.5 is out of range; it must stay "
      "from 0 to 1"]),
    ("repeated: {period: 0, flows: [{vortex: }]}",
     ["6:16: flows.0.repeated.period: 0 is not a duration. "
      "Write frames, such as 24, or seconds, such as 1s."]),
    ("repeated: {period: 2 sec, flows: [{vortex: }]}",
     ["6:16: flows.0.repeated.period: '2 sec' is not a duration. "
      "Write frames, such as 24, or seconds, such as 1s."]),
    ("placed: {scale: 0, flows: [{vortex: }]}",
     ["6:14: flows.0.placed.scale: 0 is out of range; it must be above 0"]),
    ("mirrored: {normal: w, flows: [{vortex: }]}",
     ["6:16: flows.0.mirrored.normal: 'w' is not an axis. There are: x, y, z."]),
    ("within: {reion: {}, flows: {vortex: }}",
     ["6:14: flows.0.within.reion: unknown name. Did you mean 'region'?",
      "6:25: flows.0.within.flows: each flow begins with a dash. Write - vortex:."]),
    ("reversed:", ["6:5: flows.0.reversed.flows: missing; it has no default"]),
    ("sum:", ["6:5: flows.0.sum: empty; it must have at least 1 item"]),
]  # fmt: skip


@pytest.mark.parametrize(("entry", "messages"), BAD, ids=[entry[:60] for entry, _ in BAD])
def test_a_mistake_in_a_composition_is_told_with_its_place(entry: str, messages: list[str]) -> None:
    assert told(entry) == [f"a.yaml:{message}" for message in messages]


@pytest.mark.parametrize("name", ["repeated", "reversed", "sequence", "twist"])
def test_under_sum_stand_velocity_fields_alone(name: str) -> None:
    (message,) = told(f"sum: [{{{name}: }}]")
    assert message.startswith(f"a.yaml:6:11: {name} is not a velocity field, and only those add up. ")


def test_a_key_in_a_composition_leaves_the_frames_before_it_alone() -> None:
    def motion(weight: float, radius: float) -> Any:
        entries = f"""\
  - blend: {{weight: {{keys: {{1: 0, 25: 1, 33: {weight}}}}}, flows: [{{vortex: }}]}}
  - within:
      region: {{sphere: {{radius: {{keys: {{1: 0.5, 37: 1, 45: {radius}}}}}}}, falloff: 0.5}}
      flows: [{{placed: {{flows: [{{twist: {{amount: {{keys: {{1: 0, 49: 60}}}}}}}}]}}}}]
"""
        return read_shot("a.yaml", SHOT.format(entries)).motion

    before, faded, grown = motion(1.0, 1.0), motion(0.5, 1.0), motion(1.0, 2.0)
    for frame in range(2, 50):
        assert (before.step_data(frame) == faded.step_data(frame)) == (frame <= 25)
        assert (before.step_data(frame) == grown.step_data(frame)) == (frame <= 37)
