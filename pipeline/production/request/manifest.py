"""The manifest of a shot: all that planning, tasks and status need of it, compiled once from its files.

The keys of its surfaces stand apart: to compute them, the flows of all frames are evaluated, and frames that
were never made need none.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flowsculpt.pipeline.errors import MissingInputError
from flowsculpt.pipeline.production.request.audio import AudioTrack
from flowsculpt.pipeline.production.stages import PLUGIN_STAGES, SIMULATE, SMOOTH_NORMALS
from flowsculpt.pipeline.production.store.paths import STATE
from flowsculpt.pipeline.production.store.store import Key, key_of
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.kept_digests import KeptDigests
from flowsculpt.render.scene.render_quality import Quality, flat_qualities

if TYPE_CHECKING:  # reading shots takes a second; planning spares it where the cache holds all
    from flowsculpt.pipeline.shot import Motion, Shot
    from flowsculpt.pipeline.shot.motion import AnimatedSubject

InputDigests = tuple[tuple[str, str], ...]
"""Paths of the files that a shot reads, in order, and the SHA-256 of their contents."""

MOVING_AOVS = {"velocity", "motion", "after", "before"}
"""AOVs that show where the surface is at other moments."""


@dataclass(frozen=True)
class ShotManifest:
    """A shot as planning, tasks and status see it.

    inputs           the files that it reads, and their digests
    listings         folders of these files, and digests of the names in them: a name with * may match more
    runs_python      True if its flows are Python files of the user's
    rate, shown_as   frames per second; the display transform, plain data
    sounds           what is heard while it plays
    subjects         the names of its subjects, if it has several
    projection       of its camera: kind and angle, as `Projection` has them
    qualities        by name: of all frames but those whose override has another
    precision        AOVs that it names, and `half` or `float`
    layers           the program whose channel names finished frames have; None without layers for compositing
    blurred          frames whose shutter is open for some time
    shows_motion     True if it names one of MOVING_AOVS
    measures_speed   True if the colours of a subject are the speed of the flow
    is_diced         True if pictures are made of meshes themselves, not of what `smooth_normals` keeps
    overrides        frames of each override
    restyled         frames whose look or lights an override changes
    stages           settings, as JSON, by the stages of plug-ins that it asks for
    loop             how it loops, and the frames of its dissolve: `Loop` as plain data; or None
    """

    inputs: InputDigests
    listings: tuple[tuple[str, str], ...]
    runs_python: bool
    frames: tuple[int, ...]
    rate: str
    shown_as: Mapping[str, Any]
    sounds: tuple[AudioTrack, ...]
    subjects: tuple[str, ...]
    projection: tuple[str, float]
    qualities: Mapping[str, Quality]
    precision: tuple[tuple[str, str], ...]
    layers: str | None
    blurred: tuple[int, ...]
    shows_motion: bool
    measures_speed: bool
    is_diced: bool
    overrides: tuple[tuple[int, ...], ...]
    restyled: tuple[int, ...]
    stages: Mapping[str, str]
    loop: tuple[str, int] | None

    @classmethod
    def of(cls, shot: Shot) -> ShotManifest:
        """Compile the manifest of a shot."""
        from flowsculpt.pipeline.flow.flow import foreign_flows

        inputs, picture, clock = input_digests(shot.files), shot.picture, shot.motion.clock
        return cls(
            inputs=inputs,
            listings=_listings(inputs),
            runs_python=any(True for part in shot.parts for _ in foreign_flows(part.motion.flow)),
            frames=shot.frames.numbers,
            rate=str(shot.rate),
            shown_as=picture.display.data,
            sounds=tuple(map(AudioTrack.of, shot.sounds)),
            subjects=tuple(part.subject for part in shot.subjects),
            projection=astuple(picture.camera.projection),
            qualities=dict(picture.qualities),
            precision=tuple(picture.aovs.precision),
            layers=picture.layers,
            blurred=tuple(n for n in shot.frames if picture.shutter.open_at(clock.time(n))),
            shows_motion=not MOVING_AOVS.isdisjoint(picture.aovs.extra),
            measures_speed=shot.measures_speed,
            is_diced=picture.dicing is not None,
            overrides=tuple(override.frames.numbers for override in picture.overrides),
            restyled=tuple(n for override in picture.overrides if override.is_seen for n in override.frames),
            stages=_stages(shot.entries),
            loop=None if shot.loop is None else astuple(shot.loop),
        )

    @property
    def is_current(self) -> bool:
        """True if all files that the shot reads, shot files aside, are as they were."""
        return next(changed_inputs(self.inputs), None) is None and _listings(self.inputs) == self.listings

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of its pictures in `final`, pixels."""
        return self.qualities["final"].rendered_size

    @property
    def is_wide(self) -> bool:
        """True for all projections but a perspective."""
        return self.projection[0] != "perspective"

    def only_turned(self) -> ShotManifest:
        """Return that of the shot turned before a still camera: in perspective, and nothing else it has."""
        rest = replace(self, sounds=(), overrides=(), restyled=(), stages={}, loop=None)
        if not self.is_wide:
            return rest
        from flowsculpt.render.scene.render_camera import PERSPECTIVE  # numpy, which planning does without

        return replace(rest, projection=astuple(PERSPECTIVE), qualities=flat_qualities(self.qualities))

    def is_blurred(self, number: int) -> bool:
        """Tell whether the shutter of a frame is open for some time."""
        return number in self._blurred

    def override_of(self, number: int) -> int | None:
        """Return the index of the override that a frame has, or None."""
        return self._overridden.get(number)

    def style_of(self, number: int) -> int | None:
        """Return the index of the override of a frame whose look or lights are not the shot's, else None."""
        return self._styles.get(number)

    @cached_property
    def _blurred(self) -> frozenset[int]:
        return frozenset(self.blurred)

    @cached_property
    def _overridden(self) -> Mapping[int, int]:
        return {number: index for index, numbers in enumerate(self.overrides) for number in numbers}

    @cached_property
    def _styles(self) -> Mapping[int, int]:
        return {number: self._overridden[number] for number in self.restyled}


