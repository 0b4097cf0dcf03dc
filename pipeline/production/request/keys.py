"""The keys of a request's files: digests of all that these are made from; and the headers that repeat it.

Meshes and normals are keyed by the motion of a shot, each mesh by the one before it. Pictures are keyed by
normals, camera and appearance; their keys are worked out when they are needed, since most runs need few.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.production.request.cameras import CameraFile
from flowsculpt.pipeline.production.request.lookup import movie_bits
from flowsculpt.pipeline.production.stages import (
    ASSEMBLE,
    FINISH,
    FRAME_CAMERA,
    RENDER,
    SIMULATE,
    SMOOTH_NORMALS,
    STAGES,
)
from flowsculpt.pipeline.production.store.store import Key, Store, key_of
from flowsculpt.render.base.serialise import from_plain, to_plain

if TYPE_CHECKING:
    from flowsculpt.pipeline.production.request.framing import Framing
    from flowsculpt.pipeline.production.request.render_request import RenderRequest
    from flowsculpt.render.scene.render_camera import Projection


@dataclass(frozen=True)
class _CamerasKey:
    """The key of cameras, as the planning cache has it."""

    key: Key


@dataclass(frozen=True)
class RequestKeys:
    """The keys of the files of a request."""

    request: RenderRequest

    @cached_property
    def identity(self) -> Key:
        """The digest of everything that the keys depend on, except versions of stages."""
        source = self.request.source
        data = {**to_plain(self.request), "requested": None}
        data["source"] = {**data["source"], "inputs": self.request.manifest.inputs}
        return key_of(data, source.surface_keys.meshes, source.surface_keys.normals)

    def mesh(self, number: int) -> Key:
        """Return the key of a mesh frame."""
        return self.request.source.surface_keys.meshes[number]

    def normals(self, number: int) -> Key:
        """Return the key of the normals of a mesh frame."""
        return self.request.source.surface_keys.normals[number]

    @cached_property
    def cameras(self) -> Key:
        """The key of the cameras, which depend on all meshes that the pictures show."""
        source = self.request.source
        kind = self.request.frame_source.kind, to_plain(self.request.frame_source)
        found_from = "cameras", *source.read_from, self.request.manifest.inputs, kind
        return source.cache.found_or_made(_CamerasKey, self._find_cameras, *found_from).key

    def _find_cameras(self) -> _CamerasKey:
        """Find the key of the cameras from the shot."""
        request, pictures = self.request, self.request.pictures
        angles, stage = request.angles, request.shot.picture.stage
        key = key_of(
            FRAME_CAMERA.recipe,
            [self.mesh(n) for n in request.meshes(angles)],
            [[n, angle.mesh, angle.spin, pictures.view(n)] for n, angle in angles.items()],
            pictures.aspect,
            request.shot.picture.camera.follow,
            self.net_pieces(),
            stage.camera_move(pictures.flat_aspect),
            *(["round"] if pictures.is_round else []),
        )
        return _CamerasKey(key)

    def net_pieces(self) -> int | list[Any] | None:
        """Return the pieces into which the surface of a net is cut for its cameras; None for other subjects.

        Of several subjects, a list.
        """
        shot = self.request.shot
        if shot.subjects:
            return [part.keys.net_pieces() for part in self.request.parts]
        return shot.picture.tessellate if shot.motion.subject.is_net else None

    def appearance(self, number: int) -> Key:
        """Return the digest of what a picture shares with all others of its look, lights and quality."""
        override = self.request.manifest.override_of(number)
        if override not in self._appearances:
            self._appearances[override] = self._find_appearance(number)
        return self._appearances[override]

    @cached_property
    def _appearances(self) -> dict[int | None, Key]:
        """Digests by override, as `appearance` found them."""
        return {}

    def _find_appearance(self, number: int) -> Key:
        request, picture = self.request, self.request.pictures.of(number)
        parts = [(part.source.subject, part.pictures.of(number)) for part in request.parts]
        looks = [[name, to_plain(part.look), part.hide_facets] for name, part in parts]
        return key_of(
            to_plain(picture.look),
            to_plain(replace(picture.lights, exposure=0.0)),
            to_plain(picture.stage),
            to_plain(request.pictures.quality_of(number)),
            request.variant,
            picture.dicing,
            picture.hide_facets,
            *([looks] if request.shot.subjects else []),
        )

    def raw(self, number: int, framings: Mapping[int, Framing]) -> Key:
        """Return the key of a rendered picture; `framings` are the cameras of the request."""
        request, pictures = self.request, self.request.pictures
        angle, lights = request.angles[number], pictures.of(number).lights
        # In earlier versions a lens that saw the sky saw hidden softboxes too.
        sees_past_softboxes = lights.shows_sky and not all(box.visible for box in lights.softboxes)
        return key_of(
            RENDER.recipe,
            self.normals(angle.mesh),
            [angle.spin, angle.lights] if angle.lights else angle.spin,
            to_plain(framings[number]),
            self.appearance(number),
            request.seed(number),
            *self._motion_data(number, framings),
            *self.speed_data(number),
            *self.range_data(number),
            *([{"copies": pictures.copies}] if pictures.copies else []),
            *(["the lens sees visible softboxes alone"] if sees_past_softboxes else []),
        )

    def _motion_data(self, number: int, framings: Mapping[int, Framing]) -> list[Any]:
        """Return what decides AOVs and motion blur of a picture; nothing if it has neither."""
        request, pictures = self.request, self.request.pictures
        precision, offsets = pictures.aovs.precision, pictures.offsets(number)
        if not (precision or offsets):
            return []
        around = [to_plain(framings[n]) for n in (number - 1, number + 1) if n in framings]
        turn, mesh = request.frame_source.turn(number), request.angles[number].mesh
        flow = self._flow_data(mesh, offsets) if turn is None and offsets else []
        return [list(map(list, precision)), pictures.open_at(number), flow, turn, around if offsets else []]

    def speed_data(self, number: int) -> list[Any]:
        """Return what decides the colours of a picture that shows speeds; nothing of others."""
        if not self.request.pictures.measures_speed:
            return []
        from flowsculpt.render.scene.surface import Surface

        mesh, shot = self.request.angles[number].mesh, self.request.shot
        data = [part.motion.velocity_data(mesh) for part in shot.parts]
        return [[Surface.SPEED, data if shot.subjects else data[0]]]

    def range_data(self, number: int) -> list[Any]:
        """Return what decides a range of colours that follows from all frames; nothing of other pictures."""
        follow = any(part.pictures.of(number).look.follows_all_frames for part in self.request.parts)
        return (
            [["values of", key_of(list(self.request.source.surface_keys.meshes.values()))]] if follow else []
        )

    def _flow_data(self, mesh: int, offsets: tuple[float, ...]) -> list[Any]:
        """Return the cache data of the flow around a mesh frame; of several subjects, a list of them."""
        shot = self.request.shot
        data = [part.motion.flow_data(mesh, offsets) for part in shot.parts]
        return data if shot.subjects else data[0]

    @cached_property
    def last_stages(self) -> dict[str, list[Any]]:
        """Versions and settings of what plug-ins do with finished pictures, by the names of entries."""
        written = {} if self.request.frame_source.is_turned else self.request.shot.entries
        last = {
            name: (p.version, s.version) for name, (p, s) in plugins().picture_stages.items() if s.is_last
        }
        return {n: [*v, written[n].model_dump(mode="json")] for n, v in last.items() if n in written}

    def header(
        self, number: int, framing: Framing | None = None, keys: FrameKeys | None = None
    ) -> dict[str, Any]:
        """Return what the EXR of a raw picture says of itself, plain data: enough to make it again.

        It stands in the file as `flowsculpt:` entries. Without framing and keys, return what is known before
        the shot is framed.
        """
        known = _known_header(self.request, number)
        if framing is None or keys is None:
            return known
        placement = to_plain(framing.placement)  # resampling has a setting of the shorter name
        return {"key": keys.raw, **to_plain(framing), "stage_placement": placement, **known}

    def still(self, form: str, frame: Key) -> Key:
        """Return the key of a still by that of its frame."""
        return key_of(STAGES[form].recipe, frame, self.request.manifest.shown_as)

    def pictures(self, store: Store, rendered: Iterable[int] | None = None) -> PictureKeys | None:
        """Return the keys of the frames, or None before the cameras are found.

        rendered  the frames that are rendered meanwhile, by default those requested (see `PictureKeys`)
        """
        framings = self.request.pictures.framings(store)
        return None if framings is None else PictureKeys(self.request, store, framings, rendered)

    def movie(self, frames: list[Key]) -> Key:
        """Return the key of the movie by those of its frames."""
        request, manifest = self.request, self.request.manifest
        sounds = [[sound.content for sound in request.sounds]] if request.sounds else []
        loop = [] if request.loop is None else [["loop", *request.loop]]
        bits = movie_bits(request.quality_name)
        return key_of(ASSEMBLE.recipe, frames, manifest.rate, manifest.shown_as, bits, *sounds, *loop)


@dataclass(frozen=True)
class FrameKeys:
    """Keys of one frame.

    raw     the rendered picture
    frame   the denoised one
    window  the frames that the temporal denoiser reads
    staged  what the stages of plug-ins make of the rendered picture, in order, by stage
    """

    raw: Key
    frame: Key
    window: tuple[int, ...]
    staged: Mapping[str, Key] = field(default_factory=dict)


def staged_keys(stages: Mapping[str, str], raw: Key) -> dict[str, Key]:
    """Return keys by stage of what stages of plug-ins, each with its settings, make of a raw picture."""
    keys: dict[str, Key] = {}
    for name, settings in stages.items():
        raw = keys[name] = key_of(STAGES[name].recipe, raw, settings)
    return keys


@dataclass(frozen=True)
class _KnownKeys:
    """Keys that were found before: `raw` by frame, `frame` by the frame and the ends of its window."""

    raw: dict[int, Key]
    frame: dict[str, Key]


class PictureKeys(Mapping[int, FrameKeys]):
    """The keys of a request's frames by number, each found when it is asked for: most runs need few.

    A frame that is averaged with its neighbours has the key of the average over all of them while the store
    holds that, else over those that are rendered, or rendered by this run.

    Keys are looked up in the planning cache first; `remember` puts there those that it lacks.
    """

    def __init__(
        self, request: RenderRequest, store: Store, cameras: CameraFile, rendered: Iterable[int] | None = None
    ) -> None:
        """Find keys while a run renders the frames `rendered`, by default those of the request."""
        self._request, self._store, self._cameras = request, store, cameras
        self._cache, self._stages = request.source.cache, request.manifest.stages
        self._numbers = set(request.requested if rendered is None else rendered)
        known = self._cache.get(_KnownKeys, *self._found_from) or _KnownKeys({}, {})
        self._raws, self._frames = known.raw, known.frame
        self._cached = self._found
        self._keys: dict[int, FrameKeys] = {}

    def __getitem__(self, number: int) -> FrameKeys:
        if number not in self._keys:
            request = self._request
            keys = self._averaged(number, request.pictures.window(number, self.is_available))
            whole = request.pictures.window(number, self._cameras.__contains__)
            if whole != keys.window:
                best = self._averaged(number, whole)
                keys = best if self._store.holds("frame", best.frame) else keys
            self._keys[number] = keys
        return self._keys[number]

    def _averaged(self, number: int, window: tuple[int, ...]) -> FrameKeys:
        """Return the keys of a frame that is averaged over a window."""
        name = f"{number}.{window[0]}.{window[-1]}"
        if name not in self._frames:
            averaged = [self._source(n) for n in window] if len(window) > 1 else []
            request, layers = self._request, self._layers_data(number)
            layers = [*layers, *request.keys.last_stages.items()]
            data = self._source(number), request.pictures.quality.denoise, averaged
            self._frames[name] = key_of(FINISH.recipe, *data, request.manifest.rate, layers)
        raw = self._raw(number)
        return FrameKeys(raw, self._frames[name], window, staged_keys(self._stages, raw))

    def _source(self, number: int) -> Key:
        """Return the key of the picture that is denoised: rendered, or made by the last plug-in's stage."""
        raw = self._raw(number)
        return next(reversed(staged_keys(self._stages, raw).values())) if self._stages else raw

    def _layers_data(self, number: int) -> list[Any]:
        """Return what decides the layers for compositing: their names, and cameras for motion vectors."""
        if self._request.manifest.layers is None:
            return []
        around = [to_plain(self._cameras[n]) for n in (number - 1, number + 1) if n in self._cameras]
        return [self._request.manifest.layers, around]

    def __iter__(self) -> Iterator[int]:
        return iter(self._request.angles)

    def __len__(self) -> int:
        return len(self._request.angles)

    def remember(self) -> None:
        """Put the keys in the planning cache, where it lacks some."""
        if self._found > self._cached:
            self._cache.put(_KnownKeys(self._raws, self._frames), *self._found_from)
            self._cached = self._found

    @property
    def _found(self) -> int:
        """The number of keys found so far."""
        return len(self._raws) + len(self._frames)

    @property
    def _found_from(self) -> tuple[str, ...]:
        return "pictures", self._request.keys.identity, self._cameras.key

    def is_available(self, number: int) -> bool:
        """Tell whether a frame is rendered by this run, or was before."""
        if number in self._numbers:
            return True
        if number not in self._cameras:
            return False
        return any(self._store.holds("raw", key) for key in {self._raw(number), self._source(number)})

    def _raw(self, number: int) -> Key:
        if number not in self._raws:
            self._raws[number] = self._request.keys.raw(number, self._cameras)
        return self._raws[number]


