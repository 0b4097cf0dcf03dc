"""Previews of a shot as a still or a movie, and of a film, and the cameras that they need.

The camera of a still depends on frames after it: for these a sample of its points is moved. Nothing is
resampled after the still's own frame, so that a still takes the time of the frames up to it. The sample lies
on the same surface as the vertices of those frames; a camera differs by what lies between them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt import FrameError
from flowsculpt.api.frames import BoundingSpheres, Edit, Framer, Framing, RenderRequest, Store
from flowsculpt.api.meshes import Indices
from flowsculpt.api.pictures import ENCODES, AudioClip, loop_frames, write_movie, write_still
from flowsculpt.api.shots import Motion
from flowsculpt.pipeline.plugins.preview.sketch import Sketch, is_closed
from flowsculpt.pipeline.plugins.preview.surface_stream import SurfaceStream, in_order

SIZES = {"still": (960, 540), "movie": (480, 270)}  # pixels of a 16:9 picture; other aspects have as many

THREADS = 2  # pictures that are drawn at the same time
WAITING = 12  # pictures that may be begun and not yet written before more frames are simulated

PLAYBLAST = replace(
    ENCODES["review"], options={**ENCODES["review"].options, "preset": "superfast", "g": "12"}
)
"""Encoded soon, and stepped through quickly."""

Picture = NDArray[Any]
Extent = np.ndarray | BoundingSpheres
"""Points (N, 3), or spheres, that a picture shows."""

Framed = tuple[int, Framing]

FrameCallback = Callable[[str, int], None]
"""Called with `simulating` or `drawing`, and the number of each frame when that is done."""


@dataclass(frozen=True, eq=False)
class Animatic:
    """A shot that is drawn while its surfaces are computed.

    every  movies draw every so many frames, and hold each until the next
    """

    sketch: Sketch
    stream: SurfaceStream
    every: int = 1

    def still(self, number: int, path: Path, tell: FrameCallback) -> Framing:
        """Write a PNG and return its camera and stage.

        Raises FrameError if a frame up to it fails, MachineError if the disk refuses.
        """
        request, stream = self.sketch.request, self.stream
        for played in stream.play(request, self.played_for_still(number)):
            tell("simulating", played)
        known = request.pictures.framings(stream.store)
        framing = known[number] if known else framing_of_still(request, stream, number, self.played({number}))
        size = size_for(request.pictures.aspect, SIZES["still"])
        picture = next(self._pictures(iter([(number, framing)]), size, "srgb"))
        stream.store.write(path, lambda draft: write_still(draft, picture))
        tell("drawing", number)
        return framing

    def movie(self, path: Path, tell: FrameCallback) -> int:
        """Write an MP4 of the requested frames and return their number. Raises the errors of `still`."""
        return write_playblast(self.stream.store, path, self.sketch.request, self.pictures(tell), tell)

    def pictures(self, tell: FrameCallback) -> Iterator[Picture]:
        """Yield the requested frames in ascending order, in the size and colours of a movie."""
        framed, left = self._frame_pictures(self._drawn, tell), len(set(self.sketch.request.requested))
        for picture in self._pictures(framed, self.movie_size, "rec709"):
            yield from itertools.repeat(picture, min(self.every, left))
            left -= self.every

    @property
    def _drawn(self) -> set[int]:
        """The frames that a movie shows."""
        return set(sorted(set(self.sketch.request.requested))[:: self.every])

    @property
    def movie_size(self) -> tuple[int, int]:
        return size_for(self.sketch.request.pictures.aspect, SIZES["movie"])

    def played_for_still(self, number: int) -> list[int]:
        """Return the frames that must be simulated to draw one: none after it."""
        return [n for n in self.played({number}) if n <= number]

    def played_for_movie(self) -> list[int]:
        """Return the frames that must be simulated to draw a movie."""
        return self.played(self._drawn)

    def played(self, asked: Set[int]) -> list[int]:
        """Return the frames whose surfaces the requested ones and their cameras depend on.

        Cameras that are not known depend on neighbouring frames, and a camera that stands still on all.
        """
        request = self.sketch.request
        if request.pictures.framings(self.stream.store) is not None:
            return sorted(asked)
        angles = sorted(request.angles)
        if request.shot.picture.camera.follow != 1.0 or request.pictures.is_round:
            return angles
        first, last = (angles.index(end(asked)) for end in (min, max))
        return angles[max(0, first - Framer.AHEAD) : last + Framer.AHEAD + 1]

    def _frame_pictures(self, asked: Set[int], tell: FrameCallback) -> Iterator[Framed]:
        request, stream, wanted = self.sketch.request, self.stream, self.played(asked)

        def played() -> Iterator[int]:
            for number in stream.play(request, wanted):
                tell("simulating", number)
                yield number

        known = request.pictures.framings(stream.store)
        framed = (
            framings_while(request, stream, played(), wanted)
            if known is None
            else ((n, known[n]) for n in played())
        )
        for number, framing in framed:
            if number in asked:
                yield number, framing
            else:
                stream.drawn(request, number)  # only cameras depend on it

    def _pictures(self, framed: Iterator[Framed], size: tuple[int, int], display: str) -> Iterator[Picture]:
        first = next(framed)
        closed = all(map(is_closed, self.stream.each(self.sketch.request, first[0])))
        sketch = replace(self.sketch, closed=closed)
        return drawn(sketch, self.stream, itertools.chain([first], framed), size, display)


@dataclass(frozen=True, eq=False)
class FramedSurfaces:
    """Frames whose surfaces and cameras are known."""

    sketch: Sketch
    stream: SurfaceStream
    framings: Mapping[int, Framing]

    def pictures(self, numbers: Iterable[int], size: tuple[int, int], display: str) -> Iterator[Picture]:
        """Draw frames: see `drawn`."""
        return drawn(self.sketch, self.stream, ((n, self.framings[n]) for n in numbers), size, display)

    def movie(self, path: Path, tell: FrameCallback) -> int:
        """Write an MP4 of the requested frames and return their number."""
        request = self.sketch.request
        size = size_for(request.pictures.aspect, SIZES["movie"])
        pictures = self.pictures(sorted(request.requested), size, "rec709")
        return write_playblast(self.stream.store, path, request, pictures, tell)


def drawn(
    sketch: Sketch, stream: SurfaceStream, framed: Iterable[Framed], size: tuple[int, int], display: str
) -> Iterator[Picture]:
    """Draw frames in order as uint8 (H, W, 3), several at a time, while the next are simulated."""

    def draw(number: int, framing: Framing) -> Picture:
        return sketch.picture(number, stream.each(sketch.request, number), framing, size, display)

    with ThreadPoolExecutor(THREADS) as pool:
        submitted = ((number, pool.submit(draw, number, framing)) for number, framing in framed)
        for number, picture in in_order(submitted, lambda: WAITING):
            stream.drawn(sketch.request, number)
            yield picture


def write_playblast(
    store: Store, path: Path, request: RenderRequest, pictures: Iterator[Picture], tell: FrameCallback
) -> int:
    """Write an MP4 of the requested frames and return their number."""
    numbers, rate, lead = sorted(request.requested), request.shot.rate.fps, request.loop_dissolve
    told = told_frames(numbers, pictures, tell)
    first = list(itertools.islice(told, lead))  # they come first, and are shown last
    parts = iter([told, iter(first)])
    looped = loop_frames(numbers, lead, lambda _: next(parts))
    start, count = request.shot.rate.timecode(numbers[lead]), len(numbers) - lead
    sound = AudioClip.mix(request.sounds, count, request.shot.rate)
    options = start, sound, request.pictures.projection, request.loop is not None
    store.write(path, lambda draft: write_movie(draft, looped, rate, PLAYBLAST, *options))
    return count


def told_frames(
    numbers: Iterable[int], pictures: Iterator[Picture], tell: FrameCallback
) -> Iterator[Picture]:
    """Yield pictures, and tell the number of each when it is done."""
    for number, picture in zip(numbers, pictures, strict=True):
        yield picture
        tell("drawing", number)


def size_for(aspect: float, like: tuple[int, int]) -> tuple[int, int]:
    """Return an even width and height with this aspect and about as many pixels as `like`."""
    height = (like[0] * like[1] / aspect) ** 0.5
    return 2 * max(1, round(height * aspect / 2)), 2 * max(1, round(height / 2))


INTERVAL = 8  # frames after which settled cameras are computed


def framings_of(
    request: RenderRequest, stream: SurfaceStream, numbers: Sequence[int]
) -> Mapping[int, Framing]:
    """Return camera and stage of frames that the stream has played.

    For all frames of a shot they are the render's own, except for rounding of points to float32. For some
    frames they depend on these alone.
    """
    return dict(framings_while(request, stream, numbers, numbers))


def framings_while(
    request: RenderRequest, stream: SurfaceStream, played: Iterable[int], numbers: Sequence[int]
) -> Iterator[tuple[int, Framing]]:
    """Yield camera and stage of frames while the stream plays them, each when its camera is settled."""

    def extent_of(index: int) -> Extent:
        return BoundingSpheres.join(
            [_extent(arrays) for arrays in stream.each(request, numbers[index])], names
        )

    names = [part.subject for part in request.shot.parts]
    views, is_round = [request.pictures.view(n) for n in numbers], request.pictures.is_round
    framer = Framer(views, extent_of, request.pictures.aspect, request.shot.picture.camera.follow, is_round)
    stage, left = request.shot.picture.stage, iter(numbers)
    for count, _ in enumerate(played, start=1):
        if count % INTERVAL == 0 or count == len(numbers):
            for framing in framer.framings(count):
                yield next(left), framing.with_stage_in_view(stage, request.pictures.flat_aspect)


MOST_SAMPLED = 4000  # points of a still that are moved on, about
DIRECTIONS = 200  # directions in which the outermost points are in the sample


def framing_of_still(
    request: RenderRequest, stream: SurfaceStream, number: int, numbers: Sequence[int]
) -> Framing:
    """Return camera and stage of a frame, of `numbers` that they depend on; up to it all are played."""
    known = [[_extent(arrays) for arrays in stream.each(request, n)] for n in numbers if n <= number]
    last = len(known)
    motions = [part.motion for part in request.shot.parts]
    ends = zip(motions, known[-1], strict=True)
    later = [_move(motion, extent, numbers[last:]) for motion, extent in ends]
    names = [part.subject for part in request.shot.parts]
    extents = [BoundingSpheres.join(each, names) for each in (*known, *zip(*later, strict=False))]
    views = [request.pictures.view(n) for n in numbers[: len(extents)]]
    options = request.shot.picture.camera.follow, request.pictures.is_round
    framing = Framer(views, lambda i: extents[i], request.pictures.aspect, *options).all()[last - 1]
    return framing.with_stage_in_view(request.shot.picture.stage, request.pictures.flat_aspect)


def _extent(arrays: dict[str, np.ndarray]) -> Extent:
    points = arrays["vertices"]
    return BoundingSpheres(points, arrays["radii"]) if "radii" in arrays else points


def _move(motion: Motion, extent: Extent, numbers: Sequence[int]) -> list[Extent]:
    """Return a sample of an extent at later frames, up to the first at which the flow fails."""
    points, radii = extent[:2] if isinstance(extent, BoundingSpheres) else (extent, None)
    chosen = outline(points)
    moved, later = points[chosen].astype(np.float64), list[Extent]()
    for number in numbers:
        try:
            moved = motion.step_into(motion.flow, number).apply(moved)
        except FrameError:
            break  # the still itself is sound; a render stops there
        later.append(moved if radii is None else BoundingSpheres(moved, radii[chosen]))
    return later


def outline(points: np.ndarray) -> Indices:
    """Return the indices of points spread over all, and of the outermost in many directions."""
    spread = np.arange(0, len(points), -(-len(points) // MOST_SAMPLED))
    height = (2.0 * np.arange(DIRECTIONS) + 1.0) / DIRECTIONS - 1.0
    turn = np.pi * (1.0 + 5.0**0.5) * np.arange(DIRECTIONS)  # a spiral of golden angles
    across = np.sqrt(1.0 - height**2)
    directions = np.stack([across * np.cos(turn), height, across * np.sin(turn)])
    outermost = [int((points @ direction).argmax()) for direction in directions.T]
    return np.unique(np.concatenate([spread, outermost]))


FOLDER = "preview"
"""What stands for the quality in the path of a film's animatic."""


