"""From pictures to movies: each frame is read to its end, seen through the view, and encoded as it comes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from pipeline.errors import FlowsculptError, FrameError
from pipeline.frames import FrameRate
from pipeline.production.planning.planner import film_key
from pipeline.production.request.crop_and_scale import movie_bits
from pipeline.production.request.edit import Edit
from pipeline.production.request.keys import PictureKeys
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store import readers
from pipeline.production.store.store import Key
from pipeline.production.tasks.job import Context
from render.base.serialise import from_plain
from render.graphics.titles import TitleCard, title_frames
from render.movie.codecs import movie_encode
from render.movie.encode import write_movie
from render.movie.planes import Frame
from render.movie.sequences import ClipFrames, dissolve, mix_frames, prefetch
from render.movie.sound import Samples, blocks
from render.post.colour import quantise, to_display
from render.scene.aovs import RenderedFrame

T = TypeVar("T")


def assemble(context: Context) -> bool:
    """Encode the finished frames of one take, in ascending order."""
    request = context.request
    keys, numbers = context.picture_keys(request), sorted(request.requested)
    key = request.movie_key([keys[n].frame for n in numbers])
    frames = _shown(context, request, keys, numbers)
    return _movie(
        context,
        key,
        request.movie_path,
        frames,
        FrameRate.of(request.source.summary.rate),
        request.quality_name,
    )


def film(context: Context) -> bool:
    """Encode the film: title, shots in the order of the edit, credits."""
    requests = context.requests
    edit = from_plain(Edit, context.plan.film or {})
    key = film_key(edit, requests, [context.picture_keys(request) for request in requests])
    quality_name = requests[0].quality_name
    size = requests[0].quality.width, requests[0].quality.height

    def shown(clip: int) -> Iterator[Frame]:
        request = requests[clip]
        return _shown(context, request, context.picture_keys(request), list(request.requested))

    frames = dissolve(list(cut_together(edit, size, shown, lambda frame: frame)), mix_frames)
    rate = edit.frame_rate
    return _movie(context, key, edit.path(quality_name), frames, rate, quality_name, _sound(edit))


def _movie(
    context: Context,
    key: Key,
    target: Path,
    frames: Iterator[Frame],
    rate: FrameRate,
    quality_name: str,
    sound: Iterator[Samples] | None = None,
) -> bool:
    counted = _told(context, prefetch(frames))
    encode = movie_encode(movie_bits(quality_name))
    try:
        context.make("movie", key, target, lambda p: write_movie(p, counted, rate.fps, encode, sound=sound))
    except FlowsculptError as error:
        context.fail(error)
        return False
    return True


def _told(context: Context, frames: Iterator[Frame]) -> Iterator[Frame]:
    """The frames as they are; progress hears of each."""
    started = time.perf_counter()
    for number, frame in enumerate(frames, 1):
        yield frame
        context.tell(number, False, time.perf_counter() - started)
        started = time.perf_counter()


def _sound(edit: Edit) -> Iterator[Samples] | None:
    return None if edit.audio is None else blocks(edit.audio.sound(), edit.length / edit.frame_rate.fps)


def cut_together(
    edit: Edit, size: tuple[int, int], shown: Callable[[int], Iterator[T]], card: Callable[[Frame], T]
) -> Iterator[ClipFrames[T]]:
    """Yield the clips of a film for `render.movie.sequences.dissolve`.

    size   width and height of cards
    shown  the frames of the film's take in a place
    card   a card's frame as one of these
    """
    for piece in edit.items:
        words = TitleCard(piece.title, piece.subtitle)
        frames = map(card, _card(words, size, piece.frames)) if piece.clip is None else shown(piece.clip)
        yield piece.frames, piece.dissolve, frames


def _card(card: TitleCard, size: tuple[int, int], count: int) -> Iterator[Frame]:
    """A card's frames; the words take a quarter of its time to come, and another to go."""
    for picture in title_frames(card, size, count, fade=count // 4):
        yield quantise(picture, bits=16)


def _shown(
    context: Context, request: RenderRequest, keys: PictureKeys, numbers: list[int]
) -> Iterator[Frame]:
    """Finished frames as a display shows them. A frame that cannot be read to its end is forgotten."""
    picture = request.shot.picture

    def read(number: int) -> RenderedFrame:
        key, target = keys[number].frame, request.place("frame", number)
        return context.read("frame", key, target, readers.picture(key, request.quality.rendered_size))[0]

    try:
        for number in numbers:
            yield quantise(
                to_display(read(number)["beauty"], picture.lights.exposure, view=picture.view), bits=16
            )
    except FrameError:
        context.survey(numbers, read)
        raise
