"""Flows: mappings of points into points, and how they are composed and choreographed."""

from pipeline.flow.choreography import Keyframes, keyed
from pipeline.flow.compose import Reversed, Sequence, Sum
from pipeline.flow.easing import EASINGS
from pipeline.flow.flow import Displacement, Flow, Function, as_flow
from pipeline.flow.guard import displaced
from pipeline.flow.velocity import Streamlines, VelocityField

__all__ = [
    "EASINGS",
    "Displacement",
    "Flow",
    "Function",
    "Keyframes",
    "Reversed",
    "Sequence",
    "Streamlines",
    "Sum",
    "VelocityField",
    "as_flow",
    "displaced",
    "keyed",
]
