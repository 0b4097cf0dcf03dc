"""Font files, by name or by family."""

from __future__ import annotations

from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from flowsculpt import UsageError
from flowsculpt.api import quote

DEFAULT_FONT = "fonts/ttf/DejaVuSans-Bold.ttf"
"""In the data of matplotlib: free, and with glyphs for most alphabets."""

SUFFIXES = (
    ".ttf",
    ".otf",
    ".ttc",
    ".otc",
    ".dfont",
    ".woff",
    ".woff2",
    ".eot",
    ".pfa",
    ".pfb",
    ".bdf",
    ".pcf",
)
"""Of files that may be meant; those that cannot be read are refused when they are."""


def font_file(font: str) -> str | Path:
    """Return the file of a font: the name of a file as it is, else that of an installed family.

    font  `Inter.ttf`, or a family with properties in the notation of fontconfig: `Inter:bold:italic`

    Raises UsageError where no such family is installed.
    """
    if Path(font).suffix.lower() in SUFFIXES:
        return font
    if not font:
        import matplotlib  # takes time to import

        return Path(matplotlib.get_data_path()) / DEFAULT_FONT
    return _installed(font)


def face_of_family(font: str) -> int:
    """Return the number of a family's face in its file, which may be a collection; 0 for a file."""
    return getattr(font_file(font), "face_index", 0)


@lru_cache(maxsize=32)
def _installed(family: str) -> str:
    """Return the file of a family, with the number of its face."""
    from matplotlib import font_manager

    known, manager = {entry.fname for entry in font_manager.fontManager.ttflist}, font_manager.fontManager
    for path in font_manager.findSystemFonts():  # the list is of when it was made
        if path not in known:
            with suppress(Exception):  # of files that are not fonts
                manager.addfont(path)
    try:
        return manager.findfont(font_manager.FontProperties(family), fallback_to_default=False)
    except ValueError:
        raise UsageError(
            f"font {quote(family)} is not installed. Write the name of a font file beside the shot, as "
            "Inter-Bold.ttf, or leave font out."
        ) from None
