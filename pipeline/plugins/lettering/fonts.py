"""Font files, by name or by family."""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import UsageError, shortened

DEFAULT_FONT = "fonts/ttf/DejaVuSans-Bold.ttf"
"""In the data of matplotlib: free, and with glyphs for most alphabets."""

SUFFIXES = (".ttf", ".otf", ".ttc", ".otc")


def font_file(font: str) -> str | Path:
    """Return the file of a font: the name of a file as it is, else that of an installed family.

    font  `Inter.ttf`, or a family with properties in the notation of fontconfig: `Inter:bold:italic`

    Raises UsageError where no such family is installed.
    """
    if Path(font).suffix.lower() in SUFFIXES:
        return font
    import matplotlib  # takes time to import

    if not font:
        return Path(matplotlib.get_data_path()) / DEFAULT_FONT
    from matplotlib import font_manager

    try:
        return Path(font_manager.findfont(font_manager.FontProperties(font), fallback_to_default=False))
    except ValueError:
        raise UsageError(
            f"font {shortened(font)} is not installed. Write the name of a font file beside the shot, as "
            "Inter-Bold.ttf, or leave font out."
        ) from None
