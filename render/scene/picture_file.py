"""Open pictures from outside: which pixels of a file are the picture, and what colours they state.

Textures and environment maps are read here. A file may hold layers and parts, a data window that is not its
display window, an orientation, and a colour space: each is followed, or refused by name.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.input_files import other_content, parsing
from flowsculpt.render.base.render_errors import BadInputError, reason_of
from flowsculpt.render.scene.picture_layers import ExrPart, Layer, choose_layer
from flowsculpt.render.scene.rgb_spaces import (
    RgbEncoding,
    encoding_of,
    encoding_of_icc,
    linear_of_srgb,
    power,
    same,
)

DEFAULT_CONFIG = "ocio://default"
"""OpenColorIO's own config, which names the colour spaces of textures."""

Pixels = NDArray[np.float32]
Window = tuple[int, int, int, int]
"""Left, top, width and height, pixels."""

_WINDOWED = ("openexr", "tiff", "rla")
"""Formats with a display window. A PNG's offset is that of a layer on its page, and GIF frames are whole."""

_SRGB = ("srgb_rec709_scene", "srgb_rec709_display")
_ADOBE_RGB = "g22_adobergb_scene"
_EXIF_ADOBE_RGB = (b"\1\0\2\0\4\0\0\0R03\0", b"\0\1\0\2\0\0\0\4R03\0")
"""EXIF's interoperability index of Adobe RGB (DCF 2.0, 4.1.1), in both byte orders."""

_PNG_SRGB = (45000, 46000)
"""Range of the gAMA that PNG's specification pairs with sRGB, 45455: such files are sRGB pictures."""

_LOST_PIXELS = ("premature end", "bad huffman code")
"""Parts of libjpeg's warnings of pixels that it made up; after its other warnings none are missing."""

_HEADER_BYTES = 1 << 20
"""Bytes at the start of a file that hold its header: of PNG and Radiance, and EXIF of a JPEG."""


@dataclass(frozen=True)
class StatedSpace:
    """The colour space that a file states.

    name      for messages and keys
    space     as a shot would write it; empty where `encoding` holds it
    """

    name: str
    space: str = ""
    encoding: RgbEncoding | None = None


