"""Drawings: the shape that a browser shows on a light screen, and limits of visits, time and memory."""

from __future__ import annotations

import gzip
import math
import os
import signal
import sys
from pathlib import Path

import psutil
import pytest
import shapely

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.lettering import outline_process
from flowsculpt.pipeline.plugins.lettering.kinds import SvgKind
from flowsculpt.pipeline.plugins.lettering.outlines import OutlineShape
from flowsculpt.pipeline.plugins.lettering.svg_outlines import SvgDrawing, drawn_shapes
from flowsculpt.render.base import limited_process

OPEN = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100"{}>'
WIDE, TALL = '<path class="l" d="M0 0H80V20H0Z"/>', '<path class="d" d="M0 0H20V80H0Z"/>'
ROWS = ".l{display:inline}.d{display:none}"
OTHERS = ".l{display:none}.d{display:inline}"


def drawing(tmp_path: Path, body: str | bytes, attributes: str = "") -> tuple[OutlineShape, ...]:
    path = tmp_path / "logo.svg"
    text = body if isinstance(body, bytes) else f"{OPEN.format(attributes)}{body}</svg>".encode()
    path.write_bytes(text)
    return drawn_shapes(path, 100.0, 0.01)


def fault(tmp_path: Path, body: str | bytes, attributes: str = "") -> str:
    with pytest.raises(UsageError) as raised:
        drawing(tmp_path, body, attributes)
    assert "\n" not in str(raised.value)
    return str(raised.value)


def extents(shapes: tuple[OutlineShape, ...]) -> tuple[float, float]:
    left, low, right, high = shapely.total_bounds([shape.region for shape in shapes])
    return right - left, high - low


@pytest.mark.parametrize(
    ("rule", "applies"),
    [
        ("@media (prefers-color-scheme: dark)", False),
        ("@media (prefers-color-scheme:light)", True),
        ("@media not (prefers-color-scheme: dark)", True),
        ("@media print", False),
        ("@media not print", True),
        ("@media not all and (monochrome)", True),
        ("@media only screen", True),
        ("@media print, screen", True),
        ("@media screen and (color) and (hover: hover)", True),
        ("@media print and (min-foo: 3)", False),
        ("@media (hover: none) or (not (forced-colors: active))", True),
        ("@MEDIA PRINT", False),
        ("@media (min-width: 150px)", True),
        ("@media (max-width: 150px)", False),
        ("@media (width < 12.5em) and (height >= 2cm)", False),
        ("@media all {@media print {.l{display:none}}} @media all", True),
        ("@media /* screen */ print", False),
        ("@layer a {.l{display:none}} @layer b", True),
    ],
)
def test_rules_of_a_light_screen_apply(tmp_path, rule, applies):
    size = ' width="200" height="200"'
    shapes = drawing(tmp_path, f"<style><![CDATA[{rule} {{{OTHERS}}}]]></style>{TALL}{WIDE}", size)
    shown = 1 if applies else 2
    assert len(shapes) == shown


@pytest.mark.parametrize(
    ("style", "wide"),
    [
        (f"{ROWS}@media print {{{OTHERS}}}", True),
        (f"{ROWS}</style><style media='print'>{OTHERS}", True),
        (f"{ROWS}</style><style media='screen'>{OTHERS}", False),
        (f"{ROWS}</style><style type='text/less'>{OTHERS}", True),
        (f".l{{display:inline}}.d{{display:none !important}}{OTHERS}", None),
        (f"@font-face {{src: url('a;}}b')}} @keyframes k {{from {{fill: none}}}} {ROWS}", True),
        (f"path:hover {{cursor: pointer}} {ROWS} /* {OTHERS}", True),
        (f"{ROWS} .d {{DISPLAY: INLINE}} .l {{display: NONE}}", False),
        (f"@layer a {{{OTHERS}}} {ROWS}", True),
        (f"@layer b, a; @layer a {{{ROWS}}} @layer b {{{OTHERS}}}", True),
        (f".l{{display:inline!important}} {OTHERS} .d{{display:none}}", True),
    ],
)
def test_rules_count_by_importance_layer_and_place(tmp_path, style, wide):
    body = f"<style>{style}</style>{TALL}{WIDE}"
    if wide is None:
        assert "shows nothing" in fault(tmp_path, body)
        return
    width, height = extents(drawing(tmp_path, body))
    assert bool(width > height) is wide


