"""Names of flows, and the modules that `__init__.py` imports them from when they are first used."""

from flowsculpt.pipeline.flow.composition import Blend as Blend
from flowsculpt.pipeline.flow.composition import Mirror as Mirror
from flowsculpt.pipeline.flow.composition import Placed as Placed
from flowsculpt.pipeline.flow.composition import Repeated as Repeated
from flowsculpt.pipeline.flow.composition import Reversed as Reversed
from flowsculpt.pipeline.flow.composition import Sequence as Sequence
from flowsculpt.pipeline.flow.composition import Sum as Sum
from flowsculpt.pipeline.flow.composition import Transform as Transform
from flowsculpt.pipeline.flow.composition import Within as Within
from flowsculpt.pipeline.flow.easings import EASINGS as EASINGS
from flowsculpt.pipeline.flow.flow import Displacement as Displacement
from flowsculpt.pipeline.flow.flow import Flow as Flow
from flowsculpt.pipeline.flow.flow import Function as Function
from flowsculpt.pipeline.flow.flow import as_flow as as_flow
from flowsculpt.pipeline.flow.flow_map import checked_displacement as checked_displacement
from flowsculpt.pipeline.flow.keyframes import Keyframes as Keyframes
from flowsculpt.pipeline.flow.keyframes import keyed as keyed
from flowsculpt.pipeline.flow.parameters import Curve as Curve
from flowsculpt.pipeline.flow.streamlines import Streamlines as Streamlines
from flowsculpt.pipeline.flow.velocity import VelocityField as VelocityField
