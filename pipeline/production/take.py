"""A take: the pictures of one shot at one quality, and the key of every file on the way to them.

A shot's own take shows each mesh frame once. A turntable's shows one mesh frame many times, turned.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from pipeline.production.edit import movie_bits
from pipeline.production.framing import Framing
from pipeline.production.keyring import Keyring
from pipeline.production.keys import (
    FINISH_CODE,
    FRAMING_CODE,
    MOVIE_CODE,
    NORMALS_CODE,
    PICTURE_CODE,
    SIMULATION_CODE,
    STILL_CODE,
    Key,
    code_key,
    key_of,
)
from pipeline.production.movement import STEP, acting
from pipeline.production.showing import Showing
from pipeline.production.store import Store
from pipeline.shot.data import as_data
from render.errors import BadInputError
from render.frame import seed_of
from render.measure import SPEED
from render.plain import to_plain

FORMS = ("png", "png16", "jpeg")
"""Of single frames as a display shows them; a task of the workflow has the name of each."""


@dataclass(frozen=True)
class Take(Showing):
    """The pictures of one shot at one quality, rendered by one variant: keys, each made of the one before."""

    @cached_property
    def _mesh_keys(self) -> dict[int, Key]:
        """A chain: each key holds the one before and what acts between the two frames."""
        motion = self.shot.motion
        code = code_key(SIMULATION_CODE, ("numba", "numpy", "trimesh"))
        key = key_of("mesh", code, motion.start_data())
        first, *others = sorted(motion.frames)
        keys = {first: key}
        for number in others:
            key = key_of(key, motion.step_data(number))
            keys[number] = key
        return keys

    def mesh_key(self, number: int) -> Key:
        return self._mesh_keys[number]

    def normals_key(self, number: int) -> Key:
        angle = as_data(self.thresholds(number).hard_angle)
        pieces = self.shot.picture.tessellate
        return key_of("normals", code_key(NORMALS_CODE), self.mesh_key(number), angle, pieces)

    @cached_property
    def cameras_key(self) -> Key:
        shown = sorted({pose.mesh for pose in self.poses.values()})
        return key_of(
            "cameras",
            code_key(FRAMING_CODE),
            [self.mesh_key(n) for n in shown],
            [[n, pose.mesh, pose.spin, to_plain(self.view(n))] for n, pose in self.poses.items()],
            self.aspect,
            self.follow,
            self.net_pieces,
            self.shot.picture.stage.room,
        )

    def framings(self, store: Store) -> dict[int, Framing] | None:
        """Every picture's camera and stage, where the store has them."""
        try:
            data = json.loads(store.path("cameras", self.cameras_key).read_text())
            return {number: Framing.from_data(data[str(number)]) for number in self.poses}
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError, BadInputError):  # cut short; to be found anew
            store.discard("cameras", self.cameras_key)
            return None

    def _beside(self, number: int, framings: Mapping[int, Framing]) -> list[Any]:
        """What decides a picture beyond what decides every one: layers, and what acts around its moment."""
        layers, offsets = self.layers, self.moments_beside(number)
        if not (layers.precision or offsets):
            return []
        around = [framings[n].as_data() for n in (number - 1, number + 1) if n in framings]
        turn = self.turntable.frames if self.turntable else None
        flow = acting(self.shot.motion, number, offsets) if self.turntable is None and offsets else []
        opened = self.open_at(number)
        return [list(map(list, layers.precision)), opened, flow, turn, around if offsets else []]

    def _measured(self, number: int) -> list[Any]:
        """What decides the colours of a picture that shows speeds."""
        if not self.measures_speed:
            return []
        return [[SPEED, acting(self.shot.motion, self.poses[number].mesh, (-STEP, STEP))]]

    @cached_property
    def _appearance(self) -> Key:
        """Of what is the same in all pictures."""
        picture = self.shot.picture
        return key_of(
            to_plain(picture.look),
            to_plain(replace(picture.lights, exposure=0.0)),
            to_plain(picture.stage),
            to_plain(self.quality),
            self.variant,
            picture.dicing,
        )

    def raw_key(self, number: int, framings: Mapping[int, Framing]) -> Key:
        pose = self.poses[number]
        return key_of(
            "raw",
            code_key(PICTURE_CODE, ("mitsuba", "drjit", "OpenImageIO")),
            self.normals_key(pose.mesh),
            pose.spin,
            framings[number].as_data(),
            self._appearance,
            self.seed(number),
            *self._beside(number, framings),
            *self._measured(number),
        )

    def frame_key(self, raw: Key, around: list[Key]) -> Key:
        """Of a finished picture; `around` are the raw ones whose light it takes in, if any."""
        code = code_key(FINISH_CODE, ("pyoidn", "OpenImageIO"))
        return key_of("frame", code, raw, self.quality.denoise, around)

    def picture_keys(self, store: Store) -> Keyring | None:
        """The keys of the pictures of the take, once its cameras are known."""
        framings = self.framings(store)
        return Keyring(self, store, framings) if framings else None

    def seed(self, number: int) -> int:
        return seed_of(self.folders.name, number)

    def still_key(self, form: str, frame_key: Key) -> Key:
        return key_of(form, code_key(STILL_CODE, ("OpenImageIO",)), frame_key, self.shot.picture.shown_as())

    def movie_key(self, frame_keys: list[Key]) -> Key:
        return key_of(
            "movie",
            code_key(MOVIE_CODE, ("av", "imageio", "OpenImageIO")),
            frame_keys,
            str(self.shot.motion.rate),
            self.shot.picture.shown_as(),
            movie_bits(self.quality_name),
        )
