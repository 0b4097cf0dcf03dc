"""Flows: their parameters, kernels and steps; the flows themselves are in `flowsculpt`."""

from flowsculpt.pipeline.animation.motion_forecast import MotionForecast as MotionForecast
from flowsculpt.pipeline.flow.catalogue.sampled_field import Sampled as Sampled
from flowsculpt.pipeline.flow.catalogue.sampled_field import Samples as Samples
from flowsculpt.pipeline.flow.flow_map import FlowMap as FlowMap
from flowsculpt.pipeline.flow.keyframes import Keyframes as Keyframes
from flowsculpt.pipeline.flow.parameters import Number as Number
from flowsculpt.pipeline.flow.parameters import ParameterDoc as ParameterDoc
from flowsculpt.pipeline.flow.parameters import PositiveNumber as PositiveNumber
from flowsculpt.pipeline.flow.parameters import VectorParameter as VectorParameter
from flowsculpt.pipeline.flow.parameters import number_at as number_at
from flowsculpt.pipeline.flow.parameters import vector_at as vector_at
from flowsculpt.pipeline.flow.regions import TriangleTree as TriangleTree
from flowsculpt.pipeline.flow.velocity import ExternalField as ExternalField
from flowsculpt.pipeline.flow.velocity import StableProperty as StableProperty
from flowsculpt.pipeline.formula import Expression as Expression
from flowsculpt.pipeline.kernels import block_kernel as block_kernel
from flowsculpt.pipeline.kernels import generated_kernel as generated_kernel
from flowsculpt.pipeline.kernels import kernel as kernel
