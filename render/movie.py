"""Frames into an H.264 movie with its colours named, and facts about a movie. Knows imageio and av.

imageio's own conversion takes the BT.601 matrix and names no colours, so players shift them. Frames are
turned into BT.709 limited range here, to the last bit, and handed over as planes.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import imageio.v3 as iio
import numpy as np
from numpy.typing import NDArray

from render.appear import appearing, cannot_write
from render.dither import dither_pattern
from render.errors import BadInputError, CorruptImageError, MissingImageError

Frame = NDArray[np.uint8] | NDArray[np.uint16]

_BT709 = 1
_LIMITED = 1
_LUMA = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)  # ITU-R BT.709-6, 3.2
_PIXELS = {8: ("yuv444p", "yuv420p"), 10: ("yuv444p10le", "yuv420p10le")}
_ENCODER = {
    "preset": "medium",
    "crf": "15",
    # Bits go to dark, flat places, where gradients band; a fixed thread count gives the same file anywhere.
    "x264-params": "aq-mode=3:aq-strength=0.9:deblock=-1,-1:threads=4:lookahead-threads=1",
}


@dataclass(frozen=True)
class MovieFacts:
    """What a movie holds, decoded in full; the four colour numbers are ITU-T H.273 codes (1 is BT.709)."""

    frames: int
    width: int
    height: int
    rate: Fraction
    pixel_format: str
    primaries: int
    transfer: int
    matrix: int
    range: int


def write_movie(path: Path, frames: Iterator[Frame], rate: Fraction, bits: int = 8) -> int:
    """Encode display frames (H, W, 3) as they come; return how many there were.

    uint8 frames count 0 … 255, uint16 frames 0 … 65535. `bits` a sample in the file: 8 plays everywhere,
    10 keeps gradients smooth. H.264 halves the colour's resolution and needs even sizes: an odd last
    column or row is repeated once. The movie appears under its name only when complete.
    Raises BadInputError for no frames, or frames of different sizes; RenderEnvironmentError where the
    disk is full or the folder cannot be written.
    """
    with appearing(path) as temporary:
        try:
            return _encode(temporary, path, iter(frames), rate, bits)
        except av.error.FFmpegError as error:
            raise cannot_write(path, error.strerror) from None


def probe_movie(path: Path) -> MovieFacts:
    """Decode every frame and tell what is there. Raises MissingImageError or CorruptImageError."""
    if not path.is_file():
        raise MissingImageError(f"{path}: there is no such movie")
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            count = sum(1 for _ in container.decode(stream))
            codec = stream.codec_context
            return MovieFacts(
                frames=count,
                width=codec.width,
                height=codec.height,
                rate=Fraction(stream.average_rate),
                pixel_format=str(codec.pix_fmt),
                primaries=int(codec.color_primaries),
                transfer=int(codec.color_trc),
                matrix=int(codec.colorspace),
                range=int(codec.color_range),
            )
    except (av.error.FFmpegError, IndexError, TypeError) as error:
        raise CorruptImageError(f"{path}: cannot be decoded to its end ({error}); make it again") from None


class _Sink:
    """The file that imageio writes to. It keeps the disk's complaint until somebody can hear it.

    FFmpeg calls back into Python to write, where an exception would be printed and lost.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        self.error: OSError | None = None
        self._file = path.open("w+b", buffering=0)

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while len(view) and self.error is None:
            try:
                view = view[self._file.write(view) :]
            except OSError as error:
                self.error = error
        return len(data)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def close(self) -> None:
        self._file.close()

    def check(self) -> None:
        if self.error is not None:
            raise self.error


def _encode(temporary: Path, path: Path, frames: Iterator[Frame], rate: Fraction, bits: int) -> int:
    if bits not in _PIXELS:
        raise BadInputError(f"a movie of {bits} bits is not possible; it can have 8 or 10")
    first = next(frames, None)
    if first is None:
        raise BadInputError(f"{path}: a movie of no frames is not possible")
    given, stored = _PIXELS[bits]
    layout: dict[str, Any] = {"container": "mp4", "options": {"movflags": "+faststart+write_colr"}}
    with closing(_Sink(temporary)) as sink:
        with iio.imopen(sink, "w", plugin="pyav", extension=".mp4", **layout) as movie:
            movie.init_video_stream("libx264", fps=float(rate), pixel_format=stored)
            _name_colours(movie)
            count = 0
            for frame in itertools.chain([first], frames):
                if frame.shape != first.shape:
                    raise BadInputError(
                        f"{path}: frame {count} has {frame.shape[1]}×{frame.shape[0]} pixels where the first "
                        f"has {first.shape[1]}×{first.shape[0]}; all must have the same"
                    )
                movie.write_frame(_planes(frame, bits), pixel_format=given)
                sink.check()
                count += 1
        sink.check()
    return count


def _name_colours(movie: Any) -> None:
    """Tags and encoder settings; imageio has no public door to them, so its stream is taken as it is."""
    codec = movie._video_stream.codec_context
    codec.color_primaries = codec.color_trc = codec.colorspace = _BT709
    codec.color_range = _LIMITED
    codec.options = dict(_ENCODER)


def _planes(frame: Frame, bits: int) -> NDArray[Any]:
    """Full-range RGB as limited-range BT.709 Y, Cb, Cr planes (3, H, W) of even size, dithered."""
    if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype not in (np.uint8, np.uint16):
        raise BadInputError(f"a frame is {frame.dtype} {frame.shape}; it must be uint8 or uint16 (H, W, 3)")
    height, width = frame.shape[:2]
    padded = np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    rgb = padded.astype(np.float32) / np.float32(np.iinfo(frame.dtype).max)
    luma = rgb @ _LUMA
    blue = (rgb[..., 2] - luma) / np.float32(1.8556)
    red = (rgb[..., 0] - luma) / np.float32(1.5748)
    scale = np.float32(2 ** (bits - 8))
    values = np.stack([16 + 219 * luma, 128 + 224 * blue, 128 + 224 * red]) * scale
    noise = dither_pattern(*luma.shape) if frame.dtype == np.uint16 else np.float32(0.5)
    return np.floor(values + noise).astype(np.uint8 if bits == 8 else np.uint16)
