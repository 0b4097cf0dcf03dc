"""The animatic of a film: its clips drawn one after the other, with its cards, dissolves and sound."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from pipeline.plugins.preview.animatic import Animatic, FrameCallback, Picture
from pipeline.production.request.audio import samples_of
from pipeline.production.request.edit import Edit
from pipeline.production.store import paths
from pipeline.production.tasks.encoding import cut_together
from render.graphics.cards import Screen
from render.movie.codecs import PLAYBLAST
from render.movie.encode import write_movie
from render.movie.movie_frames import Frame, dissolve, mix_frames

FOLDER = "preview"
"""Stands for the quality in the path of a film's animatic."""


def film_path(edit: Edit) -> Path:
    """Return the path of a film's animatic, relative to the root."""
    return paths.film(FOLDER, edit.name)


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
        yield from _in_order(clip.sketch.request.requested, clip.pictures(tell))

    screen, rate = Screen(request.projection, first.movie_size), edit.frame_rate
    frames = dissolve(list(cut_together(edit, screen, shown, _as_bytes)), mix_frames)
    told = _told(frames, tell)
    sound = samples_of(edit.sounds, edit.length, rate)
    first.stream.store.write(
        path,
        lambda draft: write_movie(
            draft, told, rate.fps, PLAYBLAST, sound=sound, projection=request.projection
        ),
    )
    return edit.length


def _in_order(numbers: Sequence[int], pictures: Iterator[Picture]) -> Iterator[Picture]:
    """Yield pictures, which are drawn in ascending order, in the order in which a clip shows them."""
    if list(numbers) == sorted(set(numbers)):
        return pictures
    drawn = dict(zip(sorted(set(numbers)), pictures, strict=True))
    return (drawn[number] for number in numbers)


def _told(frames: Iterator[Frame], tell: FrameCallback) -> Iterator[Frame]:
    for number, frame in enumerate(frames, 1):
        yield frame
        tell("drawing", number)


def _as_bytes(card: Frame) -> Frame:
    """Return a card of 16 bits with the 8 of an animatic."""
    return (card // 257).astype(np.uint8)
