"""Facts about a movie, found by decoding it to its end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import av
import imageio.v3 as iio

from flowsculpt.render.base.render_errors import CorruptImageError, MissingImageError

_UNSPECIFIED = 2  # H.273 for a colour that is not specified


@dataclass(frozen=True)
class MovieFacts:
    """Facts about a movie, decoded in full; the four colour numbers are ITU-T H.273 codes (1 is BT.709).

    range     1 is limited, 2 full
    tag       the codec's name in the container, such as hvc1
    timecode  of the first frame; empty where there is none
    alpha     True where frames bring their coverage
    sound     the codec of sound; empty where there is none
    seconds   the length of the sound
    """

    frames: int
    width: int
    height: int
    rate: Fraction
    pixel_format: str
    primaries: int = _UNSPECIFIED
    transfer: int = _UNSPECIFIED
    matrix: int = _UNSPECIFIED
    range: int = 2
    codec: str = ""
    tag: str = ""
    timecode: str = ""
    alpha: bool = False
    sound: str = ""
    seconds: float = 0.0


def probe_movie(path: Path) -> MovieFacts:
    """Decode every frame of a movie and return its facts. Raises MissingImageError or CorruptImageError."""
    if not path.is_file():
        raise MissingImageError(f"{path}: movie not found")
    try:
        if path.suffix == ".webp":
            return _probe_webp(path)
        return _probe(path)
    except (av.error.FFmpegError, OSError, ValueError, IndexError, TypeError) as error:
        raise CorruptImageError(f"{path}: cannot be decoded to its end ({error}); make it again") from None


def _probe(path: Path) -> MovieFacts:
    with av.open(str(path)) as container:
        stream = max(container.streams.video, key=lambda each: each.frames)  # an AVIF begins with a still
        stream.thread_type = "AUTO"
        codec, pixel_format = stream.codec_context, str(stream.codec_context.pix_fmt)
        tags = {name.lower(): value for name, value in {**container.metadata, **stream.metadata}.items()}
        facts = MovieFacts(
            frames=sum(1 for _ in container.decode(stream)),
            width=codec.width,
            height=codec.height,
            rate=Fraction(stream.average_rate or 0),
            pixel_format=pixel_format,
            primaries=int(codec.color_primaries),
            transfer=int(codec.color_trc),
            matrix=int(codec.colorspace),
            range=int(codec.color_range),
            codec=str(codec.codec.canonical_name),
            tag=str(codec.codec_tag).strip("\0 "),
            timecode=str(tags.get("timecode", "")),
            alpha=pixel_format.startswith(("yuva", "gbrap", "rgba", "bgra")),
        )
    with av.open(str(path)) as container:
        if not container.streams.audio:
            return facts
        samples = sum(frame.samples for frame in container.decode(audio=0))
        sound = container.streams.audio[0].codec_context
        return replace(facts, sound=str(sound.codec.canonical_name), seconds=samples / sound.sample_rate)


def _probe_webp(path: Path) -> MovieFacts:
    """Read animated WebP with Pillow: FFmpeg only writes it. Frames like the one before count with it."""
    with iio.imopen(path, "r", plugin="pillow") as file:
        count, duration, shape, alpha = 0, 0.0, (0, 0, 0), False
        for picture in file.iter():
            duration += float(file.metadata(index=count).get("duration", 0.0))
            count, shape = count + 1, picture.shape
            alpha = alpha or bool(shape[2] == 4 and picture[..., 3].min() < 255)
    return MovieFacts(
        frames=count,
        width=shape[1],
        height=shape[0],
        rate=Fraction(count * 1000, round(duration)) if duration else Fraction(0),
        pixel_format="rgba" if shape[2] == 4 else "rgb24",
        codec="webp",
        alpha=alpha,
    )
