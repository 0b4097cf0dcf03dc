"""Outlines of text: shaped by HarfBuzz, with kerning, ligatures and the axes of variable fonts."""

from __future__ import annotations

import io
import os
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from fontTools.ttLib.sfnt import SFNTReader

from flowsculpt import UsageError
from flowsculpt.api import quote, shorten
from flowsculpt.api.files import InputFile
from flowsculpt.pipeline.plugins.lettering.outlines import OutlineShape, PolylinePen, filled
from flowsculpt.pipeline.plugins.lettering.text_direction import visual_runs


@contextmanager
def _own_symbols_first() -> Iterator[None]:
    """Let extension modules imported within call the functions they contain, whatever the process has loaded.

    On Linux, FreeType in OpenImageIO loads the system's HarfBuzz for all later modules (RTLD_GLOBAL) when the
    first text is set. uharfbuzz, imported after it, called functions of the system's version and of its own;
    their structures have different sizes, so it crashed.
    """
    if not hasattr(os, "RTLD_DEEPBIND"):  # macOS and Windows bind names to libraries
        yield
        return
    flags = sys.getdlopenflags()
    sys.setdlopenflags(flags | os.RTLD_DEEPBIND)
    try:
        yield
    finally:
        sys.setdlopenflags(flags)


with _own_symbols_first():
    import uharfbuzz as hb

MOST_BYTES = 1 << 28  # of a font
MOST_CHARACTERS = 1000  # of a text
SFNT = (b"\0\1\0\0", b"OTTO", b"true", b"ttcf")
OUTLINES = {"glyf", "CFF ", "CFF2"}
FOREIGN = (
    (b"wOF", "is compressed for the web. Convert it to TTF or OTF"),
    (b"%!", "is a PostScript font. Convert it to OTF"),
    (b"\x80\1", "is a PostScript font. Convert it to OTF"),
    (b"STARTFONT", "has no outlines, only pictures of letters. Choose another font"),
    (b"\1fcp", "has no outlines, only pictures of letters. Choose another font"),
    (b"<", "is a web page or a drawing. Fetch it again"),
    (b"PK\3\4", "is a ZIP archive. Unpack it"),
    (b"\x1f\x8b", "is compressed by gzip. Unpack it"),
)
"""How files of other kinds begin, and what they are."""

_CAPITALS = 0.72
"""Height of capitals over the size in fonts that do not say it."""


@dataclass(frozen=True)
class TextSettings:
    """Settings of typesetting.

    font       path of the file
    face       number of the face in a collection
    axes       values of a variable font's axes by their tags: `wght`
    size       of the em, units
    tracking   added between letters, over the size
    kerning    False ignores the distances that the font has for pairs of letters
    leading    from line to line, over the size
    tolerance  greatest distance of the outlines from the curves of the font, units
    """

    font: Path
    face: int = 0
    axes: tuple[tuple[str, float], ...] = ()
    size: float = 1.0
    tracking: float = 0.0
    kerning: bool = True
    align: Literal["left", "centre", "right"] = "centre"
    leading: float = 1.2
    tolerance: float = 0.001


def letters(text: str, settings: TextSettings) -> tuple[OutlineShape, ...]:
    """Return the letters of a text, in the order in which it is written; spaces are left out.

    The origin is in the middle between the capitals' top in the first line and the last baseline; along x it
    is where the lines are aligned.

    Raises UsageError for a file that is not a font, an axis that it lacks, a character that it cannot draw.
    """
    _require_characters(text)
    face = _face(settings.font, settings.face)
    font, scale = _font(face, settings), settings.size / face.upem
    lines = text.split("\n")
    capitals = font.get_metric_position(hb.OTMetricsTag.CAP_HEIGHT) or _CAPITALS * face.upem
    step = settings.leading * face.upem
    top = 0.5 * ((len(lines) - 1) * step - capitals)
    found: list[OutlineShape] = []
    for row, line in enumerate(lines):
        found += _Line(font, line, settings).letters(scale, top - row * step)
    if not found:
        raise UsageError("the text has no letters. Write some.")
    return tuple(found)


def _require_characters(text: str) -> None:
    if len(text) > MOST_CHARACTERS:
        fact = f"the text has {len(text)} characters; the most is {MOST_CHARACTERS}"
        raise UsageError(f"{fact}. Write a shorter one.")
    control = next((c for c in text if c != "\n" and unicodedata.category(c) in ("Cc", "Cs")), None)
    if control is not None:
        raise UsageError(f"the text has {control!r}, which is not a character to set. Leave it out.")


