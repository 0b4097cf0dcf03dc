"""Flows made of flows: an algebra whose terms are values.

Velocity fields compose to velocity fields, which are followed by one integration; maps compose to maps. What
weighs a field weighs its velocity, what weighs a map weighs the way a point goes in a step.
"""

from pipeline.flow.compose.blend import Blend, Within, blended, placed, within
from pipeline.flow.compose.fields import InFrame, Limited, Scaled, Sum
from pipeline.flow.compose.order import Repeated, Reversed, Sequence
from pipeline.flow.compose.space import Frame, Mirror, Placed

__all__ = [
    "Blend",
    "Frame",
    "InFrame",
    "Limited",
    "Mirror",
    "Placed",
    "Repeated",
    "Reversed",
    "Scaled",
    "Sequence",
    "Sum",
    "Within",
    "blended",
    "placed",
    "within",
]
