"""Adaptive resampling of a surface in flow (Reynolds 1991)."""

from pipeline.resample.placement import Chord, Curved, Exact, Placement
from pipeline.resample.polyhedra import PolyhedralReport, PolyhedralResampler
from pipeline.resample.resample_pass import Report
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
    "PolyhedralReport",
    "PolyhedralResampler",
    "Report",
    "Resampler",
    "ThresholdFormula",
    "Thresholds",
    "WithinBall",
    "WithinBox",
    "edges_by_angle",
    "edges_in_region",
    "resample",
]
