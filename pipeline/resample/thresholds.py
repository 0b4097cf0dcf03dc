"""The three numbers that steer resampling."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pipeline.errors import UsageError

DEFAULT_RATIO = 0.4
"""Minimum over maximum edge length: the paper's compromise between thrashing and spread (P12)."""

HIGHEST_RATIO = 0.5
"""From here on a split makes edges that are at once too short (P13)."""


@dataclass(frozen=True, init=False)
class Thresholds:
    """The bracket for edge lengths and the angle that makes an edge hard.

    max_edge_length   scene units; afterwards no edge is longer (P8)
    min_edge_length   scene units; shorter edges collapse where they may (P9); 40% of the maximum by default
    hard_angle        radians between the normals of two faces; an edge that turns more is hard (P29); 40°
    max_vertices      a frame that would need more stops with an error instead of filling the memory

    Raises UsageError for numbers that cannot be.
    """

    max_edge_length: float
    min_edge_length: float
    hard_angle: float
    max_vertices: int

    def __init__(
        self,
        max_edge_length: float,
        min_edge_length: float | None = None,
        hard_angle: float = math.radians(40),
        max_vertices: int = 2_000_000,
    ) -> None:
        longest = float(max_edge_length)
        if not (math.isfinite(longest) and longest > 0):
            raise UsageError(f"max_edge_length {longest:g} must be a positive length in scene units")
        shortest = DEFAULT_RATIO * longest if min_edge_length is None else float(min_edge_length)
        if not shortest >= 0:
            raise UsageError(f"min_edge_length {shortest:g} must not be negative; 0 removes nothing")
        if shortest >= HIGHEST_RATIO * longest:
            raise UsageError(
                f"min_edge_length {shortest:g} is {shortest / longest:.0%} of max_edge_length {longest:g}; "
                f"it must be below 50%, or splitting and collapsing undo each other. "
                f"Try {DEFAULT_RATIO * longest:g}."
            )
        if not 0 < hard_angle <= math.pi:
            raise UsageError(
                f"hard_angle {hard_angle:g} must lie between 0 and pi radians; 0.7 (40 degrees) is usual"
            )
        if max_vertices < 4:
            raise UsageError(f"max_vertices {max_vertices} is too few for any surface; 2000000 is usual")
        object.__setattr__(self, "max_edge_length", longest)
        object.__setattr__(self, "min_edge_length", shortest)
        object.__setattr__(self, "hard_angle", float(hard_angle))
        object.__setattr__(self, "max_vertices", int(max_vertices))