@dataclass(frozen=True)
class SurfaceKeys:
    """Keys of mesh frames and of their normals, by frame; of several subjects, digests of both."""

    meshes: Mapping[int, Key]
    normals: Mapping[int, Key]

    @classmethod
    def of(cls, shot: Shot) -> SurfaceKeys:
        """Return the keys of a shot of one subject."""
        meshes = mesh_keys(shot.motion)
        return cls(meshes, normals_keys(shot, meshes))

    @classmethod
    def join(cls, frames: Iterable[int], parts: Mapping[str, SurfaceKeys]) -> SurfaceKeys:
        """Return digests of the keys of several subjects, with their names, which pictures show."""
        return cls(
            {n: key_of([[name, keys.meshes[n]] for name, keys in parts.items()]) for n in frames},
            {n: key_of([[name, keys.normals[n]] for name, keys in parts.items()]) for n in frames},
        )


def mesh_keys(motion: Motion) -> dict[int, Key]:
    """Return keys by frame: each is made of the one before and of what acts between the two frames.

    Frames that are given do not follow from those before: of these, only flows after the model count.
    """
    from flowsculpt.pipeline.shot.motion import given_subject

    if (subject := given_subject(motion)) is not None:
        return _given_keys(subject)
    key = key_of(SIMULATE.recipe, motion.start_data())
    first, *others = sorted(motion.frames)
    keys = {first: key}
    for number in others:
        try:
            key = key_of(key, motion.step_data(number, is_checked=False))
        except ValueError:  # NaN or infinity
            key = key_of(key, motion.step_data(number))
        keys[number] = key
    return keys


def _given_keys(subject: AnimatedSubject) -> dict[int, Key]:
    motion = subject.motion
    start, after = {**motion.start_data(), "given": None}, motion.without_animation
    key, first, keys = key_of(SIMULATE.recipe, start), motion.frames.first, {}
    for number in sorted(motion.frames):
        if number > first and after.flow.members:
            key = key_of(key, after.acting_data(number))
        keys[number] = key_of(key, subject.data(number))
    return keys


def normals_keys(shot: Shot, meshes: Mapping[int, Key]) -> dict[int, Key]:
    """Return keys by frame of a shot of one subject; `meshes` are the keys of its meshes."""
    from flowsculpt.pipeline.shot.subjects import as_data

    motion, pieces = shot.motion, shot.picture.tessellate
    first = motion.thresholds_at(motion.frames.first).hard_angle
    is_constant = motion.resampling is None or isinstance(motion.resampling.thresholds.hard_angle, float)
    keys = {}
    for number, mesh in meshes.items():
        angle = first if is_constant else motion.thresholds_at(number).hard_angle
        keys[number] = key_of(SMOOTH_NORMALS.recipe, mesh, as_data(angle), pieces)
    return keys


def _stages(entries: Mapping[str, Any]) -> dict[str, str]:
    """Return the settings by stage of those entries of a shot that ask for a plug-in's stage."""
    asked = [stage.name for stage in PLUGIN_STAGES if stage.name in entries]
    return {name: json.dumps(entries[name].model_dump(mode="json"), sort_keys=True) for name in asked}


def input_digests(files: Iterable[tuple[Path, str]]) -> InputDigests:
    """Return paths and digests in the order of the paths."""
    return tuple(sorted((str(path), digest) for path, digest in files))


def changed_inputs(inputs: InputDigests) -> Iterator[str]:
    """Yield the paths of the files that are not as they were."""
    for path, digest in inputs:
        try:
            now = _kept(path) or InputFile(Path(path)).digest()
        except MissingInputError:
            now = ""
        if now != digest:
            yield path


def _kept(path: str) -> str | None:
    """Return the digest of one of the files of a sequence, if it has not changed since that was kept."""
    folder, _, name = path.rpartition("/")
    return KeptDigests.of(Path(folder)).known(name)


def _listings(inputs: InputDigests) -> tuple[tuple[str, str], ...]:
    def names_in(folder: Path) -> str:
        try:
            return key_of(sorted(path.name for path in folder.iterdir() if path.name != STATE.name))
        except OSError:
            return ""

    return tuple(
        (str(folder), names_in(folder)) for folder in sorted({Path(path).parent for path, _ in inputs})
    )
