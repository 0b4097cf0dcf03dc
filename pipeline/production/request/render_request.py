"""Render requests: which frames of a shot are rendered, at which quality, and where their files lie.

How they look is said by `RequestPictures`, and the keys of their files by `RequestKeys` in `keys.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.plugin import named, plugins
from flowsculpt.pipeline.production.request.audio import AudioClip, sound_of_frames
from flowsculpt.pipeline.production.request.cameras import CameraFile, stored_framings
from flowsculpt.pipeline.production.request.keys import RequestKeys
from flowsculpt.pipeline.production.request.lookup import QualityName, movie_bits, quality_named
from flowsculpt.pipeline.production.request.manifest import ShotManifest
from flowsculpt.pipeline.production.request.shot_source import PlanningCache, ShotSource
from flowsculpt.pipeline.production.stages import STILLS
from flowsculpt.pipeline.production.store.paths import Folders
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.base.serialise import named_by_kind
from flowsculpt.render.scene.render_quality import Quality

if TYPE_CHECKING:
    from flowsculpt.pipeline.shot import Shot
    from flowsculpt.pipeline.shot.camera_path import View
    from flowsculpt.pipeline.shot.shot import AovSelection, Picture
    from flowsculpt.render.graphics.cards import Screen
    from flowsculpt.render.movie.codecs import Encode
    from flowsculpt.render.scene.render_camera import Projection

FORMS = tuple(stage.name for stage in STILLS)
"""Forms of stills; a stage has the name of each."""


@dataclass(frozen=True)
class MeshAngle:
    """A mesh frame turned about the vertical by `spin` radians; frames of a shot have 0.

    lights  turn of the lights about it, radians
    """

    mesh: int
    spin: float = 0.0
    lights: float = 0.0


class FrameSource(Protocol):
    """The mesh frames that the pictures of a request show, how they are seen, and where the files lie.

    Sources of plug-ins are frozen dataclasses; a plan holds one under its kind, a name in `frame_sources`.

    kind       that name; empty for a shot's own frames
    is_turned  True if the shot is only turned: seen in perspective, without its sounds, overrides, loop and
               stages of plug-ins
    """

    kind: ClassVar[str]
    is_turned: ClassVar[bool]

    def angles(self, frames: Iterable[int]) -> dict[int, MeshAngle]:
        """Return what each picture shows, by number, of a shot with these frames."""

    def turn(self, number: int) -> float | None:
        """Return the turn from a picture to the next, radians; None where the flow moves the surface."""

    def adapt_shot(self, shot: Shot) -> Shot:
        """Return a shot as its pictures are seen."""

    def mesh_folders(self, name: str) -> Folders:
        """Return the folders of the mesh frames of a shot."""

    def picture_folders(self, meshes: Folders) -> Folders:
        """Return the folders of the pictures, by those of the mesh frames."""

    def part_name(self, numbers: FrameRange) -> str:
        """Return the part of the name of a movie of some pictures that says which."""


@dataclass(frozen=True)
class ShotFrames:
    """The frames of a shot as it shows them: each mesh frame once."""

    kind: ClassVar[str] = ""
    is_turned: ClassVar[bool] = False

    def angles(self, frames: Iterable[int]) -> dict[int, MeshAngle]:
        return {number: MeshAngle(number) for number in frames}

    def turn(self, number: int) -> float | None:
        return None

    def adapt_shot(self, shot: Shot) -> Shot:
        return shot

    def mesh_folders(self, name: str) -> Folders:
        return Folders.of_shot(name)

    def picture_folders(self, meshes: Folders) -> Folders:
        return meshes

    def part_name(self, numbers: FrameRange) -> str:
        return str(numbers)


def _source_of_kind(kind: str) -> type | None:
    """Return the class of a plug-in's source of frames; None where no plug-in has that kind."""
    place = plugins().frame_sources.get(kind)
    return named(place) if place else None


