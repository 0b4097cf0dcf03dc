"""Flows: mappings of points into points, their composition and their keyframes."""

from flowsculpt.pipeline.flow.composition import (
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
from flowsculpt.pipeline.flow.flow import Displacement, Flow, Function, as_flow
from flowsculpt.pipeline.flow.flow_map import checked_displacement
from flowsculpt.pipeline.flow.keyframes import EASINGS, Keyframes, keyed
from flowsculpt.pipeline.flow.parameters import Curve
from flowsculpt.pipeline.flow.streamlines import Streamlines
from flowsculpt.pipeline.flow.velocity import VelocityField

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
