"""Fonts: families that are installed now, faces of collections, and files that cannot be set as fonts."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from fontTools.ttLib import TTCollection, TTFont
from matplotlib import font_manager

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.lettering.fonts import face_of_family, font_file
from flowsculpt.pipeline.plugins.lettering.kinds import TextKind
from flowsculpt.pipeline.plugins.lettering.text_outlines import TextSettings, letters
from tests.conftest import ProjectFolder


def font_of(family: str, style: str, width: int) -> bytes:
    """Return a font whose A is a box."""
    pen = TTGlyphPen(None)
    pen.moveTo((0, 0))
    for corner in ((0, 700), (width, 700), (width, 0)):
        pen.lineTo(corner)
    pen.closePath()
    box = pen.glyph()
    font = FontBuilder(1000)
    font.setupGlyphOrder([".notdef", "A"])
    font.setupCharacterMap({ord("A"): "A"})
    font.setupGlyf({".notdef": box, "A": box})
    font.setupHorizontalMetrics({".notdef": (600, 0), "A": (600, 0)})
    font.setupHorizontalHeader(ascent=800, descent=-200)
    font.setupNameTable({"familyName": family, "styleName": style})
    font.setupOS2(usWeightClass=700 if style == "Bold" else 400)
    font.setupPost()
    file = io.BytesIO()
    font.save(file)
    return file.getvalue()


PLAIN = font_of("Plain", "Regular", 500)


def without_outlines() -> bytes:
    font, file = TTFont(io.BytesIO(PLAIN)), io.BytesIO()
    for table in ("glyf", "loca"):
        del font[table]
    font.save(file)
    return file.getvalue()


@pytest.mark.parametrize(
    ("make", "fact"),
    [
        (lambda: PLAIN[:-200], "is cut short: it is of "),
        (lambda: PLAIN[:40], "is damaged: "),
        (without_outlines, "has no outlines, only pictures of letters"),
        (lambda: b"wOF2" + bytes(60), "is compressed for the web. Convert it to TTF or OTF"),
        (lambda: b"%!PS-AdobeFont-1.0", "is a PostScript font"),
        (lambda: b"<!DOCTYPE html>", "is a web page"),
        (lambda: b"", "is not a TrueType or OpenType font"),
    ],
)
def test_files_that_are_no_font_to_set_are_refused_for_what_they_are(
    tmp_path: Path, make: Callable[[], bytes], fact: str
) -> None:
    (tmp_path / "a.woff2").write_bytes(make())
    assert font_file("a.woff2") == "a.woff2"
    with pytest.raises(UsageError, match=r"^font a\.woff2 ") as raised:
        letters("A", TextSettings(tmp_path / "a.woff2"))
    assert fact in str(raised.value) and "\n" not in str(raised.value)


def test_a_family_that_was_just_installed_is_found_with_its_face(tmp_path, monkeypatch):
    collection, path = TTCollection(), tmp_path / "two.ttc"
    both = (font_of("Just Installed", "Regular", 300), font_of("Just Installed", "Bold", 500))
    collection.fonts = [TTFont(io.BytesIO(content)) for content in both]
    with pytest.raises(UsageError, match="is not installed"):
        font_file("Just Installed:bold")
    collection.save(path)
    (tmp_path / "broken.ttf").write_bytes(b"no font")
    installed = [str(path), str(tmp_path / "broken.ttf")]
    monkeypatch.setattr(font_manager, "findSystemFonts", lambda: installed)
    assert Path(font_file("Just Installed:bold")) == path
    assert [face_of_family(f"Just Installed{style}") for style in ("", ":bold")] == [0, 1]
    widths = []
    for style in ("", ":bold"):
        kind = TextKind.model_construct(text="A", font=f"Just Installed{style}", bevel=0.0)
        low, high = kind.surface(tmp_path).bounds[:, 0]
        widths.append(high - low)
    assert widths == pytest.approx([0.3, 0.5])


@pytest.mark.parametrize(
    ("text", "fact"),
    [
        ("", "the text has no letters. Write some."),
        (" \n ", "the text has no letters. Write some."),
        ("a\x07", "the text has '\\x07', which is not a character to set"),
        ("A" * 1001, "the text has 1001 characters; the most is 1000"),
        ("あ", "has no letter for 'あ'"),
    ],
)
def test_texts_that_cannot_be_set_are_one_line(tmp_path, text, fact):
    done = ProjectFolder(tmp_path).call("letters", "A060_word", text)
    assert done.code == 2 and fact in done.err and done.err.count("\n") == 1
    assert not (tmp_path / "shots").exists()
