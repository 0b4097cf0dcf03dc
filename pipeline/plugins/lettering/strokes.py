"""Strokes of SVG as regions: lines with a width, caps and joins."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from flowsculpt.pipeline.plugins.lettering.outlines import PolylinePen

CAPS = {"butt": "flat", "round": "round", "square": "square"}
JOINS = {"round": "round", "bevel": "bevel"}

FINEST = 1e-8
"""Finest tolerance of round caps and joins over half the width of their stroke."""


@dataclass(frozen=True)
class Stroke:
    """The pen of a stroke.

    half         half its width
    cap          of open lines: butt, round or square
    join         miter, round or bevel
    miter_limit  mitres that are longer than this, over the width, become bevels
    """

    half: float
    cap: str
    join: str
    miter_limit: float


def stroked(pen: PolylinePen, stroke: Stroke) -> Any:
    """Return the region that a stroke along the contours of a pen covers."""
    parts: list[Any] = []
    for points, is_closed in zip(pen.contours, pen.closed, strict=True):
        parts += _stroke(points, is_closed, stroke, pen.tolerance)
    return shapely.unary_union(parts)


def _stroke(points: np.ndarray, is_closed: bool, stroke: Stroke, tolerance: float) -> Iterator[Any]:
    half = stroke.half
    quarter = math.ceil(0.25 * math.pi / math.acos(1.0 - min(max(tolerance / half, FINEST), 0.5)))
    cap, join = CAPS.get(stroke.cap, "flat"), JOINS.get(stroke.join, "mitre")

    def buffered(line: Any, ends: str) -> Any:
        return shapely.buffer(line, half, quad_segs=quarter, cap_style=ends, join_style=join, mitre_limit=1e6)

    if len(points) < 2:
        if cap != "flat":  # a dot
            yield buffered(shapely.Point(points[0]), cap)
        return
    is_closed = is_closed and len(points) > 2
    sharp = _sharp(points, is_closed, stroke.miter_limit) if join == "mitre" else np.empty(0, int)
    if not len(sharp):
        yield buffered(shapely.LinearRing(points) if is_closed else shapely.LineString(points), cap)
        return
    for at in sharp:
        yield _bevel(points[at - 1], points[at], points[(at + 1) % len(points)], half)
    if is_closed:  # begins and ends at a sharp corner
        points, sharp = np.roll(points, -sharp[0], axis=0), np.append(sharp - sharp[0], len(points))
        points = np.append(points, points[:1], axis=0)
    else:
        sharp = np.array([0, *sharp, len(points) - 1])
    for first, last in pairwise(sharp):
        yield buffered(shapely.LineString(points[first : last + 1]), "flat")
    if not is_closed and cap != "flat":
        for end, inner in ((points[0], points[1]), (points[-1], points[-2])):
            yield (
                buffered(shapely.LineString([inner, end]), cap)
                if cap == "round"
                else _square(inner, end, half)
            )


def _sharp(points: np.ndarray, is_closed: bool, limit: float) -> np.ndarray:
    """Return the points (N, 2) whose mitre, 1 / sin(angle / 2) widths long, is longer than the limit."""
    before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    before /= np.linalg.norm(before, axis=1)[:, None]
    after /= np.linalg.norm(after, axis=1)[:, None]
    half_sine = np.sqrt(np.maximum(0.5 * (1.0 + (before * after).sum(axis=1)), 0.0))
    is_sharp = half_sine * limit < 1.0
    if not is_closed:
        is_sharp[[0, -1]] = False
    return np.flatnonzero(is_sharp)


def _normal(start: np.ndarray, end: np.ndarray, half: float) -> np.ndarray:
    along = (end - start) * (half / np.linalg.norm(end - start))
    return np.array([-along[1], along[0]])


def _bevel(before: np.ndarray, at: np.ndarray, after: np.ndarray, half: float) -> Any:
    """Return the triangles between the sides of two segments; one of them lies in the stroke anyway."""
    first, second = _normal(before, at, half), _normal(at, after, half)
    sides = [shapely.Polygon([at, at + s * first, at + s * second]) for s in (1.0, -1.0)]
    return shapely.unary_union(sides)


def _square(inner: np.ndarray, end: np.ndarray, half: float) -> Any:
    side = _normal(inner, end, half)
    out = np.array([side[1], -side[0]])
    return shapely.Polygon([end + side, end + side + out, end - side + out, end - side])
