"""The emitters of a Mitsuba scene: pointers to them, and sums of radiance by emitter group.

A path adds light of many emitters to one pixel. Which of them is known only while it is traced, so each light
is compared with all of them. Mitsuba's daylight is one emitter: its light from within the sun's disc is that
of the sun, less the share of the sky there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import drjit as dr
import mitsuba as mi

from flowsculpt.render.scene.scene_lights import SunDisc


def emitter_pointers(scene: Any, names: Iterable[str]) -> list[Any]:
    """Return pointers to emitters of a scene by their names."""
    present = [_name(emitter) for emitter in scene.emitters()]
    pointers = scene.emitters_dr()
    return [dr.gather(mi.EmitterPtr, pointers, dr.opaque(mi.UInt32, present.index(name))) for name in names]


def _name(emitter: Any) -> str:
    shape = emitter.get_shape()
    return str(shape.id() if shape is not None else emitter.id())


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
        if self._background is None:
            return self.add(sums, light, emitter, direction)
        sums = self.add(sums, dr.select(is_sky, 0.0, light), emitter, direction)
        sums[self._background] += dr.select(is_sky, light, 0.0)
        return sums

    def _parts(self, light: Any, emitter: Any) -> list[Any]:
        """Return the light by the group of its emitter."""
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
        assert self._sun is not None
        sky, is_sun = parts[self._sky], dr.dot(direction, self._direction) > self._cosine
        parts[self._sun.group] += dr.select(is_sun, sky * self._fraction, 0.0)
        parts[self._sky] = dr.select(is_sun, sky * (1.0 - self._fraction), sky)