def _face(path: Path, number: int) -> Any:
    content = InputFile(path, MOST_BYTES).content()
    for start, fact in FOREIGN:
        if content.startswith(start):
            raise UsageError(f"font {path.name} {fact}.")
    if content[:4] in SFNT:
        _require_whole(path.name, content, number)
    face = hb.Face(hb.Blob(content), number)
    if not face.glyph_count or number >= face.count:
        have = "has no such face" if number else "is not a TrueType or OpenType font"
        raise UsageError(f"font {path.name} {have}. Choose another{', or face: 0' if number else ''}.")
    return face


def _require_whole(name: str, content: bytes, number: int) -> None:
    """Raise UsageError for a font whose tables end after the file does, and for one without outlines."""
    try:
        tables = SFNTReader(io.BytesIO(content), fontNumber=number).tables
        end = max(table.offset + table.length for table in tables.values())
    except Exception as error:  # the parser raises whatever it stumbles over
        if number:
            raise UsageError(f"font {name} has no such face. Choose another, or face: 0.") from error
        raise UsageError(f"font {name} is damaged: {shorten(error)}. Fetch it again.") from error
    if end > len(content):
        raise UsageError(
            f"font {name} is cut short: it is of {end} bytes and has {len(content)}. Fetch it again."
        )
    if not OUTLINES & tables.keys():
        raise UsageError(f"font {name} has no outlines, only pictures of letters. Choose another font.")


def _font(face: Any, settings: TextSettings) -> Any:
    font, axes = hb.Font(face), {axis.tag: axis for axis in face.axis_infos}
    for tag, value in settings.axes:
        if tag not in axes:
            have = f"it has {', '.join(axes)}" if axes else "it has none: it is not a variable font"
            raise UsageError(f"font {settings.font.name} has no axis {quote(tag)}; {have}. Leave it out.")
        low, high = axes[tag].min_value, axes[tag].max_value
        if not low <= value <= high:
            limits = f"{low:g} to {high:g}. Write {min(max(value, low), high):g}."
            raise UsageError(f"axis {tag} of font {settings.font.name} is from {limits}")
    font.set_variations(dict(settings.axes))
    return font


class _Line:
    """A line of text, shaped: glyphs and where they stand, in units of the font."""

    def __init__(self, font: Any, text: str, settings: TextSettings) -> None:
        self.font, self.text, self.settings = font, text, settings
        self.glyphs: list[Any] = []
        for run in visual_runs(text):
            buffer = hb.Buffer()
            buffer.add_str(text, run.start, run.end - run.start)
            buffer.guess_segment_properties()
            buffer.direction = "rtl" if run.is_leftwards else "ltr"
            hb.shape(font, buffer, {"kern": settings.kerning})
            self.glyphs += zip(buffer.glyph_infos, buffer.glyph_positions, strict=True)
        self.clusters = sorted({info.cluster for info, _ in self.glyphs})
        self.gap = settings.tracking * font.face.upem

    def letters(self, scale: float, baseline: float) -> list[OutlineShape]:
        """Return the letters; `scale` turns units of the font into those of the scene."""
        contours: dict[int, list[Any]] = {}
        x, previous = self._start(), None
        for info, position in self.glyphs:
            x += self.gap if previous not in (None, info.cluster) else 0.0
            previous = info.cluster
            at = (scale * (x + position.x_offset), scale * (baseline + position.y_offset))
            pen = PolylinePen((scale, 0.0, 0.0, scale, *at), self.settings.tolerance)
            self.font.draw_glyph_with_pen(info.codepoint, pen)
            x += position.x_advance
            self._require_drawn(info, bool(pen.contours))
            contours.setdefault(info.cluster, []).extend(pen.contours)
        return [
            OutlineShape(repr(self._characters(cluster)), filled(contours[cluster], "nonzero"))
            for cluster in self.clusters
            if contours[cluster]
        ]

    def _start(self) -> float:
        width = sum(position.x_advance for _, position in self.glyphs) + self.gap * (len(self.clusters) - 1)
        return -width * {"left": 0.0, "centre": 0.5, "right": 1.0}[self.settings.align]

    def _characters(self, cluster: int) -> str:
        following = next((c for c in self.clusters if c > cluster), len(self.text))
        return self.text[cluster:following]

    def _require_drawn(self, info: Any, has_outline: bool) -> None:
        """Raise UsageError for a glyph that the font lacks or has as a picture."""
        characters = self._characters(info.cluster)
        if info.codepoint == 0:
            fact = "has no letter"
        elif not has_outline and characters.strip() and characters.isprintable() and self._has_picture(info):
            fact = "has no outline, only a picture,"
        else:
            return
        raise UsageError(
            f"font {self.settings.font.name} {fact} for {characters!r}. Choose another font, or leave it out."
        )

    def _has_picture(self, info: Any) -> bool:
        face = self.font.face
        return bool(face.has_color_png or face.has_color_svg or face.has_color_paint or face.has_color_layers)
