"""The lights of a quick preview, as its kernel takes them: every one a row of numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from render.raster.parts import Set
from render.scene.camera import Camera
from render.scene.lights import LightRig, Softbox, Sun

Floats = NDArray[np.float64]

REACH = 2.6
"""Half the width of the shadow's picture, stage units at the subject."""

FAR = 60.0
"""From how far away the sun's shadow is seen, stage units."""


def lamps_of(around: Set) -> Floats:
    """(L, 10), the key light first, as `light` takes them."""
    rows = [_softbox(box, around) for box in around.lights.softboxes]
    rows += [_sun(sun, around) for sun in around.lights.suns]
    return np.array(rows).reshape(-1, 10)


def key_camera(around: Set) -> Camera | None:
    """What the first of the lights sees of the subject, in a square picture; None where there is no light."""
    rig, size = around.lights, around.placement.size
    if not (rig.softboxes or rig.suns):
        return None
    place, target = _places(rig, around)
    away = float(np.linalg.norm(target - place))
    x, y, z = place.tolist()
    a, b, c = target.tolist()
    up = (0.0, 1.0, 0.0) if np.hypot(a - x, c - z) > 1e-3 * away else (0.0, 0.0, 1.0)
    angle = 2.0 * float(np.arctan(REACH * size / away))
    return Camera((x, y, z), (a, b, c), up, angle, near=1e-3 * away, far=1e3 * away)


def _places(rig: LightRig, around: Set) -> tuple[Floats, Floats]:
    """Where the key light is, and what it looks at."""
    if rig.softboxes:
        return _placed(rig.softboxes[0], around)
    target = np.add(around.placement.origin, (0.0, around.placement.size, 0.0))
    return target - FAR * around.placement.size * _unit(np.array(rig.suns[0].direction)), target


def _softbox(box: Softbox, around: Set) -> Floats:
    place, target = _placed(box, around)
    area = box.width * box.height * around.placement.size**2
    return np.array([*place, *_unit(target - place), *(area * np.array(box.radiance)), np.sqrt(area) / 2.0])


def _sun(sun: Sun, around: Set) -> Floats:
    return np.array([*-_unit(np.array(sun.direction)), 0.0, 0.0, 0.0, *sun.irradiance, 0.0])


def _placed(box: Softbox, around: Set) -> tuple[Floats, Floats]:
    matrix = around.placement.matrix()
    place, target = (matrix[:3, :3] @ np.array(at) + matrix[:3, 3] for at in (box.position, box.target))
    return place, target


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))
