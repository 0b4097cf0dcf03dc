"""Frames and sound into a file, by one of the named encodes, as they come. Knows av."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from render.base.atomic_write import atomic_write, cannot_write
from render.base.errors import BadInputError, MachineError
from render.movie.codecs import Encode, require_size
from render.movie.planes import Frame, bgra, even, gbr, require_frame, ycbcr
from render.movie.sink import Sink
from render.movie.sound import Samples
from render.movie.track import Track

_BT709, _RGB = 1, 0
_LIMITED, _FULL = 1, 2
_REORDERED = 3
"""The fewest frames of which one can be encoded before one that is shown earlier: I, P, B."""
_FORMATS = {".mp4": "mp4", ".mov": "mov", ".mkv": "matroska", ".webp": "webp"}


def write_encode(
    path: Path,
    frames: Iterator[Frame],
    rate: Fraction,
    encode: Encode,
    start: str = "",
    sound: Iterator[Samples] | None = None,
) -> int:
    """Encode display frames (H, W, 3) or (H, W, 4) as they come; return how many there were.

    start  the timecode of the first frame; the file gets none where it is empty
    sound  what is heard under the frames, as `render.movie.sound.blocks` tells it; WebP leaves it out

    uint8 frames count 0 … 255, uint16 frames 0 … 65535; a fourth channel is coverage, kept where the encode
    can. The file appears under its name only when complete, and the same input is the same bytes.
    Raises BadInputError for no frames, frames of different sizes or too small; MissingImageError or
    CorruptImageError for sound that cannot be read; MachineError where the encoder fails, the disk
    is full or the folder cannot be written.
    """
    frames = iter(frames)
    first = next(frames, None)
    if first is None:
        raise BadInputError(f"{path}: a movie of no frames is not possible")
    require_frame(first, (3, 4))
    require_size(encode, first.shape[1], first.shape[0])
    with atomic_write(path) as temporary, _quiet(), closing(Sink(temporary)) as sink:
        try:
            return _write(sink, path, itertools.chain([first], frames), rate, encode, start, sound)
        except av.error.FFmpegError as error:
            if sink.error is not None:
                raise cannot_write(path, str(sink.error.strerror)) from None
            raise _encoder_failed(path, encode, first, error) from None


def _encoder_failed(path: Path, encode: Encode, first: Frame, error: av.error.FFmpegError) -> MachineError:
    return MachineError(
        f"{path}: the encoder {encode.codec} failed on frames of {_size(first.shape)} ({error.strerror}); "
        "the frames are untouched: choose another encode, such as ffv1, or another size"
    )


def _write(
    sink: Sink,
    path: Path,
    frames: Iterator[Frame],
    rate: Fraction,
    encode: Encode,
    start: str,
    sound: Iterator[Samples] | None,
) -> int:
    options = dict(encode.container)
    count, first = 0, (0, 0, 0)
    with av.open(sink, "w", format=_FORMATS[encode.suffix], options=options) as container:
        if start and encode.has_timecode:
            container.metadata["timecode"] = start
        picture: _Picture | None = None
        track: Track | None = None
        for frame in frames:
            if picture is None:
                first = frame.shape
                picture = _Picture.begun(container, encode, frame, rate)
                track = Track.begun(container, encode, sound) if sound is not None else None
            require_frame(frame, (3, 4))
            if frame.shape != first:
                raise BadInputError(
                    f"{path}: frame {count} has {_size(frame.shape)} where the first has {_size(first)}; all "
                    "must have the same"
                )
            picture.write(frame, count)
            count += 1
            if track is not None:
                track.write_until(count / rate)
            sink.check()
        assert picture is not None, "there is a first frame"
        picture.end()
        if track is not None:
            track.end()
        sink.check()
    sink.check()
    return count


@dataclass(eq=False)
class _Picture:
    """The stream of pictures of a file being written."""

    container: Any
    stream: Any
    encode: Encode
    given: str
    stored: str
    rate: Fraction
    count: int = 0

    @classmethod
    def begun(cls, container: Any, encode: Encode, frame: Frame, rate: Fraction) -> _Picture:
        covered = encode.covered if frame.shape[2] == 4 else None
        given, stored = covered or (encode.given, encode.stored)
        stream = container.add_stream(encode.codec, rate=rate, options=_settled(encode))
        height, width = (even(frame) if encode.halves_colour else frame).shape[:2]
        stream.width, stream.height, stream.pix_fmt = width, height, stored
        stream.time_base = 1 / rate
        codec = stream.codec_context
        codec.color_primaries = codec.color_trc = _BT709
        codec.colorspace, codec.color_range = (_RGB, _FULL) if encode.is_rgb else (_BT709, _LIMITED)
        if encode.tag:
            codec.codec_tag = encode.tag
        return cls(container, stream, encode, given, stored, rate)

    def write(self, frame: Frame, number: int) -> None:
        picture = _filled(self.given, self._planes(frame))
        if self.stored != self.given:
            picture = picture.reformat(format=self.stored)
        picture.pts, picture.time_base = number, 1 / self.rate
        picture.color_primaries = picture.color_trc = _BT709
        picture.colorspace, picture.color_range = (_RGB, _FULL) if self.encode.is_rgb else (_BT709, _LIMITED)
        self.count += 1
        self._mux(picture)

    def end(self) -> None:
        self._mux(None)

    def _mux(self, picture: Any) -> None:
        for packet in self.stream.encode(picture):
            if self.count < _REORDERED and self.encode.codec == "libx265":
                # x265 4.2 subtracts a delay from these decoding times that it sets at the third frame only;
                # before, it is whatever the memory held.
                packet.dts = packet.pts
            packet.duration = packet.duration or round(1 / self.rate / packet.time_base)
            self.container.mux(packet)

    def _planes(self, frame: Frame) -> NDArray[Any]:
        kept = frame if self.given.startswith("yuva") else frame[..., :3]
        if self.encode.is_rgb:
            return bgra(kept) if self.given == "bgra" else gbr(kept)
        return ycbcr(even(kept) if self.encode.halves_colour else kept, self.encode.bits)


def _settled(encode: Encode) -> dict[str, str]:
    """The codec's options on this machine.

    What x264 does with AVX-512 in its look-ahead is not the same every time: sixty encodes of eight frames of
    192 × 108 were nine different files. By AVX2 they are one.
    """
    options = dict(encode.options)
    if encode.codec == "libx264" and _has_avx512():
        options["x264-params"] += ":asm=AVX2"
    return options


@cache
def _has_avx512() -> bool:
    from llvmlite.binding import get_host_cpu_features

    return bool(get_host_cpu_features().get("avx512f"))


def _filled(kind: str, planes: NDArray[Any]) -> Any:
    """An FFmpeg frame of planes (P, H, W)."""
    packed = kind == "bgra"
    width = planes.shape[2] // 4 if packed else planes.shape[2]
    frame = av.VideoFrame(width, planes.shape[1], kind)
    for place, plane in zip(frame.planes, planes, strict=True):
        rows = np.frombuffer(place, dtype=planes.dtype).reshape(plane.shape[0], -1)
        rows[:, : plane.shape[1]] = plane
    return frame


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}×{shape[0]} pixels" + (" and a coverage" if shape[2] == 4 else "")


@contextmanager
def _quiet() -> Iterator[None]:
    """SVT-AV1 talks to the terminal unless its environment says otherwise."""
    before = os.environ.get("SVT_LOG")
    os.environ.setdefault("SVT_LOG", "1")
    try:
        yield
    finally:
        if before is None:
            del os.environ["SVT_LOG"]