class OpenedPicture:
    """A picture from outside, opened.

    kind      OpenImageIO's name of the file format
    is_float  True if the file stores floats, which are linear where nothing else is stated
    """

    def __init__(self, file: Any, path: str) -> None:
        """Find the layer that is the picture. Raises BadInputError where there is none."""
        self.path, self.kind = path, str(file.format_name())
        self._file = file
        self._layer = self._chosen_layer()
        file.seek_subimage(self._layer.part, 0)
        self.spec = file.spec()
        self.is_float = str(self.spec.channelformat(self._layer.channels[0])) in ("half", "float", "double")
        self._require_readable()

    @property
    def channels(self) -> range:
        """The channels that are decoded; those of the picture are among them."""
        return range(min(self._layer.channels), max(self._layer.channels) + 1)

    @property
    def count(self) -> int:
        """The number of channels of the picture: 3, or 1 of grey."""
        return len(self._layer.channels)

    @property
    def is_cube(self) -> bool:
        """True for the six faces of a cube."""
        return "Cube" in self.spec.get_string_attribute("textureformat")

    @property
    def display(self) -> Window:
        """The window that is the picture; stored pixels outside are cut, and missing ones are black."""
        spec = self.spec
        data: Window = (spec.x, spec.y, spec.width, spec.height)
        shown: Window = (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
        reaches_corner = shown == (0, 0, spec.x + spec.width, spec.y + spec.height)  # a TIFF that states none
        if self.kind not in _WINDOWED or (self.kind == "tiff" and reaches_corner):
            return data
        return shown

    def pixels(self) -> Pixels:
        """Return the picture as stored, (H, W, 3) or (H, W, 1). Raises BadInputError for a truncated file."""
        first, last = self.channels.start, self.channels.stop
        stored = self._file.read_image(self._layer.part, 0, first, last)
        messages = _messages(self._file)
        lost = [line for line in messages if any(words in line.lower() for words in _LOST_PIXELS)]
        if stored is None or (self.kind == "jpeg" and lost):
            reason = _first_line([*lost, *messages])
            raise BadInputError(f"{self.path}: it cannot be read to its end ({reason}); write it again")
        spec = self.spec
        pixels = np.asarray(stored, dtype=np.float32).reshape(spec.height, spec.width, -1)
        if len(self.channels) != self.count:
            pixels = pixels[..., [channel - first for channel in self._layer.channels]]
        pixels = _orient(self._in_display(pixels), self._orientation)
        return pixels if self._exposure is None else (pixels / self._exposure).astype(np.float32)

    def alpha(self) -> Pixels:
        """Return the alpha of the picture as stored, (H, W, 1), or one pixel of 1. Raises as `pixels`."""
        number = int(self.spec.alpha_channel)
        if number < 0:
            return np.ones((1, 1, 1), np.float32)
        self._layer = replace(self._layer, channels=(number,))
        return self.pixels()

    def stated_space(self) -> StatedSpace | None:
        """Return the colour space that the file states, None for what files of its kind are taken for.

        These are linear Rec.709 for floats and sRGB for integers. Raises BadInputError for a space that
        cannot be converted.
        """
        try:
            stated = self._stated()
        except ValueError as error:
            raise BadInputError(
                f"{self.path}: {error}; write it in sRGB or linear Rec.709, or state the space of a "
                "texture: {file: …, space: …}"
            ) from None
        usual, curve = ("linear", same) if self.is_float else ("srgb", linear_of_srgb)
        if stated is None or stated.space == usual:
            return None
        return None if stated.encoding is not None and stated.encoding.is_like(curve) else stated

    def reading(self, space: str | None) -> str:
        """Return what is followed besides the first channels as stored; empty for most files.

        space  the colour space that a shot states, in place of the file's own
        """
        spec, facts = self.spec, []
        if (self._layer.part, self._layer.channels) != (0, _first(spec.nchannels)):
            facts.append(f"layer {self._layer.part} {self._layer.channels}")
        if self.display != (spec.x, spec.y, spec.width, spec.height):
            facts.append(f"window {self.display}")
        if self._orientation != 1:
            facts.append(f"orientation {self._orientation}")
        if self._exposure is not None:
            facts.append(f"exposure {self._exposure.tolist()}")
        stated = self.stated_space() if space is None else None
        return ", ".join([*facts, stated.name] if stated else facts)

    def _chosen_layer(self) -> Layer:
        spec = self._file.spec()
        if spec.deep:
            raise self._refusal("it has deep pixels; flatten it")
        if self.kind != "openexr":
            return Layer("", 0, _first(spec.nchannels))
        views = spec.getattribute("multiView") or ()
        parts: list[ExrPart] = []
        while self._file.seek_subimage(len(parts), 0):
            spec = self._file.spec()
            name, view = (spec.get_string_attribute(key) for key in ("oiio:subimagename", "view"))
            parts.append(ExrPart(name, view, tuple(spec.channelnames) if not spec.deep else ()))
        last_message(self._file)  # of a part beyond the last, which is not an error
        try:
            return choose_layer(parts, (views,) if isinstance(views, str) else tuple(views))
        except ValueError as error:
            raise self._refusal(f"{error}; write only that layer, for example with oiiotool --ch") from None

    def _require_readable(self) -> None:
        """Raise BadInputError for pixels that are not flat, not red, green and blue, or not shown."""
        spec = self.spec
        if spec.deep:
            raise self._refusal("it has deep pixels; flatten it")
        if spec.depth > 1:
            raise self._refusal("it is a volume; write a slice of it")
        inks = [spec.get_string_attribute(f"{kind}:ColorSpace") for kind in ("jpeg", "tiff")]
        inks += [spec.get_string_attribute("ICCProfile:color_space")]
        for name in inks:
            if name in ("CMYK", "YCbCrK", "CIELAB", "Lab", "color separated"):
                raise self._refusal(f"its colours are {name}; write it as RGB")
        left, top, width, height = self.display
        across = min(left + width, spec.x + spec.width) - max(left, spec.x)
        if min(across, min(top + height, spec.y + spec.height) - max(top, spec.y)) <= 0:
            raise self._refusal("its display window is empty; write it again")

    def _refusal(self, reason: str) -> BadInputError:
        return BadInputError(f"{self.path}: {reason}")

    def _in_display(self, pixels: Pixels) -> Pixels:
        """Return the pixels of the display window: black where none are stored."""
        spec, (left, top, width, height) = self.spec, self.display
        if self.display == (spec.x, spec.y, spec.width, spec.height):
            return pixels
        right, down = left - spec.x, top - spec.y
        kept = pixels[max(down, 0) : max(down + height, 0), max(right, 0) : max(right + width, 0)]
        shown = np.zeros((height, width, pixels.shape[2]), dtype=np.float32)
        row, column = max(-down, 0), max(-right, 0)
        shown[row : row + kept.shape[0], column : column + kept.shape[1]] = kept
        return shown

    @cached_property
    def _orientation(self) -> int:
        """The orientation by EXIF: 1 to 8."""
        stated = self.spec.get_int_attribute("Orientation", 1)
        if self.kind == "hdr":  # OpenImageIO takes the two for each other: +X +Y begins at the lower left
            stated = {6: 8, 8: 6}.get(stated, stated)
        return stated if 1 <= stated <= 8 else 1

    @cached_property
    def _header(self) -> bytes:
        return _header_of(self.path)

    @cached_property
    def _exposure(self) -> NDArray[np.float64] | None:
        """Factors of red, green and blue that the pixels of a Radiance picture have; None for 1."""
        if self.kind != "hdr":
            return None
        factors = np.ones(3)
        for name, value in self._radiance_lines():
            if name in (b"EXPOSURE", b"COLORCORR"):
                factors *= [float(number) for number in value.split()]
        if not (np.isfinite(factors).all() and factors.min() > 0.0):
            raise self._refusal("its EXPOSURE or COLORCORR is not above 0; write it again")
        return None if (factors == 1.0).all() else factors

    def _radiance_lines(self) -> list[tuple[bytes, bytes]]:
        """Return names and values of the header of a Radiance picture."""
        head = re.split(rb"\r?\n\r?\n", self._header, maxsplit=1)[0]
        return [(name, value) for name, equals, value in map(_assignment, head.splitlines()) if equals]

    def _stated(self) -> StatedSpace | None:
        """Return the space that the file states. Raises ValueError where it cannot be converted."""
        code_points = (self.spec.getattribute("CICP") or ())[:2]  # they stand over a profile (PNG, 4.3)
        if code_points and not _is_unspecified(*code_points):
            return _named(_name_of_code_points(*code_points))
        profile = self.spec.getattribute("ICCProfile")
        if profile is not None:
            return self._profile_space(bytes(profile))
        name = self.spec.get_string_attribute("oiio:ColorSpace")
        match self.kind:
            case "openexr":
                return self._openexr_space(name)
            case "hdr":
                return self._hdr_space()
            case "png":
                return self._png_space()
            case "dpx":
                return self._dpx_space(name)
            case "cineon":
                raise ValueError("its transfer is printing density")
        return self._exif_space()

    def _profile_space(self, content: bytes) -> StatedSpace:
        title = self.spec.get_string_attribute("ICCProfile:profile_description") or "without a name"
        try:
            return StatedSpace(f"profile {title}", encoding=encoding_of_icc(content))
        except ValueError as error:
            if title.startswith("sRGB"):  # the tables of sRGB_v4_ICC_preference
                return StatedSpace(title, "srgb")
            raise ValueError(f"{error} ({reason_of(ValueError(title))})") from None

    def _exif_space(self) -> StatedSpace | None:
        exif = self.spec.get_int_attribute("Exif:ColorSpace", 1)
        if exif == 2 or (exif == 65535 and any(entry in self._header for entry in _EXIF_ADOBE_RGB)):
            return StatedSpace(_ADOBE_RGB, _ADOBE_RGB)
        return None

    def _openexr_space(self, name: str) -> StatedSpace | None:
        chromaticities = self.spec.getattribute("chromaticities")
        encoding = None if chromaticities is None else encoding_of(chromaticities)
        if name and name.rpartition(":")[2] != "unknown" and (_is_known(name) or encoding is None):
            return _named(name)
        if encoding is None:
            return None
        return StatedSpace(f"chromaticities {tuple(chromaticities)}", encoding=encoding)

    def _hdr_space(self) -> StatedSpace | None:
        for name, value in self._radiance_lines():
            if name == b"PRIMARIES":
                encoding = encoding_of([float(number) for number in value.split()])
                return None if encoding is None else StatedSpace(f"primaries {value!r}", encoding=encoding)
        return None

    def _png_space(self) -> StatedSpace | None:
        chunks = dict(_png_chunks(self._header))
        gamma, primaries = chunks.get(b"gAMA"), chunks.get(b"cHRM")
        if b"sRGB" in chunks or (gamma is None and primaries is None):
            return None
        (number,) = struct.unpack(">I", gamma or struct.pack(">I", 45455))
        if number == 0:
            raise ValueError("its gAMA is 0")
        srgb = _PNG_SRGB[0] <= number <= _PNG_SRGB[1]
        curve = linear_of_srgb if srgb else same if number == 100000 else power(100000 / number)
        white_first = [value / 100000 for value in struct.unpack(">8I", primaries or bytes(32))]
        encoding = encoding_of([*white_first[2:], *white_first[:2]], curve)
        encoding = encoding or RgbEncoding((curve,) * 3, np.eye(3))
        return StatedSpace(f"gamma {number}, primaries {white_first}", encoding=encoding)

    def _dpx_space(self, name: str) -> StatedSpace | None:
        transfer = self.spec.get_string_attribute("dpx:Transfer")
        if transfer not in ("Linear", "ITU-R 709-4"):
            raise ValueError(f"its transfer is {reason_of(ValueError(transfer or 'not stated'))}")
        return _named(name)


def _header_of(path: str) -> bytes:
    with Path(path).open("rb") as file:
        return file.read(_HEADER_BYTES)


def _first(channels: int) -> tuple[int, ...]:
    """Return the channels of a picture without layers."""
    return (0, 1, 2) if channels >= 3 else (0,)


def _assignment(line: bytes) -> tuple[bytes, bytes, bytes]:
    name, equals, value = line.partition(b"=")
    return name.strip(), equals, value.strip()


@cache
def _config() -> Any:
    import OpenImageIO as oiio

    return oiio.ColorConfig(DEFAULT_CONFIG)


def _is_known(name: str) -> bool:
    """Tell whether OpenColorIO's own config has a space of this interop ID."""
    return name in (*_SRGB, "data") or _config().resolve(name) in _config().getColorSpaceNames()


def _named(name: str) -> StatedSpace | None:
    """Return a space by its interop ID; None where there is none. Raises ValueError for unknown ones."""
    if not name:
        return None
    if not _is_known(name):
        raise ValueError(
            f"its colour space {reason_of(ValueError(name))} is not in OpenColorIO's built-in config"
        )
    linear = _config().resolve(name) == _config().resolve("lin_rec709_scene")
    return StatedSpace(name, "srgb" if name in _SRGB else "linear" if linear else name)


def _is_unspecified(primaries: int, transfer: int) -> bool:
    """Tell whether code points (ITU-T H.273) leave a space open, or say no more than that it is sRGB."""
    return primaries in (1, 2) and transfer in (2, 13)


def _name_of_code_points(primaries: int, transfer: int) -> str:
    """Return the interop ID of code points (ITU-T H.273). Raises ValueError where there is none."""
    curve = 1 if transfer in (6, 14, 15) else transfer  # the curve of BT.709 has four numbers
    name = str(_config().get_color_interop_id([primaries, curve, 0, 1]))
    if not name:
        raise ValueError(f"OpenColorIO has no colour space of its code points {primaries} and {transfer}")
    return name


def _png_chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield names and contents of the chunks before the pixels."""
    at = 8
    while at + 8 <= len(content):
        size, name = struct.unpack_from(">I4s", content, at)
        if name == b"IDAT":
            return
        yield name, content[at + 8 : at + 8 + size]
        at += 12 + size


def _orient(pixels: Pixels, orientation: int) -> Pixels:
    """Return a picture upright whose first row and column are where `orientation` says (EXIF 2.3, 4.6.4)."""
    if orientation >= 5:
        pixels = pixels.transpose(1, 0, 2)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return pixels


@contextmanager
def opened_picture(path: str, kinds: str, *options: Any) -> Iterator[OpenedPicture]:
    """Open a file with OpenImageIO.

    kinds    file formats that the message recommends
    options  an ImageSpec for the reader

    Raises BadInputError for other files, and for any error of OpenImageIO while it is open.
    """
    import OpenImageIO as oiio

    with parsing(Path(path), "a picture", f"Write an {kinds}."):
        file = oiio.ImageInput.open(path, *options)
        if file is None:
            reason = last_message(oiio)
            if b"FORMAT=32-bit_rle_xyze" in _header_of(path):  # OpenImageIO finds no format in such a file
                reason = "its pixels are in CIE XYZ"
            elif other := other_content(Path(path)):
                reason = f"it is {other}"
            raise BadInputError(f"{path}: it cannot be read as a picture ({reason}); write an {kinds}")
        try:
            yield OpenedPicture(file, path)
        finally:
            file.close()


def last_message(source: Any) -> str:
    """Return the first line of OpenImageIO's last message."""
    return _first_line(_messages(source))


def _messages(source: Any) -> list[str]:
    """Return the lines of OpenImageIO's messages since they were last asked for."""
    try:
        return str(source.geterror()).strip().splitlines()
    except UnicodeDecodeError:  # it quotes the file
        return []


def _first_line(lines: list[str]) -> str:
    return reason_of(ValueError(lines[0] if lines else "unknown format"))
