"""Check pictures from outside before they are read: OpenImageIO decodes each once in a process of its own.

A decoder that crashes, hangs or fills the memory does so there. What is wrong with a picture otherwise, the
reader says itself. The answer is stored by the content of the file.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from render.base.input_files import require_input
from render.base.limited_process import MEMORY, ParserError, allow_memory, answer_about_content, serve
from render.base.render_errors import BadInputError
from render.scene.picture_file import OpenedPicture

MOST_BYTES = 4 << 30
"""Size of the largest file."""

MOST_PIXELS = 1 << 28
"""Pixels of the largest picture: 16384 × 16384."""

_ALWAYS = 1 << 20
"""So many pixels may be in a file of any size."""

_ALWAYS_SHOWN = 1 << 23
"""Pixels that the display window of any file may have: 4096 × 2048."""

_PIXELS_A_BYTE = {"piz": 10_000, "dwaa": 10_000, "dwab": 10_000}
"""Pixels in a byte of an even picture, at most, by the name of its compression."""

_MOST_DEFLATED = 1032
"""Bytes that one byte unpacks to at most (RFC 1951)."""


def require_decodable(path: str, digest: str) -> None:
    """Raise BadInputError for a picture that is too large, or whose decoder crashes, hangs or takes too
    much memory; MissingInputError where it is no regular file.

    digest  of the file's content
    """
    require_input(Path(path), MOST_BYTES)
    try:
        answer_about_content("render.scene.picture_check", Path(path), digest, "OpenImageIO")
    except ParserError as error:
        raise BadInputError(
            f"{path}: it cannot be read as a picture ({error}); write it again, as EXR, PNG, JPEG or TIFF"
        ) from None


def _decode(path: str) -> bytes:
    import OpenImageIO as oiio

    oiio.attribute("threads", 1)
    file = oiio.ImageInput.open(path)
    if file is not None:
        with suppress(BadInputError):
            picture = OpenedPicture(file, path)
            pixels = _require_size(picture, Path(path).stat().st_size)
            allow_memory(MEMORY + 16 * pixels * len(picture.channels))
            picture.pixels()
    return b""


def _require_size(picture: OpenedPicture, size: int) -> int:
    """Return the number of pixels. Raises ValueError where a file of `size` bytes cannot hold them."""
    spec, (_, _, width, height) = picture.spec, picture.display
    stored, shown = spec.width * spec.height * max(spec.depth, 1), width * height
    ratio = _PIXELS_A_BYTE.get(spec.get_string_attribute("compression"), _MOST_DEFLATED)
    for pixels, promise, always in (
        (stored, f"{spec.width} × {spec.height} pixels", _ALWAYS),
        (shown, f"a display window of {width} × {height} pixels", _ALWAYS_SHOWN),
    ):
        if pixels > MOST_PIXELS:
            raise ValueError(f"its header promises {promise}; {MOST_PIXELS >> 20} million are the most")
        if pixels > max(always, ratio * size):
            raise ValueError(f"its header promises {promise}, and it has {size} bytes")
    return int(max(stored, shown))


if __name__ == "__main__":
    serve(_decode)
