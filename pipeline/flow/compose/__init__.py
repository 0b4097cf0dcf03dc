"""Flows made of flows: an algebra whose terms are values.

Velocity fields compose to velocity fields, which one integration follows; maps compose to maps. A weight on a
field scales its velocity, a weight on a map scales the displacement of a step.
"""

from pipeline.flow.compose.fields import (
    Blend,
    RegionField,
    ScaledField,
    Sum,
    TransformedField,
    Within,
    blended,
    placed,
    within,
)
from pipeline.flow.compose.maps import Mirror, Placed, Repeated, Reversed, Sequence, Transform

__all__ = [
    "Blend",
    "Mirror",
    "Placed",
    "RegionField",
    "Repeated",
    "Reversed",
    "ScaledField",
    "Sequence",
    "Sum",
    "Transform",
    "TransformedField",
    "Within",
    "blended",
    "placed",
    "within",
]