def _known_header(request: RenderRequest, number: int) -> dict[str, Any]:
    """Return the part of a header that is known before the shot is framed.

    inputs  digests of the files that the shot reads, by their names without folders; those of the many files
            of an animated model are in the keys of meshes
    """
    angle, pictures = request.angles[number], request.pictures
    picture = pictures.of(number)
    resampling = request.shot.motion.resampling_at(angle.mesh)
    several = {"subjects": [_subject_header(part, number) for part in request.parts]}
    return {
        "shot": request.shot.name,
        "frame": number,
        "quality": request.quality_name,
        "variant": request.variant,
        "mesh_key": request.keys.mesh(angle.mesh),
        "seed": request.seed(number),
        "angle": to_plain(angle),
        "normals_key": request.keys.normals(angle.mesh),
        "inputs": {Path(path).name: digest for path, digest in _shown_inputs(request)},
        "stages": {stage.name: stage.recipe for stage in (SIMULATE, SMOOTH_NORMALS, FRAME_CAMERA, RENDER)},
        "look": to_plain(picture.look),
        "lights": to_plain(replace(picture.lights, exposure=0.0)),
        "stage": to_plain(picture.stage),
        "settings": to_plain(pictures.quality_of(number)),
        "dicing": picture.dicing,
        "aovs": dict(pictures.aovs.precision),
        "working_space": picture.working_space.name,
        "shutter": pictures.open_at(number),
        **(resampling.settings() if resampling else {"resample": "off"}),
        **(several if request.shot.subjects else {}),
    }


