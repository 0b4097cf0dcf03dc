"""Write frames and sound into a movie, frame by frame, with imageio's pyav plugin."""

from __future__ import annotations

import io
import os
from collections import deque
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from fractions import Fraction
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import av
import imageio.v3 as iio

from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.render_errors import BadInputError, MachineError
from flowsculpt.render.movie.codecs import Encode, require_size
from flowsculpt.render.movie.movie_frames import Frame, pad_to_even, require_frame, to_pixel_format
from flowsculpt.render.movie.movie_sound import AudioStream, Samples
from flowsculpt.render.movie.projection_tags import is_tagged, tag_movie
from flowsculpt.render.scene.render_camera import PERSPECTIVE, Projection

_LIMITED, _FULL = 1, 2
LOOPS = "Seamless loop: the first frame follows the last."
"""The comment of a movie that loops."""

_LIGHT_OPTIONS = {
    "libx265": (
        "x265-params",
        "hdr10=1:master-display=G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)L(10000000,1)",
        "max-cll",
    ),
    "libsvtav1": (
        "svtav1-params",
        "mastering-display=G(0.265,0.69)B(0.15,0.06)R(0.68,0.32)WP(0.3127,0.329)L(1000,0.0001)",
        "content-light",
    ),
}
"""By encoder: the option that describes the light of frames, its words for a P3 D65 display of 0.0001 to 1000
nits, and the name of the light of the content."""

_REORDER = 3  # the fewest frames that an encoder can reorder: I, P, B
_CODING_BLOCK = 64  # the side of x265's largest block, in pixels


def write_movie(
    path: Path,
    frames: Iterator[Frame],
    rate: Fraction,
    encode: Encode,
    timecode: str = "",
    sound: Iterator[Samples] | None = None,
    projection: Projection = PERSPECTIVE,
    loops: bool = False,
    light: tuple[int, int] | None = None,
) -> int:
    """Encode display frames (H, W, 3) or (H, W, 4) as they come; return how many there were.

    rate        frames per second
    timecode    of the first frame; empty for none
    sound       from `blocks` of `movie_sound`; dropped where the file can hold no sound
    projection  of the frames; the file is tagged with it where `projection_tags.is_tagged`
    loops       True if the first frame follows the last; the file's comment then says so
    light       of the frames, for an encode of PQ: MaxCLL and MaxFALL, nits

    Where colour has half the resolution, an odd last column or row is repeated once. The movie appears under
    its name only when complete, and the same input gives the same bytes.
    Raises BadInputError for no frames, frames of different sizes or too small, or sound that cannot be read;
    MissingInputError for sound that is not there; MachineError where the encoder fails, the disk is full or
    the folder cannot be written.
    """
    frames = iter(frames)
    first = deque(islice(frames, _REORDER))
    if not first:
        raise BadInputError(f"{path}: a movie of no frames is not possible")
    require_frame(first[0])
    shape, can_reorder, count = first[0].shape, len(first) == _REORDER, 0
    require_size(encode, shape[1], shape[0])
    full = encode.format_of(shape[2]).replace("420", "444")
    # Frames have colour at full resolution, which FFmpeg halves where the encode asks for it.
    with (
        _movie_file(path, encode, shape, projection) as file,
        _open_movie(file, encode, shape, rate, _codec_options(encode, shape[1], can_reorder, light)) as (
            movie,
            container,
        ),
    ):
        if timecode and encode.has_timecode:
            movie.container_metadata["timecode"] = timecode
        if loops:
            movie.container_metadata["comment"] = LOOPS
        codec = encode.container.audio_codec
        audio = AudioStream(container, codec, sound) if sound is not None and codec else None
        for frame in _chain(first, frames):
            require_frame(frame)
            if frame.shape != shape:
                raise BadInputError(
                    f"{path}: frame {count} has {_size(frame.shape)} where the first has {_size(shape)}; all "
                    "must have the same"
                )
            padded = pad_to_even(frame) if encode.is_subsampled else frame
            movie.write_frame(to_pixel_format(padded, full, encode.colours[2]), pixel_format=full)
            count += 1
            if audio is not None:
                audio.write_until(count / rate)
            file.require_written()
        if audio is not None:
            audio.finish()
    return count


@contextmanager
def _movie_file(
    path: Path, encode: Encode, shape: tuple[int, ...], projection: Projection
) -> Iterator[_MovieFile]:
    """Open the file of a movie, and tag it at last. Raises MachineError where disk or encoder fail."""
    with atomic_write(path) as temporary:
        with _restrained_svt(), closing(_MovieFile(temporary)) as file:
            try:
                yield file
            except av.error.FFmpegError as error:
                file.require_written()
                raise MachineError(
                    f"{path}: the encoder {encode.codec} failed on frames of {_size(shape)} "
                    f"({error.strerror}); choose another encode, such as ffv1, or another size"
                ) from None
            file.require_written()
        if is_tagged(projection, encode.container.format):
            tag_movie(temporary, projection, encode.container.format)