@pytest.mark.parametrize(
    ("style", "fact"),
    [
        ("@media (min-width: 50px) {.l{fill:none}}", "does not say its width and height"),
        ("@media (foo: 3) {.l{fill:none}}", "'@media (foo: 3)'; this is not known of a light screen"),
        ("@media screen or {.l{fill:none}}", "this is not a media query"),
        ("@supports (fill: red) {.l{fill:none}}", "has '@supports (fill: red)'"),
        ("@import 'other.css';", "has \"@import 'other.css'\""),
        (".l {fill: red; .d {fill: none}}", "rules within a rule are not read"),
        (".l {r: 5px}", "path 1 has d in its style"),
        (".l {marker: url(#m)}", "has a marker."),
    ],
)
def test_rules_that_cannot_be_known_are_refused(tmp_path, style, fact):
    style = style.replace("r: 5px", "d: none")
    assert fact in fault(tmp_path, f"<style>{style}</style>{WIDE}")


SQUARE = '<rect x="20" y="20" width="10" height="10" {}/>'


@pytest.mark.parametrize(
    ("attributes", "middle"),
    [
        ('transform="rotate(180)" transform-origin="50 50"', (75, 75)),
        ('style="transform: rotate(.5turn); transform-origin: center"', (75, 75)),
        ('style="transform: rotate(180deg); transform-origin: 100% 50%"', (175, 75)),
        ('style="transform: rotate(180deg); transform-origin: bottom right"', (175, 175)),
        ('style="transform: rotate(180deg); transform-origin: 50px"', (75, 75)),
        ('style="transform-box: fill-box; transform-origin: center; transform: scale(3)"', (25, 25)),
        ('style="transform-box: fill-box; transform: translate(100%, 50%)"', (35, 30)),
        ('style="translate: 10px 20px; rotate: 90deg; transform-origin: 25px 25px"', (35, 45)),
        ('style="transform: translateX(10px) scaleY(1)"', (35, 25)),
        ('transform="none"', (25, 25)),
    ],
)
def test_transforms_are_about_their_origin(tmp_path, attributes, middle):
    path = tmp_path / "a.svg"
    path.write_text(f"{OPEN.format('')}{SQUARE.format(attributes)}</svg>", encoding="utf-8")
    first = SvgDrawing(path).paths[0].region(0.01)
    assert (first.centroid.x, first.centroid.y) == pytest.approx(middle)


@pytest.mark.parametrize("dashes", ["0", "0 0", "0,0px", "none", "-4 2", ""])
def test_dashes_that_are_all_0_are_none(tmp_path, dashes):
    line = f'<path d="M0 50H100" stroke="red" stroke-width="10" stroke-dasharray="{dashes}"/>'
    assert extents(drawing(tmp_path, line)) == pytest.approx((100.0, 10.0))


@pytest.mark.parametrize(
    ("body", "width"),
    [
        ('<g fill="none"><path fill="inherit" d="M0 0H90V9Z"/></g><path d="M0 0H20V10Z"/>', 20),
        ('<path fill="rgba(0, 0, 0, 0)" d="M0 0H90V9Z"/><path fill="rgb(0,0,0)" d="M0 0H20V10Z"/>', 20),
        ('<path fill="#0000" d="M0 0H90V9Z"/><path fill="#000" d="M0 0H20V10Z"/>', 20),
        ('<path opacity="0.0" d="M0 0H90V9Z"/><path d="M0 0H20V10Z"/>', 20),
        ('<path fill="url(#no) none" d="M0 0H90V9Z"/><path d="M0 0H20V10Z"/>', 20),
        ('<switch><path systemLanguage="de" d="M0 0H90V9Z"/><path systemLanguage="fr, en-GB" '
         'd="M0 0H20V10Z"/><path d="M0 0H80V9Z"/></switch>', 20),
        ('<path systemLanguage="de" d="M0 0H90V9Z"/><path d="M0 0H20V10Z"/>', 20),
        ('<path id="a" d="M0 0H20V10Z"/><path id="a" display="none" d="M0 0H90V9Z"/><use href="#a"/>', 20),
        ('<path d="M0 0H0020V0010Z"/>', 20),
        ('<path d="M0 0H2.e1V1.e1Z"/>', 20),
    ],
)  # fmt: skip
def test_what_is_not_seen_is_left_out(tmp_path, body, width):
    across, down = extents(drawing(tmp_path, body))
    assert across / down == pytest.approx(width / 10)


def test_the_whole_drawing_turns_about_its_middle(tmp_path):
    turned = drawing(tmp_path, '<path d="M0 0H90V10H0Z"/>', ' transform="rotate(90)"')
    assert extents(turned)[0] == pytest.approx(100.0 / 9.0, rel=1e-3)


@pytest.mark.parametrize("encoding", ["utf-16", "iso-8859-1", "windows-1252", "shift_jis"])
def test_compressed_and_encoded_drawings_are_read(tmp_path, encoding):
    text = f'<?xml version="1.0" encoding="{encoding}"?>{OPEN.format("")}{WIDE}</svg>'.encode(encoding)
    assert extents(drawing(tmp_path, gzip.compress(text))) == pytest.approx((100.0, 25.0))


