"""Geometry of framing: extents of points in a view, and the camera that keeps them in its picture."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Floats
from render.scene.camera import Camera

if TYPE_CHECKING:
    from pipeline.shot.camera import Lens, View

HALF_A_SCULPTURE = 100.0
"""Millimetres that count as the sculpture's half-size, where a shot does not say what a unit is: lenses then
blur a small one and its enlarged copy alike."""

UPRIGHT = 1e-6
"""The cosine of an elevation from which on the vertical does not tell which way is up in the picture."""

NEAR, FAR = 1e-2, 1e4
"""Where cameras begin and cease to see, scene units; in scenes that are too small or too large for these, a
tenth of the distance of the target, and a hundred times that."""

DOWN = (0.0, -1.0, 0.0)

BLOCK = 4096
"""Points that are projected together, so that results stay in a core's cache."""


class BoundingSpheres(NamedTuple):
    """Spheres: centres (N, 3) of any float type, and radii (N,), scene units."""

    points: AnyArray
    radii: AnyArray


def bounds(points: AnyArray | BoundingSpheres, view: View) -> tuple[Floats, float]:
    """Return the centre (3,) of the bounds of points along the axes of a view, and their lowest height."""
    axes = _axes(view.azimuth + view.orbit, view.elevation)
    reach = _extents(points, np.vstack([axes, -axes, DOWN]), np.ones(7))
    return (reach[:3] - reach[3:6]) / 2 @ axes, float(-reach[6])


def fitting_distance(
    points: AnyArray | BoundingSpheres, target: Floats, axes: Floats, view: View, aspect: float
) -> float:
    """Return the least distance from `target` at which all points or spheres lie within the margins.

    axes  (3, 3): rows right, up and back, the camera's

    A sphere lies beside a plane through the lens if its centre is its radius away from it.
    """
    right, up, back = axes
    wide = np.tan(view.field_of_view / 2) * (1 - 2 * view.margin)
    high = wide / aspect
    sides = np.stack([back + right / wide, back - right / wide, back + up / high, back - up / high])
    slant = np.repeat([np.hypot(1.0, wide) / wide, np.hypot(1.0, high) / high], 2)
    return float((_extents(points, sides, slant) - sides @ target).max())


def _extents(points: AnyArray | BoundingSpheres, directions: Floats, slant: Floats) -> Floats:
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


def camera_of(view: View, aim: Floats, axes: Floats, distance: float, size: float) -> Camera:
    """Return the camera of a view at a distance; `size` is the half-size of the sculpture."""
    if view.position is None:
        away = distance * view.dolly if view.distance is None else view.distance
        origin = aim + away * axes[2]
    else:
        origin = np.array(view.position)
        away = float(np.linalg.norm(origin - aim))
    is_upright = view.roll == 0.0 and np.hypot(axes[2][0], axes[2][2]) > UPRIGHT
    return Camera(
        origin=triple(origin),
        target=triple(aim if away > 0.0 else origin - axes[2]),
        up=(0.0, 1.0, 0.0) if is_upright else triple(axes[1]),
        field_of_view=view.field_of_view,
        near=min(NEAR, away / 10.0) if away > 0.0 else NEAR,
        far=max(FAR, 100.0 * away),
        **_blur(view.lens, origin, axes[2], away, size),
    )


def _blur(lens: Lens | None, origin: Floats, back: Floats, away: float, size: float) -> dict[str, float]:
    """Return the lens radius and the focus distance, scene units; nothing for a pinhole camera."""
    if lens is None:
        return {}
    unit = HALF_A_SCULPTURE / size if lens.unit is None else lens.unit
    if lens.focus is None:
        sharp = away
    elif isinstance(lens.focus, float):
        sharp = lens.focus
    else:
        sharp = float((origin - lens.focus) @ back)
    return {"lens_radius": float(lens.focal_length / lens.aperture / 2.0 / unit), "focus_distance": sharp}


def triple(values: Iterable[float]) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
