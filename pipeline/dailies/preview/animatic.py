"""The animatic of a shot: all that is asked for, drawn quickly and put into a movie."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from pipeline.dailies.preview.aim import aims
from pipeline.dailies.preview.reel import Reel
from pipeline.dailies.preview.sketch import Sketch, is_closed
from pipeline.production.surfaces.framing import Framing
from render.encodes import SKETCH
from render.encoding import write_encode
from render.image import write_png
from render.timecode import timecode

SIZES = {"still": (960, 540), "movie": (480, 270)}
"""Of a picture that is as wide as 16 : 9; others have as many pixels."""

THREADS = 2
"""Pictures that are drawn at a time."""

Tell = Callable[[str, int], None]
"""Hears of each frame: `simulating` or `drawing`, and its number."""


@dataclass(frozen=True, eq=False)
class Animatic:
    """A take, played from a reel."""

    sketch: Sketch
    reel: Reel

    def still(self, number: int, path: Path, tell: Tell) -> None:
        """A PNG. Raises FrameError where a frame fails, RenderEnvironmentError where the disk does."""
        ready = self._ready(tell)
        picture = next(ready.pictures([number], size_for(self.aspect, SIZES["still"]), "srgb"))
        write_png(path, picture, {"shot": self.sketch.take.name, "frame": number})

    def movie(self, path: Path, tell: Tell) -> int:
        """An MP4 of the frames asked for; how many it has. Raises as `still`."""
        return self._ready(tell).movie(path, tell)

    @property
    def aspect(self) -> float:
        return self.sketch.take.aspect

    def _ready(self, tell: Tell) -> Ready:
        """Cameras look at the whole shot first: every frame of it is needed where they are not known."""
        take, reel = self.sketch.take, self.reel
        known = take.framings(reel.store)
        wanted = sorted(take.poses) if known is None else sorted(take.requested)
        for number in reel.play(take, wanted):
            tell("simulating", number)
        framings = aims(take, reel, wanted) if known is None else known
        closed = is_closed(reel.arrays(take, wanted[0]))
        return Ready(replace(self.sketch, closed=closed), reel, framings)


@dataclass(frozen=True, eq=False)
class Ready:
    """Frames whose surfaces and cameras are known."""

    sketch: Sketch
    reel: Reel
    framings: Mapping[int, Framing]

    def pictures(self, numbers: Iterable[int], size: tuple[int, int], display: str) -> Iterator[NDArray[Any]]:
        """uint8 (H, W, 3), in order; several are drawn at a time."""

        def drawn(number: int) -> NDArray[Any]:
            arrays = self.reel.arrays(self.sketch.take, number)
            return self.sketch.picture(number, arrays, self.framings[number], size, display)

        with ThreadPoolExecutor(THREADS) as pool:
            under_way: deque[Future[NDArray[Any]]] = deque()
            for number in numbers:
                under_way.append(pool.submit(drawn, number))
                if len(under_way) > 2 * THREADS:
                    yield under_way.popleft().result()
            while under_way:
                yield under_way.popleft().result()

    def movie(self, path: Path, tell: Tell) -> int:
        """An MP4 of the frames asked for; how many it has."""
        take = self.sketch.take
        numbers, size = sorted(take.requested), size_for(take.aspect, SIZES["movie"])
        pictures = self.pictures(numbers, size, "rec709")
        rate = take.shot.rate.fps
        start = timecode(numbers[0], rate)
        return write_encode(path, _told(pictures, numbers, tell), rate, SKETCH, start)


def size_for(aspect: float, like: tuple[int, int]) -> tuple[int, int]:
    """Width and height, even, of a picture of that aspect with about as many pixels as another."""
    height = (like[0] * like[1] / aspect) ** 0.5
    return 2 * max(1, round(height * aspect / 2)), 2 * max(1, round(height / 2))


def _told(pictures: Iterator[NDArray[Any]], numbers: list[int], tell: Tell) -> Iterator[NDArray[Any]]:
    for number, picture in zip(numbers, pictures, strict=True):
        yield picture
        tell("drawing", number)
