"""The encodes there are: of what codec, in which container, with which colours, and what each is for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from render.base.errors import BadInputError, suggestion

X264 = {
    "preset": "medium",
    "crf": "15",
    # Bits go to dark, flat places, where gradients band; a fixed thread count gives the same file anywhere.
    "x264-params": "aq-mode=3:aq-strength=0.9:deblock=-1,-1:threads=4:lookahead-threads=1",
}


@dataclass(frozen=True)
class Encode:
    """How frames become a file.

    purpose    what it is for, in a line
    suffix     of its file
    codec      FFmpeg's encoder, and its options
    given      the planes that frames are turned into, FFmpeg's name for them
    stored     what the file holds
    bits       a sample
    covered    (given, stored) for frames that bring their coverage; None where it is dropped
    tag        the codec's name in the container, where it is to be another than FFmpeg's
    container  options of the container
    sound      the encoder of sound; None where the file can hold none
    display    whose values the frames are: rec709, or srgb
    smallest   pixels along a side
    """

    name: str
    purpose: str
    suffix: str
    codec: str
    given: str
    stored: str
    bits: int
    options: Mapping[str, str] = field(default_factory=dict)
    covered: tuple[str, str] | None = None
    tag: str | None = None
    container: Mapping[str, str] = field(default_factory=dict)
    sound: str | None = None
    display: str = "rec709"
    smallest: int = 1

    @property
    def is_rgb(self) -> bool:
        """Whether the file holds red, green and blue, of full range, rather than BT.709 Y′CbCr."""
        return self.given in ("gbrp16le", "bgra")

    @property
    def halves_colour(self) -> bool:
        """Whether colour has half the resolution, for which sizes must be even."""
        return "420" in self.stored

    @property
    def has_timecode(self) -> bool:
        return self.suffix != ".webp"


_MP4 = {"movflags": "+faststart+write_colr"}

ENCODES = {
    each.name: each
    for each in (
        Encode(
            "review",
            "H.264 of 8 bits, every frame whole: steps exactly, forwards and backwards",
            ".mp4",
            "libx264",
            "yuv444p",
            "yuv420p",
            8,
            options={**X264, "g": "1", "bf": "0"},
            container=_MP4,
            sound="aac",
        ),
        Encode(
            "h264",
            "H.264 of 10 bits, for delivery",
            ".mp4",
            "libx264",
            "yuv444p10le",
            "yuv420p10le",
            10,
            options=X264,
            container=_MP4,
            sound="aac",
        ),
        Encode(
            "h265",
            "H.265 of 10 bits, half as large; its tag hvc1 is what Apple's players ask for",
            ".mp4",
            "libx265",
            "yuv444p10le",
            "yuv420p10le",
            10,
            # How many frames are encoded side by side decides the file, how many cores do it does not.
            options={
                "preset": "medium",
                "crf": "16",
                "x265-params": "log-level=error:frame-threads=2:aq-mode=3:deblock=-1,-1",
            },
            tag="hvc1",
            container=_MP4,
            sound="aac",
            smallest=32,
        ),
        Encode(
            "prores4444",
            "ProRes 4444 in QuickTime, for grading and compositing; with the subject's coverage as alpha",
            ".mov",
            "prores_ks",
            "yuv444p10le",
            "yuv444p10le",
            10,
            options={"profile": "4444", "qscale": "4", "vendor": "apl0", "alpha_bits": "16", "threads": "1"},
            covered=("yuva444p10le", "yuva444p10le"),
            container={"movflags": "+write_colr"},
            sound="pcm_s24le",
        ),
        Encode(
            "av1",
            "AV1 of 10 bits, for the web: the smallest",
            ".mp4",
            "libsvtav1",
            "yuv444p10le",
            "yuv420p10le",
            10,
            options={"preset": "6", "crf": "20", "g": "48", "svtav1-params": "lp=2:tune=0"},
            container=_MP4,
            sound="aac",
            smallest=64,
        ),
        Encode(
            "ffv1",
            "FFV1 in Matroska, RGB of 16 bits, for the archive: nothing is lost, damage is noticed",
            ".mkv",
            "ffv1",
            "gbrp16le",
            "gbrp16le",
            16,
            options={"level": "3", "coder": "1", "context": "1", "slicecrc": "1", "slices": "4", "g": "1"},
            container={"fflags": "+bitexact"},  # without, Matroska's names of segments are random
            sound="pcm_s24le",
        ),
        Encode(
            "webp",
            "animated WebP, for pages: no player needed",
            ".webp",
            "libwebp_anim",
            "bgra",
            "bgra",
            8,
            options={"quality": "90", "compression_level": "4", "loop": "0"},
            display="srgb",
        ),
    )
}
"""By the name that a user says."""


FILM = {
    8: replace(ENCODES["h264"], given="yuv444p", stored="yuv420p", bits=8),
    10: ENCODES["h264"],
}
"""What films and movies of shots are encoded by, by their bits a sample."""

SKETCH = replace(ENCODES["review"], options={**X264, "preset": "superfast", "g": "12", "bf": "0"})
"""What previews are encoded by: soon done, and stepped through quickly."""


def encode_named(name: str) -> Encode:
    """Raises BadInputError for a name of none, with those there are."""
    if name not in ENCODES:
        close = suggestion(name, ENCODES)
        known = "" if close.startswith("There are") else f" There are: {', '.join(ENCODES)}."
        raise BadInputError(f"{name!r} is no deliverable. {close}{known}")
    return ENCODES[name]


def require_size(encode: Encode, width: int, height: int) -> None:
    """Raises BadInputError where pictures are smaller than the codec can hold."""
    if min(width, height) < encode.smallest:
        raise BadInputError(
            f"{encode.name} cannot hold pictures of {width}×{height} pixels, only {encode.smallest} along "
            "each side or more; ffv1 and prores4444 take any size"
        )
