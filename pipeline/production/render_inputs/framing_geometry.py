"""What a view shows of points: how far they reach in it, and the camera that has them in its picture."""

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

AT_ONCE = 4096
"""Points that are looked at together: what is found of them then stays in a core's own memory."""


class Balls(NamedTuple):
    """Points (N, 3) of any float type, with something around them: radii (N,), scene units."""

    points: AnyArray
    radii: AnyArray


def bounds(points: AnyArray | Balls, view: View) -> tuple[Floats, float]:
    """(3,): the middle of what a view sees, by the bounds that it has there; and its lowest height."""
    axes = _axes(view.azimuth + view.orbit, view.elevation)
    reach = _furthest(points, np.vstack([axes, -axes, DOWN]), np.ones(7))
    return (reach[:3] - reach[3:6]) / 2 @ axes, float(-reach[6])


def fitting_distance(
    points: AnyArray | Balls, target: Floats, axes: Floats, view: View, aspect: float
) -> float:
    """The least distance from `target` at which all points, or balls, lie within the margins of the picture.

    axes  (3, 3): rows right, up and back, the camera's

    A ball lies beside a plane through the lens if its centre is its radius away from it.
    """
    right, up, back = axes
    wide = np.tan(view.field_of_view / 2) * (1 - 2 * view.margin)
    high = wide / aspect
    sides = np.stack([back + right / wide, back - right / wide, back + up / high, back - up / high])
    slant = np.repeat([np.hypot(1.0, wide) / wide, np.hypot(1.0, high) / high], 2)
    return float((_furthest(points, sides, slant) - sides @ target).max())


def _furthest(points: AnyArray | Balls, ways: Floats, slant: Floats) -> Floats:
    """(K,): how far points, or balls, reach along ways (K, 3), which a radius adds to by `slant` (K,).

    What bounds a picture are planes, so this is all that framing asks of a sculpture.
    """
    centres, radii = points if isinstance(points, Balls) else (points, None)
    reach = np.full(len(ways), -np.inf)
    for some in (slice(i, i + AT_ONCE) for i in range(0, len(centres), AT_ONCE)):
        along = ways @ centres[some].T
        if radii is not None:
            along += slant[:, None] * radii[some]
        np.maximum(reach, along.max(axis=1), out=reach)
    return reach


def bearing(view: View, aim: Floats) -> tuple[float, float]:
    """Azimuth and elevation from which a view sees its aim; from the front where it stands in it."""
    if view.position is None:
        return view.azimuth + view.orbit, view.elevation
    x, y, z = np.subtract(view.position, aim)
    return float(np.arctan2(x, z)), float(np.arctan2(y, np.hypot(x, z)))


def _axes(azimuth: float, elevation: float) -> Floats:
    """(3, 3): rows right, up and back of a camera that is not rolled."""
    sin_a, cos_a = np.sin(azimuth), np.cos(azimuth)
    sin_e, cos_e = np.sin(elevation), np.cos(elevation)
    return np.array(
        [
            [cos_a, 0.0, -sin_a],
            [-sin_e * sin_a, cos_e, -sin_e * cos_a],
            [cos_e * sin_a, sin_e, cos_e * cos_a],
        ]
    )


def side_of(view: View, aim: Floats) -> Floats:
    """(3, 3): the axes of a view's camera, rolled."""
    right, up, back = _axes(*bearing(view, aim))
    if view.roll == 0.0:
        return np.stack([right, up, back])
    cos, sin = np.cos(view.roll), np.sin(view.roll)
    return np.stack([cos * right - sin * up, cos * up + sin * right, back])


def camera_of(view: View, aim: Floats, axes: Floats, distance: float, size: float) -> Camera:
    """The camera of a view at the distance that framing found; `size` is the sculpture's half-size."""
    if view.position is None:
        away = distance * view.dolly if view.distance is None else view.distance
        origin = aim + away * axes[2]
    else:
        origin = np.array(view.position)
        away = float(np.linalg.norm(origin - aim))
    is_upright = view.roll == 0.0 and np.hypot(axes[2][0], axes[2][2]) > UPRIGHT
    return Camera(
        origin=plain(origin),
        target=plain(aim if away > 0.0 else origin - axes[2]),
        up=(0.0, 1.0, 0.0) if is_upright else plain(axes[1]),
        field_of_view=view.field_of_view,
        near=min(NEAR, away / 10.0) if away > 0.0 else NEAR,
        far=max(FAR, 100.0 * away),
        **_blur(view.lens, origin, axes[2], away, size),
    )


def _blur(lens: Lens | None, origin: Floats, back: Floats, away: float, size: float) -> dict[str, float]:
    """How wide a lens opens and how far away it is sharp, scene units; nothing of one sharp everywhere."""
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


def plain(values: Iterable[float]) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
