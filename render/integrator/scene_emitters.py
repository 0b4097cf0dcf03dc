"""The emitters of a scene: those that next event estimation samples, and sums of radiance by emitter group.

A path adds light of many emitters to one pixel. Which of them is known only while it is traced, so each light
is compared with all of them. Mitsuba's daylight is one emitter: its light from within the sun's disc is that
of the sun, less the share of the sky there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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


@dataclass(frozen=True)
class SunDisc:
    """The sun within the emitter `sky`, where the two are in different groups.

    direction  unit vector to its middle
    cosine     of the angle between its middle and its edge
    fraction   of the light there that is the sun's, by channel
    group      index of its group
    """

    direction: Triple
    cosine: float
    fraction: Triple
    group: int


class EmitterGroups:
    """The groups of the emitters of a scene. Emitters of no group belong to the last.

    count       sums of a path: as many as groups, 1 without groups
    are_wanted  True if the light of each group is wanted besides that of all
    """

    def __init__(
        self,
        scene: Any = None,
        names: Sequence[Sequence[str]] = (),
        sun: SunDisc | None = None,
        background: int | None = None,
    ) -> None:
        """Group the emitters of a Mitsuba scene.

        names       those of the emitters of each group
        background  index of the group of what the lens sees of the sky itself; None for the sky's group
        """
        import drjit as dr
        import mitsuba as mi

        self.count, self.are_wanted = max(1, len(names)), len(names) > 0
        self._emitters = [emitter_pointers(scene, group) for group in names]
        self._sun, self._background = sun, background
        if sun is not None:
            self._sky = next(index for index, group in enumerate(names) if "sky" in group)
            self._direction = dr.opaque(mi.Vector3f, list(sun.direction))
            self._cosine = dr.opaque(mi.Float, sun.cosine)
            self._fraction = dr.opaque(mi.Color3f, list(sun.fraction))

    def zeros(self) -> list[Any]:
        """Return the sums of a path without light."""
        import mitsuba as mi

        return [mi.Color3f(0.0) for _ in range(self.count)]

    def add(self, sums: list[Any], light: Any, emitter: Any, direction: Any) -> list[Any]:
        """Return the sums with the light of an emitter added to that of its group.

        emitter    array of pointers
        direction  unit vectors to the emitter
        """
        if self.count == 1:
            return [sums[0] + light]
        parts = self._parts(light, emitter)
        if self._sun is not None:
            self._move_sun(parts, direction)
        return [total + part for total, part in zip(sums, parts, strict=True)]

    def add_seen(self, sums: list[Any], light: Any, emitter: Any, direction: Any, is_sky: Any) -> list[Any]:
        """Return the sums with the light that the lens itself sees of an emitter; `is_sky` where it is the
        sky."""
        import drjit as dr

        if self._background is None:
            return self.add(sums, light, emitter, direction)
        sums = self.add(sums, dr.select(is_sky, 0.0, light), emitter, direction)
        sums[self._background] += dr.select(is_sky, light, 0.0)
        return sums

    def _parts(self, light: Any, emitter: Any) -> list[Any]:
        """Return the light by the group of its emitter."""
        import drjit as dr
        import mitsuba as mi

        parts, is_other = [], mi.Bool(True)
        for group in self._emitters[:-1]:
            is_member = mi.Bool(False)
            for member in group:
                is_member |= emitter == member
            is_other &= ~is_member
            parts.append(dr.select(is_member, light, 0.0))
        return [*parts, dr.select(is_other, light, 0.0)]

    def _move_sun(self, parts: list[Any], direction: Any) -> None:
        """Move the light of the sun's disc from the sky's group to the sun's."""
        import drjit as dr

        assert self._sun is not None
        sky, is_sun = parts[self._sky], dr.dot(direction, self._direction) > self._cosine
        parts[self._sun.group] += dr.select(is_sun, sky * self._fraction, 0.0)
        parts[self._sky] = dr.select(is_sun, sky * (1.0 - self._fraction), sky)
