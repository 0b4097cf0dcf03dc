"""A take: the pictures of one shot at one quality, and the key of every file on the way to them.

A shot's own take shows each mesh frame once. A turntable's shows one mesh frame many times, turned.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.frames import FrameRange
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
from pipeline.production.layout import Folders
from pipeline.production.movement import STEP, acting
from pipeline.production.poses import Pose, Turntable
from pipeline.production.script import Script
from pipeline.production.store import SUFFIXES, Store
from pipeline.production.window import base_of, quality_named
from pipeline.resample import Thresholds
from pipeline.shot import Shot
from pipeline.shot.cameras import View
from pipeline.shot.data import as_data
from pipeline.shot.net import ControlNet
from pipeline.shot.shutter import PictureLayers
from render.errors import BadInputError
from render.frame import seed_of
from render.measure import SPEED
from render.plain import to_plain
from render.quality import Quality

FORMS = ("png", "png16", "jpeg")
"""Of single frames as a display shows them; a task of the workflow has the name of each."""


@dataclass(frozen=True)
class Take:
    """The pictures of one shot at one quality, rendered by one variant.

    script     what its shot is read from
    requested  the frames asked for
    """

    script: Script
    quality_name: str
    variant: str
    requested: tuple[int, ...]
    turntable: Turntable | None = None

    def as_data(self) -> dict[str, Any]:
        return {
            "script": self.script.as_data(),
            "quality": self.quality_name,
            "variant": self.variant,
            "requested": list(self.requested),
            "turntable": asdict(self.turntable) if self.turntable else None,
        }

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Take:
        return cls(
            script=Script.from_data(data["script"]),
            quality_name=data["quality"],
            variant=data["variant"],
            requested=tuple(data["requested"]),
            turntable=Turntable(**data["turntable"]) if data["turntable"] else None,
        )

    @property
    def shot(self) -> Shot:
        """Raises what `Script.shot` raises."""
        return self.script.shot

    @property
    def name(self) -> str:
        """The shot's, which is known without reading it."""
        return self.script.name

    @property
    def quality(self) -> Quality:
        return quality_named(self.quality_name, self.shot.picture.qualities)

    @property
    def aspect(self) -> float:
        """Width to height of the whole picture, whatever part of it is rendered and how small."""
        return self.shot.picture.qualities[base_of(self.quality_name)].aspect

    @property
    def motion_folders(self) -> Folders:
        """Where mesh frames lie: with the shot, for its turntables too."""
        of_file = self.turntable and self.turntable.of_file
        return Folders.of_turntable(self.name) if of_file else Folders.of_shot(self.name)

    @property
    def folders(self) -> Folders:
        """Where pictures lie."""
        if self.turntable is None:
            return self.motion_folders
        name = self.name if self.turntable.of_file else f"{self.name}.{self.turntable.at:04d}"
        return Folders.of_turntable(name)

    def place(self, kind: str, number: int) -> Path:
        """Where the `mesh`, the `normals`, the `raw` picture or the finished `frame` of a number is shown."""
        if kind == "mesh":
            return self.motion_folders.mesh(number)
        if kind == "normals":
            return self.motion_folders.normals(number)
        if kind == "raw":
            return self.folders.raw(self.quality_name, number)
        return self.folders.frame(self.quality_name, number)

    def still_path(self, form: str, number: int) -> Path:
        """Where a frame is shown as a display shows it."""
        return self.folders.still(self.quality_name, form, number, SUFFIXES[form])

    @property
    def label(self) -> str:
        return f"{self.folders.name}_{self.quality_name}" + ("_turntable" if self.turntable else "")

    @cached_property
    def poses(self) -> dict[int, Pose]:
        """By picture number, all that the take could show."""
        if self.turntable is None:
            return {number: Pose(number) for number in self.shot.motion.frames}
        count = self.turntable.frames
        return {i + 1: Pose(self.turntable.at, 2 * math.pi * i / count) for i in range(count)}

    def whole(self) -> Take:
        """The same with every picture asked for."""
        return replace(self, requested=tuple(self.poses))

    @property
    def is_whole(self) -> bool:
        """Whether every picture of the take was asked for."""
        return set(self.requested) == set(self.poses)

    @property
    def movie_path(self) -> Path:
        return self.folders.movie(
            self.quality_name, None if self.is_whole else str(FrameRange.of(self.requested))
        )

    # Keys, each made of the one before

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

    def thresholds(self, number: int) -> Thresholds:
        """Those of a frame; where resampling is off, for the sake of the hard angle, which shades creases."""
        resampling = self.shot.motion.resampling_at(number)
        return resampling.thresholds if resampling else Thresholds(1.0)

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
            self._net_pieces,
            self.shot.picture.stage.room,
        )

    @property
    def _net_pieces(self) -> int | None:
        """How finely the surface of a net is cut, which is what cameras look at; None of other subjects."""
        is_net = isinstance(self.shot.motion.subject, ControlNet)
        return self.shot.picture.tessellate if is_net else None

    def view(self, number: int) -> View:
        """From where a picture is seen; a turntable stands still."""
        return self.shot.picture.camera.at(self.shot.motion.clock.time(self.poses[number].mesh))

    @property
    def follow(self) -> float:
        """How far the camera goes along with the sculpture; a turntable's does not."""
        return 0.0 if self.turntable else self.shot.picture.camera.follow

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

    @property
    def _reach(self) -> int:
        """Pictures to either side that light is taken from; what keeps its noise would not know its own."""
        return 0 if self.quality.denoise == "off" else self.quality.steady

    @property
    def layers(self) -> PictureLayers:
        """Those that the shot asks for, and those that following its pixels to other frames takes."""
        asked = self.shot.picture.layers
        return asked.with_("before", "after") if self._reach else asked

    def window(self, number: int, is_there: Callable[[int], bool]) -> tuple[int, ...]:
        """The pictures whose light a picture takes in, itself among them: those around it without a gap that
        are there, being asked for as well or rendered before."""
        first = last = number
        while number - first < self._reach and is_there(first - 1):
            first -= 1
        while last - number < self._reach and is_there(last + 1):
            last += 1
        return tuple(range(first, last + 1))

    def open_at(self, number: int) -> tuple[float, float] | None:
        """When the shutter opens for a picture and closes, in frames from its moment; None: it shows one."""
        motion = self.shot.motion
        return self.shot.picture.shutter.open_at(motion.clock.time(self.poses[number].mesh))

    def moments_beside(self, number: int) -> tuple[float, ...]:
        """How far a picture looks beyond its own moment, in frames, each way or none."""
        layers = self.layers.extra
        steps = {"velocity": (-STEP, STEP), "motion": (1.0,), "after": (1.0,), "before": (-1.0,)}
        return (
            *(self.open_at(number) or ()),
            *(offset for name in layers for offset in steps.get(name, ())),
        )

    @property
    def measures_speed(self) -> bool:
        """Whether the colours of its pictures are the speed of the flow."""
        measure = self.shot.picture.look.measure
        return measure is not None and measure.of == SPEED

    def follows_flow(self, number: int) -> bool:
        """Whether a picture needs its mesh, and the flow; a turntable's only turn."""
        return self.measures_speed or (self.turntable is None and bool(self.moments_beside(number)))

    def needs_mesh(self, number: int) -> bool:
        """Whether a picture is made of its mesh itself, not of what was kept of it for rendering alone."""
        return self.shot.picture.dicing is not None or self.follows_flow(number)

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
