"""Relit frames: the light groups of finished frames, each times a factor, and a movie of them.

renders/<shot>/<quality>/relight/<name>/frames/<shot>.0001.exr
renders/<shot>/<quality>/relight/<name>/<shot>.mp4
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import FrameError
from pipeline.frames import FrameRange, FrameRate
from pipeline.production.request.crop_and_scale import movie_bits
from pipeline.production.request.keys import PictureKeys
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.stages import RELIGHT
from pipeline.production.store import readers
from pipeline.production.store.store import Key, Store, key_of
from pipeline.production.tasks.finished_frames import exr_attributes
from render.base.serialise import Triple
from render.movie.codecs import movie_encode
from render.movie.encode import write_movie
from render.movie.planes import Frame
from render.movie.sequences import prefetch
from render.post.colour import quantise, to_display
from render.post.image import write_exr
from render.scene.aovs import RenderedFrame
from render.scene.light_groups import groups_in, mixed

if TYPE_CHECKING:
    from pipeline.production.render_inputs.framing import Framing


@dataclass(frozen=True, eq=False)
class RelitFrames:
    """The frames of a request with factors on their light groups.

    factors  (red, green, blue) by light group, linear Rec.709
    name     of their folder
    """

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
        """Mix the frames and encode the movie, except what the store holds.

        bar  takes a name and a number of frames; returns the function to call after each

        Returns how many frames were mixed, and the messages about damaged frames; with any, there is no
        movie. Raises MachineError where the disk refuses.
        """
        passed = bar("relighting", len(self.numbers))
        made, faults = 0, []
        with ThreadPoolExecutor(threads) as pool:
            for outcome in pool.map(self._make_frame, self.numbers):
                made += outcome is True
                faults += [outcome] if isinstance(outcome, str) else []
                passed()
        if not faults:
            self._make_movie(bar("encoding", len(self.numbers)))
        return made, faults

    def _make_frame(self, number: int) -> bool | str:
        """Mix a frame unless the store holds it; return whether it did, or why it could not."""
        key = self._key(number)
        if mixes := not self.store.holds("frame", key):
            try:
                self.store.put("frame", key, lambda path: self._write(number, key, path))
            except FrameError as error:
                return str(error)
        self.store.link("frame", key, self._place(number))
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
            dict(self.request.precision),
            attributes=exr_attributes(self.request, number, self._framings),
            convention=self.request.layers,
        )

    def _make_movie(self, passed: Callable[[], None]) -> None:
        request = self.request
        rate, bits = FrameRate.of(request.source.summary.rate), movie_bits(request.quality_name)
        key = key_of(RELIGHT.recipe, request.movie_key([self._key(n) for n in self.numbers]))
        if not self.store.holds("movie", key):
            frames, encode = prefetch(self._shown(passed)), movie_encode(bits)
            self.store.put("movie", key, lambda path: write_movie(path, frames, rate.fps, encode))
        self.store.link("movie", key, self.movie_path)

    def _shown(self, passed: Callable[[], None]) -> Iterator[Frame]:
        """Yield the frames as a display shows them."""
        picture = self.request.shot.picture
        for number in self.numbers:
            light = self._read(self._key(number), self._place(number))[0]["beauty"]
            yield quantise(to_display(light, picture.lights.exposure, view=picture.view), bits=16)
            passed()

    def _read(self, key: Key, place: Path) -> tuple[RenderedFrame, dict[str, Any]]:
        reader = readers.picture(key, self.request.quality.rendered_size)
        return self.store.read("frame", key, place, reader)

    @cached_property
    def _framings(self) -> Mapping[int, Framing]:
        return self.request.framings(self.store) or {}

    @cached_property
    def _keys(self) -> PictureKeys | None:
        return self.request.picture_keys(self.store, rendered=())

    def _source(self, number: int) -> Key:
        """Return the key of a finished frame."""
        assert self._keys is not None, "finished frames have keys"
        return self._keys[number].frame

    def _key(self, number: int) -> Key:
        return key_of(RELIGHT.recipe, self._source(number), {n: list(f) for n, f in self.factors.items()})

    @property
    def _folder(self) -> Path:
        return self.request.folders.home / self.request.quality_name / "relight" / self.name

    def _place(self, number: int) -> Path:
        return self._folder / "frames" / self.request.place("frame", number).name
