"""Frames into an H.264 movie with its colours named."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

from render.base.errors import BadInputError
from render.movie.codecs import FILM
from render.movie.encode import write_encode
from render.movie.planes import Frame as Frame
from render.movie.planes import require_frame
from render.movie.probe import MovieFacts as MovieFacts
from render.movie.probe import probe_movie as probe_movie
from render.movie.sound import Samples


def write_movie(
    path: Path, frames: Iterator[Frame], rate: Fraction, bits: int = 8, sound: Iterator[Samples] | None = None
) -> int:
    """Encode display frames (H, W, 3) as they come; return how many there were.

    uint8 frames count 0 … 255, uint16 frames 0 … 65535. `bits` a sample in the file: 8 plays everywhere,
    10 keeps gradients smooth. H.264 halves the colour's resolution and needs even sizes: an odd last
    column or row is repeated once. `sound` is what `render.movie.sound.blocks` tells of it. The movie appears
    under its name only when complete.
    Raises BadInputError for no frames, or frames of different sizes; MachineError where the
    disk is full or the folder cannot be written.
    """
    if bits not in FILM:
        raise BadInputError(f"a movie of {bits} bits is not possible; it can have 8 or 10")
    return write_encode(path, _opaque(frames), rate, FILM[bits], sound=sound)


def _opaque(frames: Iterator[Frame]) -> Iterator[Frame]:
    for frame in frames:
        require_frame(frame)
        yield frame
