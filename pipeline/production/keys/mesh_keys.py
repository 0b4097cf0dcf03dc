"""The keys of a shot's meshes and of their normals: a chain through all frames."""

from __future__ import annotations

from pipeline.production.keys.digest import Key, key_of
from pipeline.production.keys.stages import SIMULATE, SMOOTH_NORMALS
from pipeline.resample import Thresholds
from pipeline.shot import Motion, Shot
from pipeline.shot.data import as_data


def mesh_keys(motion: Motion) -> dict[int, Key]:
    """Return keys by frame: each is made of the one before and of what acts between the two frames."""
    key = key_of(SIMULATE.recipe, motion.start_data())
    first, *others = sorted(motion.frames)
    keys = {first: key}
    for number in others:
        key = key_of(key, motion.step_data(number))
        keys[number] = key
    return keys


def normals_keys(shot: Shot, meshes: dict[int, Key]) -> dict[int, Key]:
    """Return keys by frame; `meshes` are the keys of its meshes."""
    motion, pieces = shot.motion, shot.picture.tessellate
    first = thresholds_at(motion, motion.frames.first).hard_angle
    is_constant = motion.resampling is None or isinstance(motion.resampling.thresholds.hard_angle, float)

    def key(number: int, mesh: Key) -> Key:
        angle = first if is_constant else thresholds_at(motion, number).hard_angle
        return key_of(SMOOTH_NORMALS.recipe, mesh, as_data(angle), pieces)

    return {number: key(number, mesh) for number, mesh in meshes.items()}


def thresholds_at(motion: Motion, number: int) -> Thresholds:
    """Return the thresholds of a frame; without resampling the default, whose hard angle makes creases."""
    resampling = motion.resampling_at(number)
    return resampling.thresholds if resampling else Thresholds(1.0)