@dataclass(frozen=True)
class RenderRequest:
    """Frames of one shot at one quality, rendered by one variant.

    source        what its shot is read from
    quality_name  a quality, or a crop or scale of one
    requested     the numbers of the frames
    frame_source  what the frames show of the shot
    home          the folder of its files, if it is not the shot's own; file names and seeds are the same
    """

    source: ShotSource
    quality_name: str
    variant: str
    requested: FrameRange
    frame_source: FrameSource = field(default=ShotFrames(), metadata=named_by_kind(_source_of_kind))
    home: str | None = None

    def with_cache(self, root: Path) -> RenderRequest:
        """Return the request with the planning cache of a root, which spares reading its shot."""
        return replace(self, source=replace(self.source, cache=PlanningCache(root)))

    @cached_property
    def shot(self) -> Shot:
        """The shot as its pictures are seen. Raises what `ShotSource.shot` raises."""
        return self.frame_source.adapt_shot(self.source.shot)

    @cached_property
    def manifest(self) -> ShotManifest:
        """The manifest of the shot, known without reading it where the planning cache has it."""
        manifest = self.source.manifest
        return manifest.only_turned() if self.frame_source.is_turned else manifest

    @cached_property
    def pictures(self) -> RequestPictures:
        """How its frames look."""
        return RequestPictures(self)

    @cached_property
    def keys(self) -> RequestKeys:
        """The keys of its files."""
        return RequestKeys(self)

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

    # Frames

    @cached_property
    def angles(self) -> dict[int, MeshAngle]:
        """The mesh frame and the turn that each picture of the whole request shows, by number."""
        return self.frame_source.angles(self.manifest.frames)

    def meshes(self, numbers: Iterable[int]) -> list[int]:
        """Return the mesh frames that pictures show, in ascending order."""
        return sorted({self.angles[number].mesh for number in numbers})

    def whole(self) -> RenderRequest:
        """Return the request of all pictures."""
        return replace(self, requested=FrameRange(self.angles))

    @property
    def is_whole(self) -> bool:
        """True if all pictures are requested."""
        return set(self.requested) == set(self.angles)

    def seed(self, number: int) -> int:
        """Return the seed of a picture's samples."""
        from flowsculpt.render.frame.batch_schedule import seed_of

        return seed_of(self.folders.name, number)

    @property
    def sounds(self) -> tuple[AudioClip, ...]:
        """The sound of its movie."""
        return sound_of_frames(self.manifest.sounds, sorted(self.angles), sorted(self.requested))

    @property
    def loop(self) -> tuple[str, int] | None:
        """Kind and count of its movie's loop, of `Loop` in `motion`; None for a part of the shot."""
        return self.manifest.loop if self.is_whole else None

    # Files

    @property
    def loop_dissolve(self) -> int:
        """Frames by which the movie of a loop is shorter than its shot, as they dissolve; 0 of others."""
        return 0 if self.loop is None else self.loop[1]

    @cached_property
    def motion_folders(self) -> Folders:
        """The folders of mesh frames."""
        own = self.frame_source.mesh_folders(self.name)
        folders = own if self.home is None else Folders(Path(self.home), self.name)
        return replace(folders, subject=self.source.subject)

    @cached_property
    def folders(self) -> Folders:
        """The folders of pictures."""
        return self.frame_source.picture_folders(self.motion_folders)

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
        """Return where one file is shown."""
        return Path(self.places(kind, (number,))[0])

    @property
    def movie_path(self) -> Path:
        """The path of the movie: of the whole request, or of a part of it."""
        part = None if self.is_whole else self.frame_source.part_name(self.requested)
        return self.folders.movie(self.quality_name, part)

    @property
    def label(self) -> str:
        """A name for its jobs."""
        parts = self.folders.name, self.quality_name, self.frame_source.kind, self.source.subject
        return "_".join(filter(None, parts))


