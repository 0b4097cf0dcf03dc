"""Render requests: frames of one shot at one quality, and the key of every file on the way to them.

The request of a shot shows each mesh frame once. That of a turntable shows one of them many times: from all
around, then in turning light.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.request.audio import AudioClip, sound_of_frames
from flowsculpt.pipeline.production.request.lookup import crop_of, movie_bits, quality_named
from flowsculpt.pipeline.production.request.manifest import ShotManifest, measures_speed
from flowsculpt.pipeline.production.request.shot_source import PlanningCache, ShotSource
from flowsculpt.pipeline.production.stages import ASSEMBLE, FRAME_CAMERA, STAGES, STILLS
from flowsculpt.pipeline.production.store.paths import Folders
from flowsculpt.pipeline.production.store.store import Key, key_of
from flowsculpt.render.base.serialise import to_plain
from flowsculpt.render.scene.render_quality import QUALITIES, Quality

if TYPE_CHECKING:
    from flowsculpt.pipeline.shot import Shot
    from flowsculpt.pipeline.shot.camera_path import View
    from flowsculpt.pipeline.shot.shot import AovSelection, Picture
    from flowsculpt.render.scene.render_camera import Projection


TURNS = ("object", "lights")
"""The turns of a turntable, in their order."""

MARGIN, WIDEST = 0.1, math.radians(40.0)
"""The least margin around the object, as in `View`, and the widest field of view of a turntable with balls
and chart: in a wider one what is near would hide them."""


@dataclass(frozen=True)
class TurntableAngle:
    """A mesh frame turned about the vertical by `spin` radians; pictures of a shot have 0.

    lights  turn of the lights about it, radians
    """

    mesh: int
    spin: float = 0.0
    lights: float = 0.0


@dataclass(frozen=True)
class Turntable:
    """A full turn of one mesh frame, and then one of the lights around it.

    The end of a turn, which equals its start, is left out. Numbers of pictures do not depend on the turns
    asked for.

    frames   pictures of a turn: the object's from 1 on, then the lights'
    of_file  True for a mesh file, whose files must not be confused with those of a shot of the same name
    look     the name of its look, if it is one of several with folders of their own
    """

    at: int
    frames: int
    of_file: bool = False
    look: str | None = None

    def numbers(self, turn: str) -> range:
        """Return the numbers of the pictures of one of TURNS."""
        first = 1 + TURNS.index(turn) * self.frames
        return range(first, first + self.frames)

    def angles(self) -> dict[int, TurntableAngle]:
        """Return the angles of all pictures, by number."""
        angles = [2.0 * math.pi * i / self.frames for i in range(self.frames)]
        turned = [TurntableAngle(self.at, spin=angle) for angle in angles]
        lit = [TurntableAngle(self.at, lights=angle) for angle in angles]
        return dict(enumerate(turned + lit, start=1))

    def step(self, number: int) -> float:
        """Return the turn of the object from a picture to the next, radians."""
        return 2.0 * math.pi / self.frames if number in self.numbers("object") else 0.0

    def turn_of(self, numbers: Iterable[int]) -> str | None:
        """Return the one of TURNS that has exactly these pictures, or None."""
        known = {frozenset(self.numbers(turn)): turn for turn in TURNS}
        return known.get(frozenset(numbers))


def framed_whole(view: View) -> View:
    """Return the view from the same side that shows the whole object, with room for balls and chart.

    Distance, aim, roll and lens of the shot at that moment are dropped; so is a wide projection.
    """
    azimuth, elevation = view.azimuth, view.elevation
    if view.position is not None and view.target is not None:
        x, y, z = (a - b for a, b in zip(view.position, view.target, strict=True))
        azimuth, elevation = math.atan2(x, z), math.atan2(y, math.hypot(x, z))
    return view._replace(
        azimuth=azimuth,
        elevation=elevation,
        field_of_view=min(view.field_of_view, WIDEST),
        margin=max(view.margin, MARGIN),
        roll=0.0,
        dolly=1.0,
        distance=None,
        target=None,
        position=None,
        lens=None,
    )


FORMS = tuple(stage.name for stage in STILLS)
"""Forms of stills; a stage has the name of each."""


@dataclass(frozen=True)
class _CamerasKey:
    """The key of cameras, as the planning cache has it."""

    key: Key


@dataclass(frozen=True)
class RenderRequest:
    """Frames of one shot at one quality, rendered by one variant.

    source        what its shot is read from
    quality_name  a quality, or a crop or scale of one
    requested     the numbers of the frames
    home          the folder of its files, if it is not the shot's own; file names and seeds are the same
    """

    source: ShotSource
    quality_name: str
    variant: str
    requested: tuple[int, ...]
    turntable: Turntable | None = None
    home: str | None = None

    def with_cache(self, cache: PlanningCache) -> RenderRequest:
        """Return the request with a cache that spares reading its shot."""
        return replace(self, source=replace(self.source, cache=cache))

    @property
    def shot(self) -> Shot:
        """The shot. Raises what `ShotSource.shot` raises."""
        return self.source.shot

    @cached_property
    def manifest(self) -> ShotManifest:
        """The manifest of the shot, known without reading it where the planning cache has it."""
        return self.source.manifest

    @property
    def name(self) -> str:
        """The shot's name, known without reading it."""
        return self.source.name

    @cached_property
    def parts(self) -> tuple[RenderRequest, ...]:
        """The request for each of several subjects alone, whose meshes are made on their own; or itself."""
        names = self.manifest.subjects
        return tuple(replace(self, source=self.source.of_subject(name)) for name in names) or (self,)

    def of_subject(self, name: str | None) -> RenderRequest:
        """Return the request for one of several subjects alone; without a name, the request itself.

        Raises UsageError for a name that no subject has.
        """
        if name is None:
            return self
        if name not in self.manifest.subjects:
            self.shot.of_subject(name)  # says which there are
        return next(part for part in self.parts if part.source.subject == name)

    # Frames and files

    @cached_property
    def angles(self) -> dict[int, TurntableAngle]:
        """The mesh frame and the turn that each picture of the whole request shows, by number."""
        if self.turntable is None:
            return {number: TurntableAngle(number) for number in self.manifest.frames}
        return self.turntable.angles()

    def whole(self) -> RenderRequest:
        """Return the request of all pictures."""
        return replace(self, requested=tuple(self.angles))

    @property
    def is_whole(self) -> bool:
        """True if all pictures are requested."""
        return set(self.requested) == set(self.angles)

    @cached_property
    def motion_folders(self) -> Folders:
        """The folders of mesh frames: the shot's, for its turntables too."""
        of_file = self.turntable and self.turntable.of_file
        folders = Folders.of_turntable(self.name) if of_file else Folders.of_shot(self.name)
        if self.home is not None:
            folders = Folders(Path(self.home), self.name)
        return replace(folders, subject=self.source.subject)

    @cached_property
    def folders(self) -> Folders:
        """The folders of pictures."""
        if self.turntable is None:
            return self.motion_folders
        name = self.name if self.turntable.of_file else f"{self.name}.{self.turntable.at:04d}"
        name = ".".join(filter(None, (name, self.source.subject)))
        return Folders.of_turntable(name, self.turntable.look)

    def places(self, kind: str, numbers: Iterable[int]) -> list[str]:
        """Return where files are shown: `mesh`, `normals`, `raw`, `frame`, or a form of stills.

        Of several subjects, `mesh` and `normals` are those of the first, then those of the next.
        """
        if kind not in ("mesh", "normals"):
            return self.folders.numbered(kind, self.quality_name, numbers)
        numbers = tuple(numbers)
        folders = [part.motion_folders for part in self.parts]
        return [path for each in folders for path in each.numbered(kind, self.quality_name, numbers)]

    def place(self, kind: str, number: int) -> Path:
        return Path(self.places(kind, (number,))[0])

    @property
    def movie_path(self) -> Path:
        """The path of the movie: of the whole request, of one turn, or of a range of frames."""
        if self.is_whole:
            return self.folders.movie(self.quality_name)
        turn = self.turntable and self.turntable.turn_of(self.requested)
        return self.folders.movie(self.quality_name, turn or str(FrameRange.of(self.requested)))

    @property
    def subject(self) -> str:
        """The name in events and messages: the shot or the turntable, with its look or folder."""
        if self.turntable and self.turntable.look:
            return f"{self.folders.name} ({self.turntable.look})"
        if self.source.subject and self.turntable is None:
            return f"{self.folders.name} ({self.source.subject})"
        return self.folders.name if self.home is None else f"{self.name} ({Path(self.home).name})"

    @property
    def label(self) -> str:
        """A name for its jobs."""
        parts = [
            self.folders.name,
            self.quality_name,
            "turntable" if self.turntable else "",
            self.source.subject,
        ]
        return "_".join(filter(None, parts))

    # What a picture shows

    @cached_property
    def quality(self) -> Quality:
        """The quality of all frames but those whose override has another.

        Raises UsageError for a crop of a picture with a wide projection, or of a larger picture.
        """
        if self.is_wide and crop_of(self.quality_name):
            raise UsageError(
                f"{self.name}: a picture of projection {self.manifest.projection[0]} has no crop, since "
                "players and denoising need all of it; use --scale instead of --crop"
            )
        return quality_named(self.quality_name, self._qualities(self.manifest.qualities))

    def quality_of(self, number: int) -> Quality:
        """Return the quality of a frame; size, crop and denoising are those of all frames."""
        if self.override_of(number) is None:
            return self.quality
        return quality_named(self.quality_name, self._qualities(self.picture(number).qualities))

    def _qualities(self, qualities: Mapping[str, Quality]) -> Mapping[str, Quality]:
        """Return qualities of its pictures; those of a turntable, seen in perspective, are not wide."""
        if self.turntable is None or not self.manifest.is_wide:
            return qualities
        sizes = {name: (flat.width, flat.height) for name, flat in QUALITIES.items()}
        return {
            name: replace(quality, width=sizes[name][0], height=sizes[name][1])
            for name, quality in qualities.items()
        }

    @property
    def aspect(self) -> float:
        """Width to height of whole pictures in `final`, the same for all qualities; others round theirs."""
        return self._qualities(self.shot.picture.qualities)["final"].aspect

    @property
    def flat_aspect(self) -> float | None:
        """The aspect of pictures with edges; None where the projection is wide."""
        is_wide = self.turntable is None and self.shot.picture.camera.projection.is_wide
        return None if is_wide else self.aspect

    @property
    def is_wide(self) -> bool:
        """True for all projections but a perspective, in which a turntable is always seen."""
        return self.turntable is None and self.manifest.is_wide

    @property
    def stages(self) -> Mapping[str, str]:
        """The settings by stage of plug-ins' stages between `render` and `finish`; turntables have none."""
        return {} if self.turntable else self.manifest.stages

    @property
    def shown_as(self) -> Mapping[str, Any]:
        """The display transform of its pictures, plain data."""
        return self.manifest.shown_as

    def seed(self, number: int) -> int:
        from flowsculpt.render.frame.batch_schedule import seed_of

        return seed_of(self.folders.name, number)

    @property
    def follow(self) -> float:
        """The share by which the camera follows the sculpture, 0 to 1; that of a turntable stands still."""
        return 0.0 if self.turntable else self.shot.picture.camera.follow

    @property
    def is_round(self) -> bool:
        """True if the first frame follows the last, as in a loop without a dissolve."""
        loop = self.manifest.loop
        return self.turntable is None and loop is not None and loop[0] != "dissolve"

    def view(self, number: int) -> View:
        """Return the view of a picture. A turntable stands still, and its stage needs the object in frame."""
        view = self.shot.picture.camera.at(self._time(number))
        is_framed_whole = self.shot.picture.stage.kind == "turntable" or view.wide is not None
        return framed_whole(view) if self.turntable and is_framed_whole else view

    @property
    def projection(self) -> Projection:
        """The projection of its pictures: the shot's, but a turntable is always seen in perspective."""
        from flowsculpt.render.scene.render_camera import (  # numpy, which planning does without
            PERSPECTIVE,
            Projection,
        )

        return PERSPECTIVE if self.turntable else Projection(*self.manifest.projection)

    def open_at(self, number: int) -> tuple[float, float] | None:
        """Return when the shutter opens and closes, in frames from the picture; None without motion blur."""
        return self.shot.picture.shutter.open_at(self._time(number))

    def override_of(self, number: int) -> int | None:
        """Return the index of the override that a frame has, or None. A turntable has none."""
        return None if self.turntable else self.manifest.override_of(number)

    def picture(self, number: int) -> Picture:
        """Return what decides how a frame looks: the shot's picture, with its override if it has one.

        It comes from the shot itself, for live edits have no manifest. A turntable has none.
        """
        picture = self.shot.picture
        overrides = () if self.turntable else picture.overrides
        override = next((each for each in overrides if number in each.frames), None)
        return picture if override is None else picture.overridden(override)

    def _time(self, number: int) -> float:
        return self.shot.motion.clock.time(self.angles[number].mesh)

    @cached_property
    def reach(self) -> int:
        """Frames to either side that the temporal denoiser reads; none without denoising."""
        return 0 if self.quality.denoise == "off" else self.quality.temporal_denoise

    def window(self, number: int, is_available: Callable[[int], bool]) -> tuple[int, ...]:
        """Return the frames that the temporal denoiser reads: available ones around `number`, no gaps.

        They have its look and lights.
        """
        first = last = number
        reach = self.reach
        style_of = (lambda _: None) if self.turntable else self.manifest.style_of

        def is_alike(other: int) -> bool:
            return style_of(other) == style_of(number) and is_available(other)

        while number - first < reach and is_alike(first - 1):
            first -= 1
        while last - number < reach and is_alike(last + 1):
            last += 1
        return tuple(range(first, last + 1))

    @cached_property
    def measures_speed(self) -> bool:
        """True if the colours of its pictures, or of one of its subjects, are the speed of the flow."""
        return measures_speed(self.shot)

    @cached_property
    def _needs_offsets(self) -> bool:
        """True if temporal denoising or motion vectors need where the surface is at other frames."""
        return bool(self.reach or self.manifest.layers)

    def follows_flow(self, number: int) -> bool:
        """Tell whether a picture needs its mesh and the flow; those of a turntable only turn."""
        manifest = self.manifest
        if manifest.measures_speed or self.turntable:
            return manifest.measures_speed
        return manifest.shows_motion or self._needs_offsets or manifest.is_blurred(number)

    def needs_mesh(self, number: int) -> bool:
        """Tell whether a picture is made of its mesh itself."""
        return self.manifest.is_diced or self.follows_flow(number)

    @cached_property
    def aovs(self) -> AovSelection:
        """AOVs the shot requests, plus `before` and `after` for temporal denoising and motion vectors."""
        aovs = self.shot.picture.aovs
        return aovs.adding("before", "after") if self._needs_offsets else aovs

    @cached_property
    def copies(self) -> dict[str, int]:
        """The number of copies by subject, where layers tell copies apart: of subjects that have some."""
        if self.shot.picture.layers is None:
            return {}
        named = {part.subject or "": part.motion.copies for part in self.shot.parts}
        return {name: copies.count for name, copies in named.items() if copies is not None}

    def offsets(self, number: int) -> tuple[float, ...]:
        """Return the other moments that shutter and AOVs of a picture show, in frames from its own."""
        return (*(self.open_at(number) or ()), *self._offsets_of_aovs)

    @cached_property
    def _offsets_of_aovs(self) -> tuple[float, ...]:
        from flowsculpt.pipeline.production.request.shading import STEP

        steps = {"velocity": (-STEP, STEP), "motion": (1.0,), "after": (1.0,), "before": (-1.0,)}
        return tuple(offset for name in self.aovs.extra for offset in steps.get(name, ()))

    # Keys

    @cached_property
    def identity(self) -> Key:
        """The digest of everything that its keys depend on, except versions of stages."""
        data = {**to_plain(self), "requested": None}
        data["source"] = {**data["source"], "inputs": self.manifest.inputs}
        return key_of(data, self.source.surface_keys.meshes, self.source.surface_keys.normals)

    def mesh_key(self, number: int) -> Key:
        return self.source.surface_keys.meshes[number]

    def normals_key(self, number: int) -> Key:
        return self.source.surface_keys.normals[number]

    @cached_property
    def cameras_key(self) -> Key:
        """The key of its cameras, which depend on all meshes that it shows."""
        found_from = "cameras", *self.source.read_from, self.manifest.inputs, to_plain(self.turntable)
        return self.source.cache.found_or_made(_CamerasKey, self._cameras_key, *found_from).key

    def _cameras_key(self) -> _CamerasKey:
        """Find the key of its cameras from the shot."""
        shown = sorted({angle.mesh for angle in self.angles.values()})
        key = key_of(
            FRAME_CAMERA.recipe,
            [self.mesh_key(n) for n in shown],
            [[n, angle.mesh, angle.spin, self.view(n)] for n, angle in self.angles.items()],
            self.aspect,
            self.follow,
            self.net_pieces(),
            self.shot.picture.stage.camera_move(self.flat_aspect),
            *(["round"] if self.is_round else []),
        )
        return _CamerasKey(key)

    def net_pieces(self) -> int | list[Any] | None:
        """Return the pieces into which the surface of a net is cut for its cameras; None for other subjects.

        Of several subjects, a list.
        """
        from flowsculpt.pipeline.shot.point_subjects import ControlNet

        if self.shot.subjects:
            return [part.net_pieces() for part in self.parts]
        is_net = isinstance(self.shot.motion.subject, ControlNet)
        return self.shot.picture.tessellate if is_net else None

    def appearance(self, number: int) -> Key:
        """Return the digest of what a picture shares with all others of its look, lights and quality."""
        override = self.override_of(number)
        if override not in self._appearances:
            self._appearances[override] = self._appearance(number)
        return self._appearances[override]

    @cached_property
    def _appearances(self) -> dict[int | None, Key]:
        """Digests by override, as `appearance` found them."""
        return {}

    def _appearance(self, number: int) -> Key:
        picture = self.picture(number)
        parts = [(part.source.subject, part.picture(number)) for part in self.parts]
        looks = [[name, to_plain(part.look), part.hide_facets] for name, part in parts]
        return key_of(
            to_plain(picture.look),
            to_plain(replace(picture.lights, exposure=0.0)),
            to_plain(picture.stage),
            to_plain(self.quality_of(number)),
            self.variant,
            picture.dicing,
            picture.hide_facets,
            *([looks] if self.shot.subjects else []),
        )

    def still_key(self, form: str, frame: Key) -> Key:
        return key_of(STAGES[form].recipe, frame, self.shown_as)

    @property
    def sounds(self) -> tuple[AudioClip, ...]:
        """The sound of its movie; turntables have none."""
        if self.turntable is not None:
            return ()
        return sound_of_frames(self.manifest.sounds, sorted(self.angles), sorted(self.requested))

    def movie_key(self, frames: list[Key]) -> Key:
        rate, bits = self.manifest.rate, movie_bits(self.quality_name)
        sounds = [[sound.content for sound in self.sounds]] if self.sounds else []
        loop = [] if self.loop is None else [["loop", *self.loop]]
        return key_of(ASSEMBLE.recipe, frames, rate, self.shown_as, bits, *sounds, *loop)

    @property
    def loop(self) -> tuple[str, int] | None:
        """Kind and count of its movie's loop, of `Loop` in `motion`; None for a part of the shot."""
        return self.manifest.loop if self.is_whole and self.turntable is None else None
