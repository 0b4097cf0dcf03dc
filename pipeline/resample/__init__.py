"""Adaptive resampling of a surface in flow (Reynolds 1991)."""

from pipeline.resample.placement import Chord, Curved, Exact, Placement
from pipeline.resample.polygon_resampler import PolygonResampler, polygon_resampler
from pipeline.resample.resample_pass import PolyhedralReport, Report
from pipeline.resample.resampler import Resampler, resample
from pipeline.resample.thresholds import (
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