@contextmanager
def _open_movie(
    file: _MovieFile, encode: Encode, shape: tuple[int, ...], rate: Fraction, codec_options: dict[str, str]
) -> Iterator[tuple[Any, Any]]:
    """Open a movie for frames of one shape; yield imageio's plugin and FFmpeg's container.

    imageio has no arguments for options of the codec, for colours and for sound: they are set on the stream
    and the container that it opened.
    """
    kind = encode.container
    options: Any = {"container": kind.format, "options": dict(kind.options), "io_open": file.opened_again}
    movie: Any = iio.imopen(file, "w", plugin="pyav", extension=kind.suffix, **options)
    try:
        movie.init_video_stream(encode.codec, fps=float(rate), pixel_format=encode.format_of(shape[2]))
        stream, codec = movie._video_stream, movie._video_stream.codec_context
        stream.time_base = 1 / rate
        codec.options = codec_options
        if encode.is_subsampled:
            # Frames are converted by as many threads; the options say how many encode. FFmpeg's threads write
            # over the first pixels of each other's rows where the width is no multiple of 16.
            codec.thread_count = 1
        codec.color_primaries, codec.color_trc, codec.colorspace = encode.colours
        codec.color_range = _FULL if encode.is_rgb else _LIMITED
        if encode.codec_tag:
            codec.codec_tag = encode.codec_tag
        if encode.codec == "prores_ks":  # it writes the colours of frames, not of the stream
            stream.height, stream.width = shape[:2]
            colours = "color_primaries=bt709:color_trc=bt709:colorspace=bt709:range=limited"
            movie.set_video_filter([("setparams", colours)])
        yield movie, movie._container
        movie.close()
    except BaseException:
        movie._video_stream = None  # or closing would encode the frames that the encoder still holds
        with suppress(Exception):
            movie.close()
        raise


def _codec_options(
    encode: Encode, width: int, can_reorder: bool, light: tuple[int, int] | None
) -> dict[str, str]:
    """Return the options of the codec on this machine, for a movie long enough to reorder frames or not.

    With AVX-512, x264's look-ahead is not deterministic: sixty encodes of eight frames of 192 × 108 gave nine
    different files. With AVX2 they give one.
    x265 4.2 subtracts a delay from decoding times that it sets when the third frame arrives. In a shorter
    movie the delay is what the memory held, and the muxer refuses the times. Without B frames there is none.
    In frames of one column of blocks, x265 predicts from corners of the border that it never fills: the file
    depends on what the memory held. Smaller blocks make more columns. In frames 48 pixels wide or less, its
    CU tree writes past the end of a buffer.
    """
    options = dict(encode.options)
    if encode.codec == "libx264" and _has_avx512():
        options["x264-params"] += ":asm=AVX2"
    if encode.codec == "libx265" and not can_reorder:
        options["x265-params"] += ":bframes=0"
    if encode.codec == "libx265" and width <= _CODING_BLOCK:
        options["x265-params"] += ":ctu=16:cutree=0" if width <= 48 else ":ctu=32"
    if light is not None:
        name, display, content = _LIGHT_OPTIONS[encode.codec]
        options[name] += f":{display}:{content}={light[0]},{light[1]}"
    return options


@cache
def _has_avx512() -> bool:
    from llvmlite.binding import get_host_cpu_features

    return bool(get_host_cpu_features().get("avx512f"))


def _chain(first: deque[Frame], rest: Iterator[Frame]) -> Iterator[Frame]:
    """Yield the first frames, letting go of each, then the rest."""
    while first:
        yield first.popleft()
    yield from rest


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}×{shape[0]} pixels" + (" and a coverage" if shape[2] == 4 else "")


@contextmanager
def _restrained_svt() -> Iterator[None]:
    """Keep SVT-AV1 from writing to the terminal, and from leaving this thread with real-time priority.

    As root it puts the thread that opens it under SCHED_FIFO at the highest priority. Child processes inherit
    that, and where their threads wait busily, they starve all others.
    """
    before = os.environ.get("SVT_LOG")
    os.environ.setdefault("SVT_LOG", "1")
    can_schedule = hasattr(os, "sched_getscheduler")  # Linux
    policy = (os.sched_getscheduler(0), os.sched_getparam(0)) if can_schedule else None
    try:
        yield
    finally:
        if policy is not None and os.sched_getscheduler(0) != policy[0]:
            os.sched_setscheduler(0, *policy)
        if before is None:
            del os.environ["SVT_LOG"]


class _MovieFile(io.FileIO):
    """The file that FFmpeg writes. It keeps the disk's errors for `require_written`.

    FFmpeg calls `write` and `read` from C, where exceptions are printed and lost.
    """

    def __init__(self, path: Path, mode: str = "w+") -> None:
        super().__init__(str(path), mode)
        self.errors: list[OSError] = []

    def opened_again(self, url: str, flags: int, options: object) -> _MovieFile:
        """Open the file for FFmpeg to read, which moves a movie's index to the beginning.

        FFmpeg itself takes a call that a signal or a network file system interrupts for an error.
        """
        file = _MovieFile(Path(url), "r")
        file.errors = self.errors
        return file

    def write(self, data: Any) -> int:
        rest = memoryview(data)
        while len(rest) and not self.errors:
            try:
                rest = rest[super().write(rest) :]
            except OSError as error:
                self.errors.append(error)
        return len(data)

    def read(self, size: int | None = -1) -> bytes:
        try:
            return super().read(size) or b""
        except OSError as error:
            self.errors.append(error)
            return b""

    def require_written(self) -> None:
        """Raises the first OSError of the disk."""
        if self.errors:
            raise self.errors[0]
