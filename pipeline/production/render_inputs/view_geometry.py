"""The geometry of a view: the axes of its camera, and the places from which it shows all points."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Floats

if TYPE_CHECKING:
    from pipeline.shot.camera_path import View

DOWN = (0.0, -1.0, 0.0)

BLOCK = 4096
"""Points that are projected together, so that results stay in a core's cache."""

NEAREST = 0.01
"""Least distance of a camera for which widths are compared, over half of what its lens sees at depth 1."""


class BoundingSpheres(NamedTuple):
    """Spheres: centres (N, 3) of any float type, and radii (N,), scene units."""

    points: AnyArray
    radii: AnyArray


Extent = AnyArray | BoundingSpheres
"""Points (N, 3) of any float type, or spheres; a picture must show them all."""


def rotate_y(
    points: AnyArray, angle: float, about_origin: bool = False, around: AnyArray | None = None
) -> AnyArray:
    """Turn (N, 3) points about the vertical axis of their bounds, or directions about y.

    around  (M, 3), other points whose bounds have the axis
    """
    if angle == 0.0:
        return points
    bounded = points if around is None else around
    low, high = bounded.min(axis=0), bounded.max(axis=0)
    pivot = np.zeros(3) if about_origin else (low + high) / 2
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return np.asarray((points - pivot) @ turn.T + pivot)


def bounds(points: Extent, view: View) -> tuple[Floats, float]:
    """Return the centre (3,) of the bounds of points along the axes of a view, and their lowest height."""
    axes = _axes(view.azimuth + view.orbit, view.elevation)
    reach = _extents(points, np.vstack([axes, -axes, DOWN]), np.ones(7))
    return (reach[:3] - reach[3:6]) / 2 @ axes, float(-reach[6])


def picture_centre(points: Extent, middle: Floats, view: View, aspect: float) -> Floats:
    """Return the point (3,) that a camera looks at to show points in the middle of its picture.

    middle  (3,), the centre of their bounds; a camera with a position of its own looks there

    Near parts look larger, so the point is off the middle. Of width and height the larger decides the
    distance; the other is centred as it looks from there.
    """
    if view.position is not None:
        return middle
    axes, extents = _axes(view.azimuth + view.orbit, view.elevation), _half_extents(view, aspect)
    fits, depth = _fits(points, axes, *extents), float(axes[2] @ middle)
    nearest = NEAREST * max(extents)
    away = max(nearest, *(fit.distance - depth for fit in fits))
    wide, high = (
        extent * max(nearest, fit.distance - depth) / away for extent, fit in zip(extents, fits, strict=True)
    )
    right, up = (fit.middle for fit in _fits(points, axes, wide, high))
    return np.array([right, up, depth]) @ axes


class _Fit(NamedTuple):
    """The place from which points just fit between two opposite edges of the picture.

    middle    along the camera's right axis for the left and right edge, along its up axis for the others
    distance  along the camera's back axis
    """

    middle: float
    distance: float


def _fits(points: Extent, axes: Floats, wide: float, high: float) -> tuple[_Fit, _Fit]:
    """Return the places that fit the width and the height, where the lens sees so much at depth 1."""
    right, left, upper, lower = _extents(points, *_edge_planes(axes, wide, high)).tolist()
    return (
        _Fit(wide * (right - left) / 2, (right + left) / 2),
        _Fit(high * (upper - lower) / 2, (upper + lower) / 2),
    )


def fitting_distance(points: Extent, target: Floats, axes: Floats, view: View, aspect: float) -> float:
    """Return the least distance from `target` at which all points or spheres lie within the margins.

    axes  (3, 3): rows right, up and back, the camera's

    A sphere touches a plane through the lens if its centre is its radius away from it.
    """
    planes, slant = _edge_planes(axes, *_half_extents(view, aspect))
    return float((_extents(points, planes, slant) - planes @ target).max())


def _half_extents(view: View, aspect: float) -> tuple[float, float]:
    """Return half the width and half the height of what a view shows within its margins at depth 1.

    A wide projection shows far more: its field of view is an angle in which the sculpture lies.
    """
    wide = float(np.tan(view.field_of_view / 2) * (1 - 2 * view.margin))
    return (wide, wide / aspect) if view.wide is None else (wide, wide)


def _edge_planes(axes: Floats, wide: float, high: float) -> tuple[Floats, Floats]:
    """Return normals (4, 3) of the planes through the lens and an edge of the picture; and their lengths.

    The planes are those of the right, left, upper and lower edge. Normals are 1 along the back axis.
    """
    right, up, back = axes
    planes = np.stack([back + right / wide, back - right / wide, back + up / high, back - up / high])
    return planes, np.repeat([np.hypot(1.0, wide) / wide, np.hypot(1.0, high) / high], 2)


def _extents(points: Extent, directions: Floats, slant: Floats) -> Floats:
    """Return (K,) the extents of points or spheres along directions (K, 3); radii count `slant` (K,) times.

    Planes bound a picture, so framing needs nothing else.
    """
    centres, radii = points if isinstance(points, BoundingSpheres) else (points, None)
    reach = np.full(len(directions), -np.inf)
    for some in (slice(i, i + BLOCK) for i in range(0, len(centres), BLOCK)):
        along = directions @ centres[some].T
        if radii is not None:
            along += slant[:, None] * radii[some]
        np.maximum(reach, along.max(axis=1), out=reach)
    return reach


def landscape(view: View, aspect: float) -> View:
    """Return a view of an upright picture as that of a wide one: the camera turned back from its side."""
    if aspect >= 1.0 or view.wide is not None:
        return view
    return view._replace(field_of_view=2.0 * float(np.arctan(np.tan(view.field_of_view / 2) / aspect)))


def bearing(view: View, aim: Floats) -> tuple[float, float]:
    """Return azimuth and elevation of the camera seen from its look-at point, radians."""
    if view.position is None:
        return view.azimuth + view.orbit, view.elevation
    x, y, z = np.subtract(view.position, aim)
    return float(np.arctan2(x, z)), float(np.arctan2(y, np.hypot(x, z)))


def _axes(azimuth: float, elevation: float) -> Floats:
    """Return (3, 3): rows right, up and back of a camera without roll."""
    sin_a, cos_a = np.sin(azimuth), np.cos(azimuth)
    sin_e, cos_e = np.sin(elevation), np.cos(elevation)
    return np.array(
        [
            [cos_a, 0.0, -sin_a],
            [-sin_e * sin_a, cos_e, -sin_e * cos_a],
            [cos_e * sin_a, sin_e, cos_e * cos_a],
        ]
    )


def axes_of(view: View, aim: Floats) -> Floats:
    """Return (3, 3): the axes of a view's camera, with roll."""
    right, up, back = _axes(*bearing(view, aim))
    if view.roll == 0.0:
        return np.stack([right, up, back])
    cos, sin = np.cos(view.roll), np.sin(view.roll)
    return np.stack([cos * right - sin * up, cos * up + sin * right, back])
