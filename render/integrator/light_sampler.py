"""Light sampler: choose an emitter for next event estimation.

Mitsuba chooses all emitters equally often. Here an emitter is chosen with probability proportional to its
unoccluded irradiance at the shading point (compare pbrt's `LightSampler`), mixed with a small uniform part:
a glossy surface may reflect a faint emitter strongly. A gradient sky is left out: paths that the BSDF samples
find it best.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.serialise import Triple
from render.scene.camera import unit
from render.scene.lights import LightRig

UNIFORM_FRACTION = 0.1
"""Fraction of the probability that is the same for all emitters."""

_MIN_SURFACE_COSINE, _MIN_EMITTER_COSINE = 0.05, 0.02
"""Least cosines used in estimates: emitters have a width, and glossy surfaces reflect at grazing angles."""

_LUMA = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class SampledEmitter:
    """An emitter for next event estimation.

    name      of its shape or emitter in the scene
    strength  luminance times area, or irradiance of a distant light; None where it is unknown
    position  of its middle, scene units; None for a distant light
    facing    direction it shines to; None where `strength` is
    """

    name: str
    strength: float | None = None
    position: Triple | None = None
    facing: Triple | None = None


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
    if lights.daylight or lights.environment:
        sampled.append(SampledEmitter("sky"))
    return sampled


def _triple(vector: NDArray[np.float64]) -> Triple:
    x, y, z = (float(part) for part in vector)
    return x, y, z


class LightSampler:
    """Chooses among emitters of a scene. Positions are data of the compiled code, not constants in it."""

    def __init__(self, scene: Any, sampled: Sequence[SampledEmitter]) -> None:
        import mitsuba as mi

        self.emitters = emitter_pointers(scene, [emitter.name for emitter in sampled])
        self._geometry = [
            (
                _opaque(mi.Float, emitter.strength),
                _opaque(mi.Point3f, emitter.position),
                _opaque(mi.Vector3f, emitter.facing),
            )
            for emitter in sampled
        ]

    def __len__(self) -> int:
        return len(self.emitters)

    def probabilities(self, si: Any) -> list[Any]:
        """Return the probability of each emitter at a surface interaction."""
        import drjit as dr
        import mitsuba as mi

        estimates = [
            None if strength is None else _irradiance(si, strength, position, facing)
            for strength, position, facing in self._geometry
        ]
        known = [estimate for estimate in estimates if estimate is not None]
        mean = sum(known) / len(known) if known else 1.0
        weights: list[Any] = [mean if estimate is None else estimate for estimate in estimates]
        total: Any = dr.maximum(sum(weights, dr.zeros(mi.Float)), 1e-30)
        return [
            (1.0 - UNIFORM_FRACTION) * weight / total + UNIFORM_FRACTION / len(weights) for weight in weights
        ]

    def sample(self, probabilities: list[Any], number: Any) -> tuple[Any, Any]:
        """Return an emitter and its probability, chosen by a random number from 0 to 1."""
        import drjit as dr
        import mitsuba as mi

        emitter, probability = mi.EmitterPtr(self.emitters[0]), probabilities[0]
        cumulative = probabilities[0]
        for other, its_probability in zip(self.emitters[1:], probabilities[1:], strict=True):
            beyond = number >= cumulative
            emitter = dr.select(beyond, other, emitter)
            probability = dr.select(beyond, its_probability, probability)
            cumulative = cumulative + its_probability
        return emitter, probability

    def pmf(self, emitter: Any, probabilities: list[Any]) -> Any:
        """Return the probability of an emitter that a path hit; 0 for one that is not sampled."""
        import drjit as dr
        import mitsuba as mi

        result = mi.Float(0.0)
        for other, probability in zip(self.emitters, probabilities, strict=True):
            result = dr.select(emitter == other, probability, result)
        return result


def _irradiance(si: Any, strength: Any, position: Any, facing: Any) -> Any:
    """Return the approximate unoccluded irradiance by an emitter, always above 0."""
    import drjit as dr

    if position is None:
        return strength * dr.maximum(dr.abs(dr.dot(facing, si.n)), _MIN_SURFACE_COSINE)
    difference = position - si.p
    square = dr.maximum(dr.squared_norm(difference), 1e-12)
    direction = difference * dr.rsqrt(square)
    cosine = dr.maximum(dr.abs(dr.dot(direction, si.n)), _MIN_SURFACE_COSINE)
    return strength * dr.maximum(-dr.dot(direction, facing), _MIN_EMITTER_COSINE) * cosine / square


def _opaque(kind: Any, value: Any) -> Any:
    """Return a value as data of the compiled code, which would otherwise be compiled for each value."""
    import drjit as dr

    if value is None:
        return None
    data = kind(value)
    dr.make_opaque(data)
    return data


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
