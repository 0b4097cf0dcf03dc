"""Which lamps a path looks for from where it is, and how often.

Mitsuba draws every lamp as often as any other. Here a lamp is drawn by the light that it would send to the
place if nothing stood between, for the most part, and a little by chance, since a surface may mirror a faint
one. A sky of one gradient is left out: a path that goes on by what the surface reflects finds it best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.serialise import Triple
from render.scene.lights import LightRig

BY_CHANCE = 0.1
"""Of all looks, how many are for any lamp alike."""

_GRAZING, _ASIDE = 0.05, 0.02
"""Cosines that those of a place and of a lamp count as at least: a lamp has a width, a mirror looks along."""

_LUMA = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class Aim:
    """A lamp that paths look for.

    name      that of its shape or emitter in the scene
    strength  luminance times area, or for light from afar the irradiance; None where that is not known
    place     its middle, scene units; None where it is far away
    facing    the way it shines
    """

    name: str
    strength: float | None = None
    place: Triple | None = None
    facing: Triple | None = None


def aims(lights: LightRig, to_scene: NDArray[np.float64]) -> list[Aim]:
    """Of a rig; to_scene: (4, 4), from stage units, turned and scaled alike in all directions"""
    turn, scale = to_scene[:3, :3], float(np.cbrt(np.linalg.det(to_scene[:3, :3])))
    found = []
    for index, box in enumerate(lights.softboxes):
        strength = float(_LUMA @ box.radiance) * box.width * box.height * scale**2
        place = turn @ box.position + to_scene[:3, 3]
        facing = _unit(turn @ np.subtract(box.target, box.position))
        found.append(Aim(f"softbox{index}", strength, _triple(place), _triple(facing)))
    for index, sun in enumerate(lights.suns):
        facing = _unit(turn @ sun.direction)
        found.append(Aim(f"sun{index}", float(_LUMA @ sun.irradiance), None, _triple(facing)))
    if lights.daylight or lights.environment:
        found.append(Aim("sky"))
    return found


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vector / np.linalg.norm(vector))


def _triple(vector: NDArray[np.float64]) -> Triple:
    x, y, z = (float(part) for part in vector)
    return x, y, z


class Lamps:
    """The lamps of a scene as compiled code knows them: where they are is data to it."""

    def __init__(self, scene: Any, wanted: Sequence[Aim]) -> None:
        import drjit as dr
        import mitsuba as mi

        known = [_name(emitter) for emitter in scene.emitters()]
        everything = scene.emitters_dr()
        self.emitters = [
            dr.gather(mi.EmitterPtr, everything, dr.opaque(mi.UInt32, known.index(aim.name)))
            for aim in wanted
        ]
        self._known = [
            (
                _data(mi.Float, aim.strength),
                _data(mi.Point3f, aim.place),
                _data(mi.Vector3f, aim.facing),
            )
            for aim in wanted
        ]

    def __len__(self) -> int:
        return len(self.emitters)

    def shares(self, si: Any) -> list[Any]:
        """How probably each is looked for from there."""
        import drjit as dr
        import mitsuba as mi

        known = [
            None if strength is None else _irradiance(si, strength, place, facing)
            for strength, place, facing in self._known
        ]
        told = [each for each in known if each is not None]
        usual = sum(told) / len(told) if told else 1.0
        weights: list[Any] = [usual if each is None else each for each in known]
        total: Any = dr.maximum(sum(weights, dr.zeros(mi.Float)), 1e-30)
        return [(1.0 - BY_CHANCE) * each / total + BY_CHANCE / len(weights) for each in weights]

    def drawn(self, shares: list[Any], number: Any) -> tuple[Any, Any]:
        """One of them and its share, by a number from 0 to 1."""
        import drjit as dr
        import mitsuba as mi

        emitter, share, until = mi.EmitterPtr(self.emitters[0]), shares[0], shares[0]
        for other, its in zip(self.emitters[1:], shares[1:], strict=True):
            further = number >= until
            emitter, share = dr.select(further, other, emitter), dr.select(further, its, share)
            until = until + its
        return emitter, share

    def share_of(self, emitter: Any, shares: list[Any]) -> Any:
        """That of an emitter that was found by chance; 0 of one that is not looked for."""
        import drjit as dr
        import mitsuba as mi

        found = mi.Float(0.0)
        for each, share in zip(self.emitters, shares, strict=True):
            found = dr.select(emitter == each, share, found)
        return found


def _irradiance(si: Any, strength: Any, place: Any, facing: Any) -> Any:
    """About what a lamp gives to a surface there, and never nothing."""
    import drjit as dr

    if place is None:
        return strength * dr.maximum(dr.abs(dr.dot(facing, si.n)), _GRAZING)
    way = place - si.p
    square = dr.maximum(dr.squared_norm(way), 1e-12)
    towards = way * dr.rsqrt(square)
    seen = dr.maximum(dr.abs(dr.dot(towards, si.n)), _GRAZING)
    return strength * dr.maximum(-dr.dot(towards, facing), _ASIDE) * seen / square


def _data(kind: Any, value: Any) -> Any:
    """Not a constant of the compiled code, which would be compiled anew for each."""
    import drjit as dr

    if value is None:
        return None
    data = kind(value)
    dr.make_opaque(data)
    return data


def _name(emitter: Any) -> str:
    shape = emitter.get_shape()
    return str(shape.id() if shape is not None else emitter.id())