def _shown_inputs(request: RenderRequest) -> Iterator[tuple[str, str]]:
    """Yield the files that a shot reads, and their digests: of animated models those of the first frame."""
    models = [each.model for part in request.shot.parts if (each := part.motion.animated) is not None]
    others = {str(path) for model in models for path, _ in model.sequence.files}
    others -= {str(model.path) for model in models}
    yield from (item for item in request.manifest.inputs if item[0] not in others)


def projection_of(header: Mapping[str, Any]) -> Projection:
    """Return the projection of a picture by its header."""
    from flowsculpt.render.scene.render_camera import (  # numpy, which planning does without
        PERSPECTIVE,
        Projection,
    )

    wide = header.get("camera", {}).get("wide")
    return from_plain(Projection, wide) if wide else PERSPECTIVE


def _subject_header(part: RenderRequest, number: int) -> dict[str, Any]:
    """Return what the header says of one of several subjects."""
    mesh = part.angles[number].mesh
    resampling = part.shot.motion.resampling_at(mesh)
    return {
        "name": part.source.subject,
        "look": to_plain(part.pictures.of(number).look),
        "mesh_key": part.keys.mesh(mesh),
        "normals_key": part.keys.normals(mesh),
        **(resampling.settings() if resampling else {"resample": "off"}),
    }
