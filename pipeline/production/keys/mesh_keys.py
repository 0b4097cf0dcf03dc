"""The keys of a shot's meshes, and of their normals: a chain through all of its frames."""

from __future__ import annotations

from dataclasses import fields
from functools import cached_property
from typing import Any

from pipeline.flow import Flow
from pipeline.frames import FrameRange
from pipeline.production.keys.digest import Key, key_of
from pipeline.production.keys.stages import SIMULATE, SMOOTH_NORMALS
from pipeline.resample import Thresholds
from pipeline.shot import Clock, Motion, Resampling, Shot
from pipeline.shot.data import as_data


def mesh_keys(motion: Motion) -> dict[int, Key]:
    """By frame: each key holds the one before and what acts between the two frames."""
    motion = asked_in_order(motion)
    key = key_of(SIMULATE.recipe, motion.start_data())
    first, *others = sorted(motion.frames)
    keys = {first: key}
    for number in others:
        key = key_of(key, motion.step_data(number))
        keys[number] = key
    return keys


def normals_keys(shot: Shot, meshes: dict[int, Key]) -> dict[int, Key]:
    """By frame; `meshes` are the keys of its meshes."""
    motion, pieces = asked_in_order(shot.motion), shot.picture.tessellate
    first = thresholds_at(motion, motion.frames.first).hard_angle
    is_the_same = motion.resampling is None or isinstance(motion.resampling.thresholds.hard_angle, float)

    def key(number: int, mesh: Key) -> Key:
        angle = first if is_the_same else thresholds_at(motion, number).hard_angle
        return key_of(SMOOTH_NORMALS.recipe, mesh, as_data(angle), pieces)

    return {number: key(number, mesh) for number, mesh in meshes.items()}


def thresholds_at(motion: Motion, number: int) -> Thresholds:
    """Those of a frame; where resampling is off, for the sake of the hard angle, which shades creases."""
    resampling = motion.resampling_at(number)
    return resampling.thresholds if resampling else Thresholds(1.0)


class _Range(FrameRange):
    """Frames whose ends are looked for once."""

    @cached_property
    def first(self) -> int:
        return super().first

    @cached_property
    def last(self) -> int:
        return super().last


class _AskedInOrder(Motion):
    """A motion that is asked several things of each frame, one frame after the other."""

    @cached_property
    def clock(self) -> Clock:
        return super().clock

    @cached_property
    def _latest(self) -> dict[int, Resampling | None]:
        return {}

    def resampling_at(self, frame: int) -> Resampling | None:
        if frame not in self._latest:
            self._latest.clear()
            self._latest[frame] = super().resampling_at(frame)
        return self._latest[frame]

    @cached_property
    def _bounds(self) -> list[Any]:
        """The resampling and the flow of the latest answer, and the answer."""
        return [None, None, None]

    def limit_steps(self, flow: Flow, frame: int) -> Flow:
        now = self.resampling_at(frame)
        if self._bounds[0] is not now or self._bounds[1] is not flow:
            self._bounds[:] = now, flow, super().limit_steps(flow, frame)
        found: Flow = self._bounds[2]
        return found


def asked_in_order(motion: Motion) -> Motion:
    """The same motion, quicker to ask of one frame after the other."""
    if isinstance(motion, _AskedInOrder):
        return motion
    parts = {field.name: getattr(motion, field.name) for field in fields(motion)}
    return _AskedInOrder(**{**parts, "frames": _Range(motion.frames.numbers)})
