"""Adaptive resampling of a surface in flow (Reynolds 1991)."""

from pipeline.resample.placement import Chord, Placement
from pipeline.resample.report import Report
from pipeline.resample.resampler import Resampler, resample
from pipeline.resample.thresholds import Thresholds

__all__ = ["Chord", "Placement", "Report", "Resampler", "Thresholds", "resample"]
