"""Encodes: container, codec, pixel format and options of every kind of movie."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import ceil

from flowsculpt.render.base.render_errors import BadInputError


@dataclass(frozen=True)
class Container:
    """A file format: FFmpeg's name, its options, and the codec of its sound (None: it holds no sound)."""

    format: str
    suffix: str
    options: Mapping[str, str] = field(default_factory=dict)
    audio_codec: str | None = None


@dataclass(frozen=True)
class Encode:
    """A way to write movies. Codecs and pixel formats have FFmpeg's names.

    pixel_format  of the file; alpha_format, for frames with coverage, which is dropped where it is None
    options       of the codec
    codec_tag     the codec's name in the container, where it is not FFmpeg's choice
    display       the display that frames are made for: rec709, srgb, pq or hlg
    min_size      pixels along a side
    """

    name: str
    container: Container
    codec: str
    pixel_format: str
    options: Mapping[str, str]
    alpha_format: str | None = None
    codec_tag: str | None = None
    display: str = "rec709"
    min_size: int = 1

    @property
    def suffix(self) -> str:
        """The suffix of its files."""
        return self.container.suffix

    def file_name(self, *parts: str) -> str:
        """Return the name of a file of this encode: `A010.1-48.h264.mp4`. `.webp` stands for itself."""
        name, *more = parts
        own = [] if self.suffix == f".{self.name}" else [self.name]
        return ".".join([name, *own, *more]) + self.suffix

    @property
    def colours(self) -> tuple[int, int, int]:
        """The codes of primaries, transfer and matrix (ITU-T H.273)."""
        primaries, transfer, matrix = _COLOURS.get(self.display, (1, 1, 1))
        return primaries, transfer, 0 if self.is_rgb else matrix

    @property
    def is_rgb(self) -> bool:
        """True for full-range RGB, false for limited-range Y′CbCr."""
        return self.pixel_format in ("gbrp16le", "bgra")

    @property
    def is_subsampled(self) -> bool:
        """True where colour has half the resolution, which asks for even sizes."""
        return "420" in self.pixel_format

    @property
    def has_timecode(self) -> bool:
        """True where the container can hold the timecode of the first frame."""
        return self.container not in (_WEBP, _AVIF)

    def format_of(self, channels: int) -> str:
        """Return the pixel format of the file for frames of 3 or 4 channels."""
        return self.alpha_format if channels == 4 and self.alpha_format else self.pixel_format


_COLOURS = {"pq": (9, 16, 9), "hlg": (9, 18, 9)}

_MP4 = Container("mp4", ".mp4", {"movflags": "+faststart+write_colr"}, "aac")
_MOV = Container("mov", ".mov", {"movflags": "+write_colr"}, "pcm_s24le")
MATROSKA = Container("matroska", ".mkv", {"fflags": "+bitexact"}, "pcm_s24le")  # else identifiers are random
_WEBP = Container("webp", ".webp", {"loop": "0"})  # without end
_AVIF = Container("avif", ".avif")

_X264 = {
    "preset": "medium",
    "crf": "15",
    # More bits for dark, flat areas, where gradients band; a fixed thread count gives the same file anywhere.
    "x264-params": "aq-mode=3:aq-strength=0.9:deblock=-1,-1:threads=4:lookahead-threads=1",
}
_X265 = {
    "preset": "medium",
    "crf": "16",
    # The number of frames encoded side by side decides the file; the number of cores does not.
    "x265-params": "log-level=error:frame-threads=2:aq-mode=3:deblock=-1,-1",
}
_PRORES = {"profile": "4444", "qscale": "4", "vendor": "apl0", "alpha_bits": "16", "threads": "1"}
_SVT_AV1 = {"preset": "6", "crf": "20", "g": "48", "svtav1-params": "lp=2:tune=0"}
_FFV1 = {"level": "3", "coder": "1", "context": "1", "slicecrc": "1", "slices": "4", "g": "1"}
_LIBWEBP = {"quality": "90", "compression_level": "4"}

H264 = Encode("h264", _MP4, "libx264", "yuv420p10le", _X264)
"""H.264 of 10 bits, for delivery."""

REVIEW = Encode("review", _MP4, "libx264", "yuv420p", {**_X264, "g": "1", "bf": "0"})
"""H.264 of 8 bits, every frame whole: steps exactly, forwards and backwards."""

H265 = Encode("h265", _MP4, "libx265", "yuv420p10le", _X265, codec_tag="hvc1", min_size=32)
"""H.265 of 10 bits, half as large; its tag hvc1 is what Apple's players ask for."""

PRORES4444 = Encode("prores4444", _MOV, "prores_ks", "yuv444p10le", _PRORES, alpha_format="yuva444p10le")
"""ProRes 4444 in QuickTime, for grading and compositing; with the subject's coverage as alpha."""

AV1 = Encode("av1", _MP4, "libsvtav1", "yuv420p10le", _SVT_AV1, min_size=64)
"""AV1 of 10 bits, for the web: the smallest."""

HDR10 = replace(H265, name="hdr10", display="pq")
"""H.265 of high dynamic range, in PQ with the light of its frames, for televisions and HDR screens."""

HDR10_AV1 = replace(AV1, name="hdr10-av1", display="pq")
"""The same in AV1, for the web."""

AVIF = replace(HDR10_AV1, name="avif", container=_AVIF)
"""AVIF in PQ, for pages: a still of one frame, a picture that moves of several."""

HLG = replace(H265, name="hlg", display="hlg")
"""H.265 in hybrid log-gamma, for broadcasters; it also plays on screens of standard range."""

FFV1 = Encode("ffv1", MATROSKA, "ffv1", "gbrp16le", _FFV1)
"""FFV1 in Matroska, RGB of 16 bits, for the archive: nothing is lost, damage is noticed."""

WEBP = Encode("webp", _WEBP, "libwebp_anim", "bgra", _LIBWEBP, display="srgb")
"""Animated WebP, for pages: no player needed."""

H264_8_BITS = replace(H264, pixel_format="yuv420p")
"""8 bits a sample play everywhere; 10 bits keep gradients smooth."""

PHONE = replace(H264_8_BITS, name="phone")
"""H.264 of 8 bits, for phones, social networks and browsers: not all of them play 10."""

ENCODES = {
    encode.name: encode
    for encode in (REVIEW, PHONE, H264, H265, HDR10, HDR10_AV1, HLG, AVIF, PRORES4444, AV1, FFV1, WEBP)
}
"""The encodes of movies, by name."""


def require_size(encode: Encode, width: int, height: int) -> None:
    """Raises BadInputError where frames are smaller than the codec can hold."""
    if min(width, height) < encode.min_size:
        raise BadInputError(
            f"{encode.name} cannot hold pictures of {width}×{height} pixels, only {encode.min_size} along "
            "each side or more; ffv1 and prores4444 take any size"
        )


MAX_RATE = 99  # the highest nominal rate: timecode has two digits for frames


def timecode(frame: int, rate: Fraction) -> str:
    """Return the timecode of a frame: `00:00:01:18` for frame 42 at 24 frames per second.

    Frame 0 is 00:00:00:00. 24000/1001 counts 24 frames per second, as all non-drop timecode does, so it runs
    behind the clock. It wraps after 24 hours; frames before 0 lie at the end of the day. A rate that has no
    timecode gives an empty string.
    """
    nominal = ceil(rate)
    if nominal > MAX_RATE or rate.denominator not in (1, 1001):
        return ""
    seconds, frames = divmod(frame % (nominal * 86400), nominal)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}:{frames:02d}"