def write_film_animatic(
    edit: Edit,
    clips: Sequence[Animatic],
    path: Path,
    tell: FrameCallback,
    ready: Callable[[Animatic], object] = lambda clip: None,
) -> int:
    """Write an MP4 of a film and return its number of frames.

    clips  the animatics of the edit's clips, in order, each with a stream of its own
    ready  called before a clip is drawn, to wait for what it is drawn from

    Raises FrameError if a frame fails, MachineError if the disk refuses.
    """
    first = clips[0]
    request = first.sketch.request

    def shown(place: int) -> Iterator[Picture]:
        clip = clips[place]
        ready(clip)
        numbers = clip.sketch.request.requested
        with clip.stream:  # let go with the last picture, after which nobody asks for more
            pictures = _in_order(numbers, clip.pictures(tell))
            yield from itertools.islice(pictures, len(numbers) - 1)
            last = list(pictures)
        yield from last

    screen, rate = replace(request.pictures.screen, picture=first.movie_size), edit.frame_rate
    frames = edit.frames(screen, shown, lambda card: (card // 257).astype(np.uint8))
    told = told_frames(range(1, edit.length + 1), frames, tell)
    sound = AudioClip.mix(edit.sounds, edit.length, rate)
    write = partial(write_movie, sound=sound, projection=request.pictures.projection)
    first.stream.store.write(path, lambda draft: write(draft, told, rate.fps, PLAYBLAST))
    return edit.length


def _in_order(numbers: Sequence[int], pictures: Iterator[Picture]) -> Iterator[Picture]:
    """Yield pictures, which are drawn in ascending order, in the order in which a clip shows them."""
    if list(numbers) == sorted(set(numbers)):
        return pictures
    drawn = dict(zip(sorted(set(numbers)), pictures, strict=True))
    return (drawn[number] for number in numbers)
