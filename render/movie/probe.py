"""Facts about a movie, found by decoding it to its end. Knows av, and imageio for animated WebP."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av

from render.base.errors import CorruptImageError, MissingImageError

_UNTOLD = 2
"""H.273 for a colour that nothing is said of."""


@dataclass(frozen=True)
class MovieFacts:
    """What a movie holds, decoded in full; the four colour numbers are ITU-T H.273 codes (1 is BT.709).

    range     1 is limited, 2 full
    tag       the codec's name in the container, such as hvc1
    timecode  of the first frame; empty where there is none
    alpha     whether pictures bring their coverage
    sound     the codec of sound; empty where there is none
    seconds   how long the sound lasts
    """

    frames: int
    width: int
    height: int
    rate: Fraction
    pixel_format: str
    primaries: int
    transfer: int
    matrix: int
    range: int
    codec: str = ""
    tag: str = ""
    timecode: str = ""
    alpha: bool = False
    sound: str = ""
    seconds: float = 0.0


def probe_movie(path: Path) -> MovieFacts:
    """Decode every frame and tell what is there. Raises MissingImageError or CorruptImageError."""
    if not path.is_file():
        raise MissingImageError(f"{path}: there is no such movie")
    try:
        if path.suffix == ".webp":
            return _of_webp(path)
        with av.open(str(path)) as container:
            return _of(container)
    except (av.error.FFmpegError, OSError, ValueError, IndexError, TypeError) as error:
        raise CorruptImageError(f"{path}: cannot be decoded to its end ({error}); make it again") from None


def _of(container: Any) -> MovieFacts:
    stream = container.streams.video[0]
    heard = container.streams.audio[0] if container.streams.audio else None
    count, samples = 0, 0
    for frame in container.decode(*[stream, heard][: 1 if heard is None else 2]):
        if isinstance(frame, av.VideoFrame):
            count += 1
        else:
            samples += frame.samples
    codec = stream.codec_context
    pixels = str(codec.pix_fmt)
    return MovieFacts(
        frames=count,
        width=codec.width,
        height=codec.height,
        rate=Fraction(stream.average_rate),
        pixel_format=pixels,
        primaries=int(codec.color_primaries),
        transfer=int(codec.color_trc),
        matrix=int(codec.colorspace),
        range=int(codec.color_range),
        codec=str(codec.codec.canonical_name),
        tag=str(codec.codec_tag).strip("\0 "),
        timecode=_timecode(container, stream),
        alpha=pixels.startswith(("yuva", "gbrap", "rgba", "bgra")),
        sound=str(heard.codec_context.codec.canonical_name) if heard is not None else "",
        seconds=samples / heard.codec_context.sample_rate if heard is not None else 0.0,
    )


def _timecode(container: Any, stream: Any) -> str:
    """In QuickTime it is a track of its own that the pictures name; Matroska has a tag."""
    tags = {name.lower(): value for of in (container, stream) for name, value in of.metadata.items()}
    return str(tags.get("timecode", ""))


def _of_webp(path: Path) -> MovieFacts:
    """FFmpeg makes animated WebP but does not read it. Frames like the one before are not kept there."""
    import imageio.v3 as iio

    with iio.imopen(path, "r", plugin="pillow") as file:
        count, duration, shape, alpha = 0, 0.0, (0, 0, 0), False
        for picture in file.iter():
            duration += float(file.metadata(index=count).get("duration", 0.0))
            count, shape = count + 1, picture.shape
            alpha = alpha or bool(shape[2] == 4 and picture[..., 3].min() < 255)
    rate = Fraction(count * 1000) / Fraction(round(duration)) if duration else Fraction(0)
    return MovieFacts(
        frames=count,
        width=shape[1],
        height=shape[0],
        rate=rate,
        pixel_format="rgba" if shape[2] == 4 else "rgb24",
        primaries=_UNTOLD,
        transfer=_UNTOLD,
        matrix=_UNTOLD,
        range=2,
        codec="webp",
        alpha=alpha,
    )