@dataclass(frozen=True)
class RequestPictures:
    """How the frames of a request look."""

    request: RenderRequest

    @cached_property
    def quality(self) -> Quality:
        """The quality of all frames but those whose override has another.

        Raises UsageError for a crop of a picture with a wide projection, or of a larger picture.
        """
        request, manifest = self.request, self.request.manifest
        if manifest.is_wide and QualityName.of(request.quality_name).crop:
            raise UsageError(
                f"{request.name}: a picture of projection {manifest.projection[0]} has no crop, since "
                "players and denoising need all of it; use --scale instead of --crop"
            )
        return quality_named(request.quality_name, manifest.qualities)

    def quality_of(self, number: int) -> Quality:
        """Return the quality of a frame; size, crop and denoising are those of all frames."""
        if self.request.manifest.override_of(number) is None:
            return self.quality
        return quality_named(self.request.quality_name, self.of(number).qualities)

    @property
    def aspect(self) -> float:
        """Width to height of whole pictures in `final`, the same for all qualities; others round theirs."""
        return self.request.shot.picture.qualities["final"].aspect

    @property
    def flat_aspect(self) -> float | None:
        """The aspect of pictures with edges; None where the projection is wide."""
        return None if self.request.shot.picture.camera.projection.is_wide else self.aspect

    @property
    def projection(self) -> Projection:
        """The projection of the pictures."""
        from flowsculpt.render.scene.render_camera import Projection  # numpy, which planning does without

        return Projection(*self.request.manifest.projection)

    @property
    def screen(self) -> Screen:
        """Where cards stand in the pictures."""
        from flowsculpt.render.graphics.cards import Screen

        return Screen(self.projection, self.quality.rendered_size)

    @property
    def movie_encode(self) -> Encode:
        """The encode of movies and films: 10 bits keep gradients smooth, 8 play everywhere."""
        from flowsculpt.render.movie.codecs import H264, H264_8_BITS

        return H264 if movie_bits(self.request.quality_name) == 10 else H264_8_BITS

    @property
    def is_round(self) -> bool:
        """True if the first frame follows the last, as in a loop without a dissolve."""
        loop = self.request.manifest.loop
        return loop is not None and loop[0] != "dissolve"

    def view(self, number: int) -> View:
        """Return the view of a picture."""
        return self.request.shot.picture.camera.at(self._time(number))

    def open_at(self, number: int) -> tuple[float, float] | None:
        """Return when the shutter opens and closes, in frames from the picture; None without motion blur."""
        return self.request.shot.picture.shutter.open_at(self._time(number))

    def of(self, number: int) -> Picture:
        """Return what decides how a frame looks: the shot's picture, with its override if it has one.

        It comes from the shot itself, for live edits have no manifest.
        """
        picture = self.request.shot.picture
        override = next((each for each in picture.overrides if number in each.frames), None)
        return picture if override is None else picture.overridden(override)

    def _time(self, number: int) -> float:
        return self.request.shot.motion.clock.time(self.request.angles[number].mesh)

    @cached_property
    def reach(self) -> int:
        """Frames to either side that the temporal denoiser reads; none without denoising."""
        return 0 if self.quality.denoise == "off" else self.quality.temporal_denoise

    def window(self, number: int, is_available: Callable[[int], bool]) -> tuple[int, ...]:
        """Return the frames that the temporal denoiser reads: available ones around `number`, no gaps.

        They have its look and lights.
        """
        first = last = number
        reach, style_of = self.reach, self.request.manifest.style_of

        def is_alike(other: int) -> bool:
            return style_of(other) == style_of(number) and is_available(other)

        while number - first < reach and is_alike(first - 1):
            first -= 1
        while last - number < reach and is_alike(last + 1):
            last += 1
        return tuple(range(first, last + 1))

    def framings(self, store: Store) -> CameraFile | None:
        """Return camera and stage of every picture; None where the store does not hold them.

        A damaged file is evicted. Raises MachineError where the disk refuses one of the remote store.
        """
        return stored_framings(self.request, store)

    @cached_property
    def measures_speed(self) -> bool:
        """True if the colours of the pictures, or of one of the subjects, are the speed of the flow."""
        return self.request.shot.measures_speed

    @cached_property
    def _needs_offsets(self) -> bool:
        """True if temporal denoising or motion vectors need where the surface is at other frames."""
        return bool(self.reach or self.request.manifest.layers)

    def follows_flow(self, number: int) -> bool:
        """Tell whether a picture needs its mesh and the flow; of meshes that only turn, those with speeds."""
        manifest = self.request.manifest
        if manifest.measures_speed or self.request.frame_source.turn(number) is not None:
            return manifest.measures_speed
        return manifest.shows_motion or self._needs_offsets or manifest.is_blurred(number)

    def needs_mesh(self, number: int) -> bool:
        """Tell whether a picture is made of its mesh itself."""
        return self.request.manifest.is_diced or self.follows_flow(number)

    @cached_property
    def aovs(self) -> AovSelection:
        """AOVs the shot requests, plus `before` and `after` for temporal denoising and motion vectors."""
        aovs = self.request.shot.picture.aovs
        return aovs.adding("before", "after") if self._needs_offsets else aovs

    @cached_property
    def copies(self) -> dict[str, int]:
        """The number of copies by subject, where layers tell copies apart: of subjects that have some."""
        shot = self.request.shot
        if shot.picture.layers is None:
            return {}
        named = {part.subject or "": part.motion.copies for part in shot.parts}
        return {name: copies.count for name, copies in named.items() if copies is not None}

    def offsets(self, number: int) -> tuple[float, ...]:
        """Return the other moments that shutter and AOVs of a picture show, in frames from its own."""
        return (*(self.open_at(number) or ()), *self._offsets_of_aovs)

    @cached_property
    def _offsets_of_aovs(self) -> tuple[float, ...]:
        from flowsculpt.pipeline.shot.motion import VELOCITY_STEP

        steps = {
            "velocity": (-VELOCITY_STEP, VELOCITY_STEP),
            "motion": (1.0,),
            "after": (1.0,),
            "before": (-1.0,),
        }
        return tuple(offset for name in self.aovs.extra for offset in steps.get(name, ()))
