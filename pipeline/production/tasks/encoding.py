"""From finished frames to stills, movies and films, as a display shows them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from flowsculpt.pipeline.errors import FlowsculptError, FrameError
from flowsculpt.pipeline.frames import FrameRate
from flowsculpt.pipeline.production.request.audio import AudioClip, samples_of
from flowsculpt.pipeline.production.request.keys import PictureKeys, projection_of
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.store.store import Key
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.render.base.work_clock import WorkClock
from flowsculpt.render.movie.encode import write_movie
from flowsculpt.render.movie.movie_frames import Frame, loop_frames, prefetch
from flowsculpt.render.post.image import write_still

T = TypeVar("T")


def assemble(context: Context) -> bool:
    """Encode the finished frames of one request, in ascending order."""
    request = context.request
    keys, numbers = context.picture_keys(request), sorted(request.requested)
    key = request.keys.movie([keys[n].frame for n in numbers])
    rate = FrameRate.of(request.manifest.rate)
    frames = loop_frames(numbers, request.loop_dissolve, partial(_shown, context, request, keys))
    length = len(numbers) - request.loop_dissolve
    return _movie(context, key, request.movie_path, frames, rate, (request.sounds, length), request.loop)


def film(context: Context) -> bool:
    """Encode the film: title, shots in the order of the edit, credits."""
    requests = context.requests
    edit = context.plan.film
    assert edit is not None, "a plan with the job of a film has its edit"
    keys = [context.picture_keys(request) for request in requests]
    first, rate = requests[0], edit.frame_rate

    def shown(clip: int) -> Iterator[Frame]:
        return _shown(context, requests[clip], keys[clip], list(requests[clip].requested))

    screen = first.pictures.screen
    frames = edit.frames(screen, shown, lambda frame: frame)
    target = edit.path(first.quality_name)
    return _movie(context, edit.key(requests, keys), target, frames, rate, (edit.sounds, edit.length))


def _movie(
    context: Context,
    key: Key,
    target: Path,
    frames: Iterator[Frame],
    rate: FrameRate,
    sounds: tuple[Sequence[AudioClip], int],
    loop: tuple[str, int] | None = None,
) -> bool:
    """Write a movie with its sounds, which come with the number of its frames."""
    clock = WorkClock()
    reported = _reported(context, prefetch(frames), clock)
    encode = context.request.pictures.movie_encode
    projection = context.request.pictures.projection

    def write(path: Path) -> None:
        sound = samples_of(*sounds, rate)
        write_movie(
            path, reported, rate.fps, encode, sound=sound, projection=projection, loops=loop is not None
        )

    try:
        context.make("movie", key, target, write)
    except FlowsculptError as error:
        context.fail(error)
        return False
    context.report_work(clock.lap().cpu)  # an encoder holds frames back, and encodes them at the end
    return True


def _reported(context: Context, frames: Iterator[Frame], clock: WorkClock) -> Iterator[Frame]:
    """Yield the frames as they are, and report each."""
    for number, frame in enumerate(frames, 1):
        yield frame
        context.report(number, False, clock.lap())


def _shown(
    context: Context, request: RenderRequest, keys: PictureKeys, numbers: list[int]
) -> Iterator[Frame]:
    """Yield finished frames as a display shows them. One that cannot be read to its end is evicted."""
    display = request.shot.picture.display

    def read(number: int) -> Frame:
        layers, _ = context.read_picture(request, "frame", number, keys[number].frame)
        frame: Frame = display.pixels(layers["beauty"])
        return frame

    try:
        yield from map(read, numbers)
    except FrameError:
        context.survey(numbers, read)
        raise


def _stills(form: str, context: Context) -> bool:
    """Write finished frames as files that any program shows."""
    request = context.request
    keys = context.picture_keys(request)

    def work(number: int) -> bool:
        return make_still(context, request, form, number, keys[number].frame)

    return context.for_each(context.job.frames, work)


def make_still(context: Context, request: RenderRequest, form: str, number: int, frame: Key) -> bool:
    """Make a still of the finished frame of a key, and show it; return whether the store held it."""
    key, bits = request.keys.still(form, frame), 16 if form == "png16" else 8

    def write(path: Path) -> None:
        layers, finished = context.read_picture(request, "frame", number, frame)
        pixels = request.shot.picture.display.pixels(layers["beauty"], "srgb", bits)
        header = {"shot": request.name, "frame": number, "key": key}
        write_still(path, pixels, header, form=form, projection=projection_of(finished))

    return context.make(form, key, request.place(form, number), write)


png, png16, jpeg = (partial(_stills, form) for form in ("png", "png16", "jpeg"))
