"""Compositions of anything: what is made of velocity fields becomes one field, everything else a map.

A sequence is composed flow by flow, so that each of its fields keeps its integration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from pipeline.flow.choreography import Number
from pipeline.flow.compose.blend import Blend, Within
from pipeline.flow.compose.fields import InFrame, Limited, Scaled, Sum
from pipeline.flow.compose.order import Sequence
from pipeline.flow.compose.space import Frame, Mirror, Placed
from pipeline.flow.flow import Flow
from pipeline.flow.regions import Region
from pipeline.flow.velocity import Streamlines, VelocityField


def within(flow: Flow, region: Region) -> Flow:
    """A flow within a region: velocities are weighed where there are any, else the way of a step."""
    return _composed(flow, lambda field: Limited(field, region), lambda other: Within(other, region))


def placed(flow: Flow, frame: Frame | Mirror) -> Flow:
    """A flow in a frame, or in a mirror."""
    return _composed(flow, lambda field: InFrame(field, frame), lambda other: Placed(other, frame))


def blended(first: Flow, second: Flow, weight: Number) -> Flow:
    """Between two flows: of velocities where each is a velocity field or nothing, else of ways."""
    one, other = _only(first), _only(second)
    fields = [
        Scaled(flow.field, weight, rest)
        for flow, rest in ((one, True), (other, False))
        if isinstance(flow, Streamlines)
    ]
    if not fields or not all(flow is None or isinstance(flow, Streamlines) for flow in (one, other)):
        return Blend(first, second, weight)
    sum_of = Sum(tuple(fields))
    joined = {replace(flow, field=sum_of) for flow in (one, other) if isinstance(flow, Streamlines)}
    return joined.pop() if len(joined) == 1 else Blend(first, second, weight)


def _only(flow: Flow) -> Flow | None:
    """The one flow that it is, None for nothing."""
    if isinstance(flow, Sequence) and len(flow.flows) < 2:
        return _only(flow.flows[0]) if flow.flows else None
    return flow


def _composed(
    flow: Flow, field: Callable[[VelocityField], VelocityField], other: Callable[[Flow], Flow]
) -> Flow:
    if isinstance(flow, Sequence):
        return Sequence(tuple(_composed(part, field, other) for part in flow.flows))
    if isinstance(flow, Streamlines):
        return replace(flow, field=field(flow.field))
    return other(flow)