@pytest.mark.parametrize(
    ("content", "fact"),
    [
        (lambda: gzip.compress(bytes(1 << 27)), "compressed by gzip, it has over 64 MiB"),
        (lambda: gzip.compress(OPEN.encode())[:30], "ended before the end-of-stream marker"),
        (lambda: b'<?xml-stylesheet href="a.css"?><svg/>', "its style sheet is another file"),
    ],
)
def test_files_that_are_no_drawing_are_refused_for_what_they_are(tmp_path, content, fact):
    assert fact in fault(tmp_path, content())


DOUBLED = "".join(f'<g id="g{n + 1}"><use href="#g{n}"/><use href="#g{n}"/></g>' for n in range(30))
WAVES = "L".join(f"{50 + 50 * math.sin(7.1 * n):.3f} {50 + 50 * math.sin(5.3 * n):.3f}" for n in range(4000))
ENDLESS = {
    "uses": f'<g id="g0"><path display="none" d="M0 0h1v1z"/></g>{DOUBLED}',
    "crossings": f'<path d="M{WAVES}Z"/>',
    "sheets": "".join(f"<style>.c{n}{{fill:red}}</style><g class='c{n}'/>" for n in range(20_000)) + WIDE,
    "comments": f"<style>{'/*' * 100_000}</style>{WIDE}",
    "digits": f'<rect width="{"1" * 200_000}x" height="5"/>',
    "words": f"<style>{'a' * 200_000}</style>{WIDE}",
    "media": f"<style>{'@media all{' * 50_000}</style>{WIDE}",
    "points": f'<path d="M0 0{"".join(f"L{n % 97} {n // 97}" for n in range(120_000))}"/>',
}


@pytest.mark.parametrize("name", ENDLESS)
def test_drawings_that_would_take_for_ever_are_read_or_refused_within_seconds(tmp_path, monkeypatch, name):
    monkeypatch.setattr(outline_process, "READING", 0.1)  # rounded up to whole seconds
    (tmp_path / "a.svg").write_text(f"{OPEN.format('')}{ENDLESS[name]}</svg>", encoding="utf-8")
    start = os.times()
    try:
        assert len(SvgKind.model_construct(file="a.svg", bevel=0.0).surface(tmp_path).faces)
    except UsageError as error:
        assert str(error).startswith("a.svg") and "\n" not in str(error)
        assert len(str(error)) < 400
    taken = os.times()
    assert taken.children_user - start.children_user < 5.0


def test_ctrl_c_is_heard_while_a_drawing_is_read(tmp_path):
    (tmp_path / "a.svg").write_text(f"{OPEN.format('')}{ENDLESS['crossings']}</svg>", encoding="utf-8")
    before, reading = set(psutil.Process().children()), []

    def interrupt(*_):
        reading.extend(set(psutil.Process().children()) - before)
        signal.raise_signal(signal.SIGINT)

    handler = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.5)
    try:
        with pytest.raises(KeyboardInterrupt):
            SvgKind.model_construct(file="a.svg", bevel=0.0).surface(tmp_path)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, handler)
    assert reading and not any(process.is_running() for process in reading)


def test_a_size_at_the_edge_of_numbers_is_refused(tmp_path):
    (tmp_path / "a.svg").write_text(f"{OPEN.format('')}{WIDE}</svg>", encoding="utf-8")
    with pytest.raises(UsageError, match="the outlines have no area at this size"):
        SvgKind.model_construct(file="a.svg", size=1e-300, bevel=0.0).surface(tmp_path)


@pytest.mark.parametrize("tolerance", [1e-300, 1e300])
def test_strokes_of_any_tolerance_are_read(tmp_path, tolerance):
    line = '<path d="M1 1L80 80L20 60" fill="none" stroke="red" stroke-linejoin="round"/>'
    path = tmp_path / "a.svg"
    path.write_text(f"{OPEN.format('')}{line}</svg>", encoding="utf-8")
    assert drawn_shapes(path, 2.0, tolerance)


def test_a_process_that_cannot_be_forked_reads_the_same(tmp_path, monkeypatch):
    (tmp_path / "a.svg").write_text(f"{OPEN.format('')}{WIDE}</svg>", encoding="utf-8")
    kind = SvgKind.model_construct(file="a.svg")
    forked = kind.surface(tmp_path)
    monkeypatch.setattr(sys, "platform", "other")
    started = kind.surface(tmp_path)
    for name in ("vertices", "faces", "creases"):
        assert (getattr(forked, name) == getattr(started, name)).all()
    monkeypatch.setattr(limited_process, "SECONDS", 0.01)
    with pytest.raises(UsageError, match=r"^a\.svg cannot be read: its reader took over 0 seconds"):
        kind.surface(tmp_path)
