"""Relit frames: the light groups of finished frames, each times a factor, and a movie of them.

renders/<shot>/<quality>/relight/<name>/frames/<shot>.0001.exr
renders/<shot>/<quality>/relight/<name>/<shot>.mp4
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import FrameError, MissingInputError
from pipeline.frames import FrameRange, FrameRate
from pipeline.production.picture_sequences import PictureSequence, SequenceQuery, display_of
from pipeline.production.request.cameras import camera_file
from pipeline.production.request.keys import PictureKeys, picture_keys
from pipeline.production.request.lookup import movie_bits
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.stages import RELIGHT
from pipeline.production.store import readers
from pipeline.production.store.store import Key, Store, key_of
from pipeline.production.tasks.finish import exr_attributes
from render.base.render_errors import RenderError
from render.base.serialise import Triple
from render.movie.codecs import movie_encode
from render.movie.encode import write_movie
from render.movie.movie_frames import Frame, prefetch
from render.post.colour import quantise, to_display
from render.post.image import read_header, write_exr
from render.scene.aovs import RenderedFrame
from render.scene.scene_lights import groups_in, mixed

if TYPE_CHECKING:
    from pipeline.production.request.framing import Framing


@dataclass(frozen=True, eq=False)
class RelitFrames:
    """The frames of a request with factors on their light groups: (red, green, blue), linear Rec.709."""

    request: RenderRequest
    store: Store
    factors: Mapping[str, Triple]
    name: str

    @cached_property
    def numbers(self) -> list[int]:
        """The numbers of the frames, in ascending order."""
        return sorted(self.request.requested)

    @property
    def movie_path(self) -> Path:
        return self._folder / self.request.movie_path.name

    def missing(self) -> FrameRange | None:
        """Return the frames that are not finished, or None."""
        keys = self._keys
        lacking = [n for n in self.numbers if keys is None or not self.store.holds("frame", keys[n].frame)]
        return FrameRange.of(lacking) if lacking else None

    def make(self, threads: int, bar: Callable[[str, int], Callable[[], None]]) -> tuple[int, list[str]]:
        """Mix the frames and encode the movie, except what the store holds; `bar` gets a name and a number.

        Returns how many frames were mixed, and the messages about damaged frames; with any, there is no
        movie. Raises MachineError where the disk refuses.
        """
        made, faults = self.mix(threads, bar)
        if not faults:
            self._make_movie(bar("encoding", len(self.numbers)))
        return made, faults

    def mix(self, threads: int, bar: Callable[[str, int], Callable[[], None]]) -> tuple[int, list[str]]:
        """Mix the frames that are finished, except what the store holds. As `make`, without the movie."""
        missing = self.missing() or ()
        numbers = [number for number in self.numbers if number not in missing]
        passed = bar("relighting", len(numbers))
        made, faults = 0, []
        with ThreadPoolExecutor(threads) as pool:
            for outcome in pool.map(self._make_frame, numbers):
                made += outcome is True
                faults += [outcome] if isinstance(outcome, str) else []
                passed()
        return made, faults

    def _make_frame(self, number: int) -> bool | str:
        """Mix a frame unless the store holds it; return whether it did, or why it could not."""
        key = self.key(number)
        if mixes := not self.store.bring("frame", key):
            try:
                self.store.put("frame", key, lambda path: self._write(number, key, path))
            except FrameError as error:
                return str(error)
        self.store.link("frame", key, self.place(number))
        return mixes

    def _write(self, number: int, key: Key, path: Path) -> None:
        finished, header = self._read(self._source(number), self.request.place("frame", number))
        space = self.request.shot.picture.working_space
        light = mixed(groups_in(finished.arrays), self.factors, space)
        stages = {**header.get("stages", {}), RELIGHT.name: RELIGHT.recipe}
        relit = {"relit": {name: list(factor) for name, factor in self.factors.items()}}
        entries = {**header, **relit, "stages": stages, "finished_key": header["key"], "key": key}
        write_exr(
            path,
            RenderedFrame({"beauty": light, "alpha": finished["alpha"]}),
            entries,
            dict(self.request.manifest.precision),
            attributes=exr_attributes(self.request, number, self._framings),
            convention=self.request.manifest.layers,
        )

    def _make_movie(self, passed: Callable[[], None]) -> None:
        request = self.request
        rate, bits = FrameRate.of(request.manifest.rate), movie_bits(request.quality_name)
        key = key_of(RELIGHT.recipe, request.movie_key([self.key(n) for n in self.numbers]))
        if not self.store.bring("movie", key):
            frames, encode = prefetch(self._shown(passed)), movie_encode(bits)
            projection = request.projection
            self.store.put(
                "movie", key, lambda path: write_movie(path, frames, rate.fps, encode, projection=projection)
            )
        self.store.link("movie", key, self.movie_path)

    def _shown(self, passed: Callable[[], None]) -> Iterator[Frame]:
        """Yield the frames as a display shows them."""
        picture = self.request.shot.picture
        for number in self.numbers:
            light = self._read(self.key(number), self.place(number))[0]["beauty"]
            yield quantise(to_display(light, picture.lights.exposure, view=picture.view), bits=16)
            passed()

    def _read(self, key: Key, place: Path) -> tuple[RenderedFrame, dict[str, Any]]:
        reader = readers.picture(key, self.request.quality.rendered_size)
        return self.store.read("frame", key, place, reader)

    @cached_property
    def _framings(self) -> Mapping[int, Framing]:
        return camera_file(self.request, self.store) or {}

    @cached_property
    def _keys(self) -> PictureKeys | None:
        return picture_keys(self.request, self.store, rendered=())

    def _source(self, number: int) -> Key:
        """Return the key of a finished frame."""
        assert self._keys is not None, "finished frames have keys"
        return self._keys[number].frame

    def is_mixed(self, number: int) -> bool:
        """Tell whether the store holds a frame."""
        return self._keys is not None and self.store.holds("frame", self.key(number))

    def key(self, number: int) -> Key:
        """Return the key of a frame, whose finished frame has one."""
        return key_of(RELIGHT.recipe, self._source(number), {n: list(f) for n, f in self.factors.items()})

    @property
    def _folder(self) -> Path:
        return _folder(self.request) / self.name

    def place(self, number: int) -> Path:
        """Return where a frame is shown."""
        return self._folder / "frames" / self.request.place("frame", number).name


def _folder(request: RenderRequest) -> Path:
    """Return the folder of all relit versions, relative to the root."""
    return request.folders.home / request.quality_name / "relight"


def relit_names(request: RenderRequest, root: Path) -> list[str]:
    """Return the names of the relit versions of a shot at one quality, in alphabetical order."""
    return sorted(folder.parent.name for folder in (root / _folder(request)).glob("*/frames"))


def relit_files(request: RenderRequest, root: Path, name: str) -> dict[int, Path]:
    """Return the files of a relit version by frame number."""
    version = RelitFrames(request, Store(root), {}, name)
    places = {number: root / version.place(number) for number in sorted(request.angles)}
    return {number: path for number, path in places.items() if path.is_file()}


def relit_version(request: RenderRequest, store: Store, name: str) -> RelitFrames:
    """Return the relit version of a name, with the factors that its frames tell.

    Raises MissingInputError where there is none, FrameError where its frames have different factors.
    """
    files = relit_files(request, store.root, name)
    chosen = [files[number] for number in request.requested if number in files] or list(files.values())
    told = set()
    for path in chosen:
        with suppress(RenderError):
            told.add(tuple((group, tuple(f)) for group, f in read_header(path).get("relit", {}).items()))
    if not told:
        names = relit_names(request, store.root)
        others = f"There are: {', '.join(names)}" if names else "flowsculpt relight makes them"
        raise MissingInputError(
            f"{request.name} has no relit frames {name} at {request.quality_name}. {others}"
        )
    if len(told) > 1:
        raise FrameError(
            f"{_folder(request) / name}: its frames were relit with different factors. Relight all of them "
            f"with the same, or choose frames with -f"
        )
    return RelitFrames(request, store, dict(told.pop()), name)


OUTDATED = "its finished frame has changed since; flowsculpt relight mixes it again"


def relit_sequences(query: SequenceQuery) -> Iterator[PictureSequence]:
    """Yield the frames of every relit version. Those whose finished frame was rendered again are stale."""
    root = query.project.root
    for request in query.requests():
        keys = picture_keys(request, query.project.store, rendered=())
        for name in relit_names(request, root):
            files, stale = relit_files(request, root, name), {}
            for number, path in files.items():
                with suppress(RenderError):
                    if keys is None or read_header(path).get("finished_key") != keys[number].frame:
                        stale[number] = "stale", OUTDATED
            yield PictureSequence(
                shot=request.name,
                kind="relit",
                label=f"{request.quality_name} relit {name}",
                quality=request.quality_name,
                subject=request.subject,
                numbers=tuple(files),
                files=files,
                display=display_of(request),
                faults=stale,
                seconds={},
                source=request.source,
            )
