"""Flows: mappings of points into points, their composition and their keyframes."""

from pipeline.flow.composition import (
    Blend,
    Mirror,
    Placed,
    Repeated,
    Reversed,
    Sequence,
    Sum,
    Transform,
    Within,
)
from pipeline.flow.flow import Displacement, Flow, Function, as_flow
from pipeline.flow.flow_map import checked_displacement
from pipeline.flow.keyframes import EASINGS, Keyframes, keyed
from pipeline.flow.parameters import Curve
from pipeline.flow.streamlines import Streamlines
from pipeline.flow.velocity import VelocityField

__all__ = [
    "EASINGS",
    "Blend",
    "Curve",
    "Displacement",
    "Flow",
    "Function",
    "Keyframes",
    "Mirror",
    "Placed",
    "Repeated",
    "Reversed",
    "Sequence",
    "Streamlines",
    "Sum",
    "Transform",
    "VelocityField",
    "Within",
    "as_flow",
    "checked_displacement",
    "keyed",
]
