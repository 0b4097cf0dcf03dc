"""Adaptive resampling of a surface in flow (Reynolds 1991)."""

from flowsculpt.pipeline.resample.placement import Chord, Curved, Exact, Placement
from flowsculpt.pipeline.resample.polygon_resampler import PolygonResampler, polygon_resampler
from flowsculpt.pipeline.resample.resample_pass import PolyhedralReport, Report
from flowsculpt.pipeline.resample.resampler import Resampler, resample
from flowsculpt.pipeline.resample.thresholds import (
    Curvature,
    DistanceToCamera,
    ThresholdFormula,
    Thresholds,
    WithinBall,
    WithinBox,
    edges_by_angle,
    edges_in_region,
)

__all__ = [
    "Chord",
    "Curvature",
    "Curved",
    "DistanceToCamera",
    "Exact",
    "Placement",
    "PolygonResampler",
    "PolyhedralReport",
    "Report",
    "Resampler",
    "ThresholdFormula",
    "Thresholds",
    "WithinBall",
    "WithinBox",
    "edges_by_angle",
    "edges_in_region",
    "polygon_resampler",
    "resample",
]
