"""A take: the pictures of one shot at one quality, and the key of every file on the way to them.

A shot's own take shows each mesh frame once. A turntable's shows one of them many times, turned.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from pipeline.production.keys.digest import Key, key_of
from pipeline.production.keys.stages import ASSEMBLE, FINISH, FRAME_CAMERA, RENDER, STAGES, STILLS
from pipeline.production.request.cameras import CameraFile
from pipeline.production.request.edit import movie_bits
from pipeline.production.request.picture_keys import PictureKeys
from pipeline.production.request.showing import Showing
from pipeline.production.store.store import Store
from render.base.serialise import from_plain, to_plain
from render.scene.quality import Quality

if TYPE_CHECKING:
    from pipeline.production.render_inputs.framing import Framing

FORMS = tuple(stage.name for stage in STILLS)
"""Of single frames as a display shows them; a task of the workflow has the name of each."""


@dataclass(frozen=True)
class RenderRequest(Showing):
    """The pictures of one shot at one quality, rendered by one variant: keys, each made of the one before."""

    def mesh_key(self, number: int) -> Key:
        return self.source.summary.meshes[number]

    def normals_key(self, number: int) -> Key:
        return self.source.summary.normals[number]

    @property
    def cameras_key(self) -> Key:
        return str(self._settled["cameras"])

    @cached_property
    def _settled(self) -> Mapping[str, Any]:
        """What planning asks of it: the key of its cameras, its quality, how far pictures take light from
        others, which of them follow the flow and need their meshes."""
        ledger = self.source.ledger
        found_from = "request", self.identity
        known = None if ledger is None else ledger.recall(*found_from)
        if known is None:
            follow_flow = [n for n in self.angles if self.goes_by_flow(n)]
            known = {
                "cameras": self._cameras_key(),
                "reach": self.steadied_over,
                "quality": to_plain(self.quality_of_shot),
                "precision": [list(layer) for layer in self.shot.picture.aovs.precision],
                "follow_flow": follow_flow,
                "need_mesh": follow_flow if self.shot.picture.dicing is None else list(self.angles),
            }
            if ledger is not None:
                ledger.note(known, *found_from)
        return {
            **known,
            "quality": from_plain(Quality, known["quality"]),
            **{name: frozenset(known[name]) for name in ("follow_flow", "need_mesh")},
        }

    @cached_property
    def identity(self) -> Key:
        """Of all that decides the take's keys, but for what code does."""
        summary = self.source.summary
        data = {**self.as_data(), "requested": None}
        data["script"] = {**data["script"], "pins": summary.pins}
        return key_of(data, summary.meshes, summary.normals)

    @property
    def quality(self) -> Quality:
        found: Quality = self._settled["quality"]
        return found

    @property
    def precision(self) -> list[tuple[str, str]]:
        """Of the layers that the shot speaks of, by name half or float."""
        return [(name, precision) for name, precision in self._settled["precision"]]

    @property
    def reach(self) -> int:
        """Pictures to either side that light is taken from."""
        return int(self._settled["reach"])

    def window(self, number: int, is_there: Callable[[int], bool]) -> tuple[int, ...]:
        """The pictures whose light a picture takes in, itself among them: those around it without a gap that
        are there, being asked for as well or rendered before."""
        first = last = number
        while number - first < self.reach and is_there(first - 1):
            first -= 1
        while last - number < self.reach and is_there(last + 1):
            last += 1
        return tuple(range(first, last + 1))

    def follows_flow(self, number: int) -> bool:
        """`goes_by_flow`, which need not read the shot again."""
        return number in self._settled["follow_flow"]

    def needs_mesh(self, number: int) -> bool:
        """Whether a picture is made of its mesh itself, not of what was kept of it for rendering alone."""
        return number in self._settled["need_mesh"]

    def _cameras_key(self) -> Key:
        shown = sorted({angle.mesh for angle in self.angles.values()})
        return key_of(
            FRAME_CAMERA.recipe,
            [self.mesh_key(n) for n in shown],
            [[n, angle.mesh, angle.spin, self.view(n)] for n, angle in self.angles.items()],
            self.aspect,
            self.follow,
            self.net_pieces,
            self.shot.picture.stage.camera_move,
        )

    def framings(self, store: Store) -> CameraFile | None:
        """Every picture's camera and stage, where the store has them."""
        return CameraFile.of(store, self.cameras_key, self.angles)

    def _beside(self, number: int, framings: Mapping[int, Framing]) -> list[Any]:
        """What decides a picture beyond what decides every one: layers, and what acts around its moment."""
        layers, offsets = self.layers, self.moments_beside(number)
        if not (layers.precision or offsets):
            return []
        around = [framings[n].as_data() for n in (number - 1, number + 1) if n in framings]
        turn = self.turntable.step(number) if self.turntable else None
        flow: list[Any] = []
        if self.turntable is None and offsets:
            from pipeline.production.render_inputs.motion import flow_cache_data

            flow = flow_cache_data(self.shot.motion, number, offsets)
        opened = self.open_at(number)
        return [list(map(list, layers.precision)), opened, flow, turn, around if offsets else []]

    def measured(self, number: int) -> list[Any]:
        """What decides the colours of a picture that shows speeds; nothing of others."""
        if not self.measures_speed:
            return []
        from pipeline.production.render_inputs.motion import STEP, flow_cache_data
        from render.scene.measure import SPEED

        return [[SPEED, flow_cache_data(self.shot.motion, self.angles[number].mesh, (-STEP, STEP))]]

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
        angle = self.angles[number]
        return key_of(
            RENDER.recipe,
            self.normals_key(angle.mesh),
            [angle.spin, angle.lights] if angle.lights else angle.spin,
            framings[number].as_data(),
            self._appearance,
            self.seed(number),
            *self._beside(number, framings),
            *self.measured(number),
        )

    def frame_key(self, raw: Key, around: list[Key]) -> Key:
        """Of a finished picture; `around` are the raw ones whose light it takes in, if any."""
        return key_of(FINISH.recipe, raw, self.quality.denoise, around)

    def picture_keys(self, store: Store) -> PictureKeys | None:
        """The keys of the pictures of the take, once its cameras are known."""
        cameras = self.framings(store)
        return None if cameras is None else PictureKeys(self, store, cameras)

    def seed(self, number: int) -> int:
        from render.frame.sample_batches import seed_of

        return seed_of(self.folders.name, number)

    @property
    def shown_as(self) -> Mapping[str, Any]:
        """Plain data of what is between the light of its pictures and a display."""
        return self.source.summary.shown_as

    def still_key(self, form: str, frame_key: Key) -> Key:
        return key_of(STAGES[form].recipe, frame_key, self.shown_as)

    def movie_key(self, frame_keys: list[Key]) -> Key:
        return key_of(
            ASSEMBLE.recipe,
            frame_keys,
            self.source.summary.rate,
            self.shown_as,
            movie_bits(self.quality_name),
        )
