"""The emitters that next event estimation samples: described from a light rig, and found in a scene."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.serialise import Triple
from render.scene.render_camera import unit
from render.scene.scene_lights import LightRig
from render.scene.sky import Daylight

_LUMA = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class SampledEmitter:
    """An emitter for next event estimation.

    name      of its shape or emitter in the scene
    strength  luminance times area, or irradiance of a distant light; None where it is unknown
    position  of its middle, scene units; None for a distant light
    facing    direction it shines to; None where `strength` is
    daylight  that it is, or None
    """

    name: str
    strength: float | None = None
    position: Triple | None = None
    facing: Triple | None = None
    daylight: Daylight | None = None


def sampled_emitters(lights: LightRig, to_scene: NDArray[np.float64]) -> list[SampledEmitter]:
    """Return the emitters of a rig to sample. to_scene: similarity transform (4, 4) from stage units"""
    turn, scale = to_scene[:3, :3], float(np.cbrt(np.linalg.det(to_scene[:3, :3])))
    sampled = []
    for index, box in enumerate(lights.softboxes):
        strength = float(_LUMA @ box.radiance) * box.width * box.height * scale**2
        position = turn @ box.position + to_scene[:3, 3]
        facing = unit(turn @ np.subtract(box.target, box.position))
        sampled.append(SampledEmitter(f"softbox{index}", strength, _triple(position), _triple(facing)))
    for index, sun in enumerate(lights.suns):
        facing = unit(turn @ sun.direction)
        sampled.append(SampledEmitter(f"sun{index}", float(_LUMA @ sun.irradiance), None, _triple(facing)))
    if lights.daylight:
        sampled.append(SampledEmitter("sky", daylight=lights.daylight))
    elif lights.environment:
        sampled.append(SampledEmitter("sky"))
    return sampled


def _triple(vector: NDArray[np.float64]) -> Triple:
    x, y, z = (float(part) for part in vector)
    return x, y, z


def emitter_pointers(scene: Any, names: Iterable[str]) -> list[Any]:
    """Return pointers to emitters of a scene by their names."""
    import drjit as dr
    import mitsuba as mi

    present = [_name(emitter) for emitter in scene.emitters()]
    pointers = scene.emitters_dr()
    return [dr.gather(mi.EmitterPtr, pointers, dr.opaque(mi.UInt32, present.index(name))) for name in names]


def _name(emitter: Any) -> str:
    shape = emitter.get_shape()
    return str(shape.id() if shape is not None else emitter.id())
