"""Adaptive resampling of a surface in flow (Reynolds 1991)."""

from pipeline.resample.creases import WithinBall, WithinBox, edges_by_angle, edges_in_region
from pipeline.resample.placement.base import Chord, Curved, Placement
from pipeline.resample.placement.exact import Exact
from pipeline.resample.polyhedra import PolyhedralReport, PolyhedralResampler
from pipeline.resample.report import Report
from pipeline.resample.resampler import Resampler, resample
from pipeline.resample.sizing_field import Curvature, DistanceToCamera, Formula
from pipeline.resample.thresholds import Thresholds

__all__ = [
    "Chord",
    "Curvature",
    "Curved",
    "DistanceToCamera",
    "Exact",
    "Formula",
    "Placement",
    "PolyhedralReport",
    "PolyhedralResampler",
    "Report",
    "Resampler",
    "Thresholds",
    "WithinBall",
    "WithinBox",
    "edges_by_angle",
    "edges_in_region",
    "resample",
]
