"""Emitter groups of a scene: sums of radiance, one for each group.

A path adds light of many emitters to one pixel. Which of them is known only while it is traced, so each light
is compared with all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


class EmitterGroups:
    """The groups of the emitters of a scene. Those of no group belong to the last.

    count       sums of a path: as many as groups, 1 without groups
    are_wanted  True if the light of each group is wanted beside that of all
    """

    def __init__(self, scene: Any = None, names: Sequence[Sequence[str]] = ()) -> None:
        """Group the emitters of a Mitsuba scene. names: those of the emitters of each group"""
        from render.integrator.light_sampler import emitter_pointers

        self.count, self.are_wanted = max(1, len(names)), len(names) > 0
        self._emitters = [emitter_pointers(scene, group) for group in names[: self.count - 1]]

    def zeros(self) -> list[Any]:
        """Return the sums of a path without light."""
        import mitsuba as mi

        return [mi.Color3f(0.0) for _ in range(self.count)]

    def add(self, sums: list[Any], light: Any, emitter: Any) -> list[Any]:
        """Return the sums with the light of an emitter, an array of pointers, added to that of its group."""
        import drjit as dr
        import mitsuba as mi

        parts, is_other = [], mi.Bool(True)
        for group in self._emitters:
            is_member = mi.Bool(False)
            for member in group:
                is_member |= emitter == member
            is_other &= ~is_member
            parts.append(dr.select(is_member, light, 0.0))
        parts.append(dr.select(is_other, light, 0.0) if self._emitters else light)
        return [total + part for total, part in zip(sums, parts, strict=True)]
