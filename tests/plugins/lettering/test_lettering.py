"""Words and drawings as subjects: sound solids of any letters, fill rules, strokes, faults in one line."""

from __future__ import annotations

import math
import string
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import MissingInputError, ShotError, UsageError
from flowsculpt.pipeline.mesh import TriangleMesh, validate
from flowsculpt.pipeline.mesh.read import read_mesh
from flowsculpt.pipeline.plugins.lettering.bevel import TooWideError, bevelled
from flowsculpt.pipeline.plugins.lettering.extrusion import Section, extruded, solids
from flowsculpt.pipeline.plugins.lettering.fonts import font_file
from flowsculpt.pipeline.plugins.lettering.kinds import TextKind
from flowsculpt.pipeline.plugins.lettering.outlines import filled, polygons_of, rings_of
from flowsculpt.pipeline.plugins.lettering.starts import starts
from flowsculpt.pipeline.plugins.lettering.svg_outlines import drawn_shapes
from flowsculpt.pipeline.plugins.lettering.text_outlines import TextSettings, letters
from flowsculpt.pipeline.shot import Shot, read_shot
from tests.conftest import ProjectFolder
from tests.needed_plugins import needs_plugins

FONT = Path(font_file(""))
BESIDE_ANOTHER_HARFBUZZ = """
import ctypes, importlib.metadata, sys
from pathlib import Path
from flowsculpt.render.graphics.typesetting import lettering

lettering("A", "DroidSans", 16)  # loads the system's HarfBuzz, if it has one
for file in importlib.metadata.files("pillow"):
    if file.name.startswith("libharfbuzz"):
        ctypes.CDLL(str(file.locate()), ctypes.RTLD_GLOBAL)

from flowsculpt.pipeline.plugins.lettering import text_outlines
contained = ctypes.CDLL(sys.modules["uharfbuzz._harfbuzz"].__file__).hb_version_string
contained.restype = ctypes.c_char_p
assert text_outlines.hb.version_string() == contained().decode()
for letter in text_outlines.letters("Aé", text_outlines.TextSettings(Path(sys.argv[1]))):
    print(letter.region.wkb_hex)
"""
SHOT = """\
title: Word
frames: 1-3
{subject}
resample: {{max_edge_length: 0.1}}
"""


def volume(mesh: TriangleMesh) -> float:
    return float(np.linalg.det(mesh.vertices[mesh.faces]).sum() / 6.0)


def area(shapes: tuple) -> float:
    return float(sum(shape.region.area for shape in shapes))


def shot_of(tmp_path: Path, subject: str) -> Shot:
    path = tmp_path / "A010_word.yaml"
    path.write_text(SHOT.format(subject=subject), encoding="utf-8")
    return read_shot(path)


def fault_of(tmp_path: Path, subject: str) -> str:
    with pytest.raises((ShotError, MissingInputError)) as raised:
        shot_of(tmp_path, subject)
    message = str(raised.value)
    assert "\n" not in message
    return message.partition("A010_word.yaml:")[2]


def drawing(tmp_path: Path, body: str, attributes: str = 'viewBox="0 0 100 100"') -> tuple:
    path = tmp_path / "logo.svg"
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {attributes}>{body}</svg>', encoding="utf-8")
    return drawn_shapes(path, 100.0, 0.01)


@settings(max_examples=25, deadline=None)
@given(
    text=st.text(
        string.ascii_letters + string.digits + string.punctuation + "äßçÅøŒ ", min_size=1, max_size=3
    ),
    bevel=st.sampled_from([0.0, 0.01, 0.02]),
    shape=st.sampled_from(["round", "flat"]),
)
def test_any_letters_make_closed_solids_with_a_hole_for_each_counter(text, bevel, shape):
    try:
        shapes = letters(text, TextSettings(FONT))
    except UsageError:
        assert not text.strip()
        return
    mesh = solids(shapes, Section(0.25, bevel, shape))
    parts = polygons_of(shapely.unary_union([shape.region for shape in shapes]))
    found, holes = validate(mesh), sum(len(part.interiors) for part in parts)
    assert found.sound and found.closed
    assert found.euler == 2 * (len(parts) - holes)
    largest = 0.25 * sum(part.area for part in parts)
    assert 0.7 * largest < volume(mesh) <= largest * (1.0 + 1e-9)
    if not bevel:
        assert volume(mesh) == pytest.approx(largest, rel=1e-5)


def test_a_flat_bevel_takes_the_volume_of_a_frustum_off():
    square = shapely.box(-1.0, -1.0, 1.0, 1.0)
    mesh = extruded(square, Section(1.0, 0.1, "flat"))
    frustum = 0.1 / 3.0 * (4.0 + 1.8**2 + math.sqrt(4.0 * 1.8**2))
    assert volume(mesh) == pytest.approx(0.8 * 4.0 + 2.0 * frustum)
    assert mesh.bounds.tolist() == [[-1.0, -1.0, -0.5], [1.0, 1.0, 0.5]]


def test_edges_between_face_bevel_and_wall_are_creases():
    mesh = extruded(shapely.Point(0.0, 0.0).buffer(1.0), Section(1.0, 0.1, "round", 8))
    radius = np.linalg.norm(mesh.vertices[mesh.creases][:, :, :2], axis=2).round(3)
    assert set(np.unique(radius)) == {0.9, 1.0}


def test_a_rounded_tip_that_is_narrower_than_the_bevel_becomes_a_ridge():
    tip = shapely.Point(0.0, 0.0).buffer(0.05, quad_segs=12)
    hull = tip.union(shapely.Polygon([(0, 0), (4, -2), (4, 2)])).convex_hull
    bevel = bevelled(rings_of(hull)[0], [0.2])
    assert len(bevel.rim) < 10 < bevel.count
    assert validate(extruded(hull, Section(1.0, 0.2, "flat"))).euler == 2


def test_a_bevel_wider_than_half_a_stroke_is_refused():
    bar = shapely.box(0.0, 0.0, 4.0, 1.0)
    extruded(bar, Section(2.0, 0.49))
    with pytest.raises(TooWideError):
        extruded(bar, Section(2.0, 0.51))


def test_overlapping_contours_of_a_glyph_are_one_outline():
    cross = [
        np.array([[0, 1], [3, 1], [3, 2], [0, 2]], float),
        np.array([[1, 0], [2, 0], [2, 3], [1, 3]], float),
    ]
    assert filled(cross, "nonzero").area == pytest.approx(5.0)
    assert filled(cross, "evenodd").area == pytest.approx(4.0)


def test_kerning_brings_letters_nearer_and_tracking_apart():
    def width(**changes):
        bounds = shapely.total_bounds([each.region for each in letters("AV", TextSettings(FONT, **changes))])
        return bounds[2] - bounds[0]

    assert width() < width(kerning=False)
    assert width(tracking=0.1) == pytest.approx(width() + 0.1)


def test_a_letter_stays_where_it_is_in_the_text(tmp_path):
    word = shot_of(tmp_path, "subject: {lettering.text: FLOW}").motion.subject.build()
    letter = shot_of(tmp_path, "subject: {lettering.text: {text: FLOW, letter: 4}}").motion.subject.build()
    assert letter.bounds[1, 0] == pytest.approx(word.bounds[1, 0])
    assert letter.bounds[0, 0] > 0.0 > word.bounds[0, 0]


def test_lines_are_centred_and_lie_below_each_other():
    first, *_, last = letters("MM\nH", TextSettings(FONT))
    assert last.region.centroid.x == pytest.approx(0.0, abs=0.02)
    assert first.region.centroid.y - last.region.centroid.y == pytest.approx(1.2, abs=0.03)


SQUARE, INNER = "M0 0H100V100H0Z", "M25 25H75V75H25Z"


@pytest.mark.parametrize(
    ("body", "size"),
    [
        (f'<path fill-rule="evenodd" d="{SQUARE}{INNER}"/>', 7500.0),
        (f'<path d="{SQUARE}{INNER}"/>', 10000.0),
        (f'<path d="{SQUARE}M25 25V75H75V25Z"/>', 7500.0),
        (f'<path style="fill-rule:evenodd" d="{SQUARE}{INNER}"/>', 7500.0),
        (f'<style>.eo {{fill-rule: evenodd}}</style><path class="eo" d="{SQUARE}{INNER}"/>', 7500.0),
        ('<path d="M0 50A50 50 0 0 1 100 50Z"/>', 1250.0 * math.pi),
        ('<circle cx="50" cy="50" r="50"/>', 2500.0 * math.pi),
        ('<rect width="100" height="50" rx="10"/>', 5000.0 - (4.0 - math.pi) * 100.0),
        ('<rect width="50" height="100" transform="translate(50 50) rotate(90) scale(1 .25)"/>', 5000.0),
        ('<circle cx="50" cy="50" r="45" fill="none" stroke="red" stroke-width="10"/>', 900.0 * math.pi),
        ('<path d="M10 10H90" stroke="red" stroke-width="20" stroke-linecap="square"/>', 2000.0),
        ('<rect x="-50" width="100" height="100"/>', 5000.0),
        ('<defs><rect id="r" width="50" height="99"/></defs><use href="#r"/><use href="#r" x="50"/>', 9900.0),
        ('<g display="none"><text>A</text></g><rect width="100" height="10"/>', 1000.0),
    ],
)  # fmt: skip
def test_a_drawing_covers_what_a_browser_shows(tmp_path, body, size):
    assert area(drawing(tmp_path, body)) == pytest.approx(size, rel=2e-3)


def test_the_y_axis_of_drawings_points_down(tmp_path):
    (shape,) = drawing(tmp_path, '<polygon points="0,0 100,0 50,100"/>')
    assert shape.region.contains(shapely.Point(-40.0, 45.0))


def test_a_mitre_beyond_its_limit_is_a_bevel(tmp_path):
    pen = 'fill="none" stroke="red" stroke-width="4" stroke-miterlimit="{}"'
    drawn = [drawing(tmp_path, f'<path d="M10 50L60 50L10 40" {pen.format(limit)}/>') for limit in (4, 20)]
    bevelled_corner, mitred = (shapes[0].region.bounds for shapes in drawn)
    assert bevelled_corner[3] - bevelled_corner[1] > mitred[3] - mitred[1]  # both are scaled to one width


@pytest.mark.parametrize(
    ("body", "fact"),
    [
        ("<text>A</text>", "text 1 is text. Convert it to paths"),
        ('<image href="a.png"/>', "image 1 is a picture"),
        ('<g id="logo" clip-path="url(#c)"><rect width="1" height="1"/></g>', "g 'logo' has a clip-path"),
        ('<path d="M0 0L"/>', "its path data 'M0 0L' is not valid"),
        ('<path d="M0 0H9" stroke="red" stroke-dasharray="2"/>', "a stroke with dashes"),
        ('<rect width="50%" height="1"/>', "a length of '50%'"),
        ('<rect width="5" height="5" transform="spin(3)"/>', "a transform 'spin(3)' that is not valid"),
        ('<use href="#no"/>', "uses '#no', which is not in the file"),
        ('<g id="a"><use href="#a"/></g>', "is one of too many"),
        ("<style>g > rect {fill: red}</style>", "its style sheet has 'g > rect'"),
        ('<rect width="5" height="5" fill="none"/>', "shows nothing"),
    ],
)  # fmt: skip
def test_what_a_drawing_cannot_be_read_as_is_one_line(tmp_path, body, fact):
    with pytest.raises(UsageError, match=r"^logo\.svg") as raised:
        drawing(tmp_path, body)
    assert fact in str(raised.value) and "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("subject", "message"),
    [
        ("{lettering.text: 2026}", "subject.lettering.text: 2026 is a number, and text is in quotes"),
        ("{lettering.text: あ}", "font DejaVuSans-Bold.ttf has no letter for 'あ'. Choose another font"),
        ("{lettering.text: {text: FLaW, bevel: 0.05}}", "strokes of 'a' take. Write bevel: 0.03."),
        ("{lettering.text: {text: A, bevel: 0.2}}", "leave nothing of a depth of 0.25."),
        ("{lettering.text: {text: A, letter: 3}}", "letter 3 is beyond the last: it has 1 letter."),
        ("{lettering.text: {text: A, axes: {wght: 400}}}", "has no axis 'wght'; it has none"),
        ("{lettering.text: {text: A, face: 7}}", "has no such face. Choose another, or face: 0."),
        ("{lettering.text: {text: ''}}", "lettering.text.text: empty; it must have at least 1 character"),
        ("{lettering.text: {text: A, font: No Such}}", "font 'No Such' is not installed."),
        ("{lettering.text: {text: A, font: no.ttf}}", "file no.ttf is not there"),
        ("{lettering.text: {text: A, bevle: 1}}", "subject.lettering.text.bevle: unknown name. Did you mean"),
        ("{lettering.txt: A}", "subject.lettering.txt: unknown name. Did you mean 'lettering.text'?"),
        ("{ripples.pond: {}}", "unknown name. It needs plug-in ripples, which is not installed"),
        ("{lettering.text: A, lettering.text: B}", "lettering.text"),
        ("{lettering.text: A, fit: 2, scale: 3}", "fit and scale both set the size"),
        ("{lettering.text: A, depth: 2}", "subject.depth: unknown name"),
    ],
)  # fmt: skip
def test_a_fault_is_one_line_at_its_place(tmp_path, subject, message):
    fault = fault_of(tmp_path, f"subject: {subject}")
    assert fault.startswith("3:") and message in fault


def test_a_font_that_is_not_one_is_refused(tmp_path):
    (tmp_path / "fake.ttf").write_bytes(b"no font")
    fault = fault_of(tmp_path, "subject: {lettering.text: {text: A, font: fake.ttf}}")
    assert "font fake.ttf is not a TrueType" in fault


def test_files_and_settings_decide_the_key_and_where_the_file_is_noted(tmp_path):
    def key(subject):
        shot = shot_of(tmp_path, subject)
        return shot.motion.start_data()["subject"]["digest"], dict(shot.files)

    (tmp_path / "own.ttf").write_bytes(FONT.read_bytes())
    own, files = key("subject: {lettering.text: {text: A, font: own.ttf}}")
    assert tmp_path / "own.ttf" in files
    assert key("subject: {lettering.text: {text: A, font: own.ttf, bevel: 0.02}}")[0] == own  # the default
    assert key("subject: {lettering.text: {text: A, font: own.ttf, bevel: 0.01}}")[0] != own
    (tmp_path / "own.ttf").write_bytes((FONT.parent / "DejaVuSans.ttf").read_bytes())
    assert key("subject: {lettering.text: {text: A, font: own.ttf}}")[0] != own


def test_letters_are_subjects_with_places_and_flows_of_their_own(tmp_path):
    letter = "{lettering.text: {text: %s}, fit: 1, place: [%d, 0, 0]}"
    shot = shot_of(tmp_path, f"subjects:\n  a: {letter % ('A', -1)}\n  b: {letter % ('B', 1)}")
    middles = [part.motion.mesh_at_rest().bounds.mean(axis=0)[0] for part in shot.subjects]
    assert middles == pytest.approx([-1.0, 1.0])
    assert all(part.motion.resampling.creases == "model" for part in shot.subjects)


@pytest.mark.parametrize("letter", ["F", "O", "B", "%", "i"])
def test_a_letter_begins_as_drops_and_rings_with_its_parts_holes_and_volume(letter):
    shapes = letters(letter, TextSettings(FONT))
    start, solid = starts(shapes, 0.25), solids(shapes, Section(0.25))
    assert validate(start).euler == validate(solid).euler and validate(start).closed
    assert volume(start) == pytest.approx(volume(solid), rel=0.1)
    assert start.bounds.mean(axis=0) == pytest.approx(solid.bounds.mean(axis=0), abs=0.1)


@pytest.mark.parametrize("text", ["FLOW", 'a "b"'])
def test_letters_writes_a_shot_with_a_subject_a_letter(tmp_path, text):
    folder = ProjectFolder(tmp_path)
    assert folder.call("letters", "A060_word", text).code == 0
    parts = read_shot(tmp_path / "shots" / "A060_word.yaml").subjects
    assert len(parts) == len(text.replace(" ", ""))
    whole = shapely.total_bounds([each.region for each in letters(text, TextSettings(FONT))])
    meshes = [part.motion.subject.build() for part in parts]
    assert min(mesh.bounds[0, 0] for mesh in meshes) == pytest.approx(whole[0])
    assert max(mesh.bounds[1, 0] for mesh in meshes) == pytest.approx(whole[2])
    assert folder.call("letters", "A060_word", text).code == 2


def variable_font(path: Path) -> None:
    """Write a font whose A is two overlapping bars, and whose axis wght makes the upright one wider."""
    from fontTools.fontBuilder import FontBuilder
    from fontTools.pens.ttGlyphPen import TTGlyphPen
    from fontTools.ttLib.tables.TupleVariation import TupleVariation

    pen = TTGlyphPen(None)
    for left, low, right, high in ((0, 200, 600, 400), (200, 0, 400, 600)):
        pen.moveTo((left, low))
        for corner in ((left, high), (right, high), (right, low)):
            pen.lineTo(corner)
        pen.closePath()
    font = FontBuilder(1000)
    font.setupGlyphOrder([".notdef", "A"])
    font.setupCharacterMap({ord("A"): "A"})
    font.setupGlyf({".notdef": TTGlyphPen(None).glyph(), "A": pen.glyph()})
    font.setupHorizontalMetrics({".notdef": (700, 0), "A": (700, 0)})
    font.setupHorizontalHeader(ascent=800, descent=-200)
    font.setupNameTable({"familyName": "Bars", "styleName": "Regular"})
    font.setupFvar([("wght", 400, 400, 900, "Weight")], [])
    wider = [(0, 0)] * 6 + [(100, 0)] * 2 + [(0, 0)] * 4
    font.setupGvar({"A": [TupleVariation({"wght": (0.0, 1.0, 1.0)}, wider)]})
    font.setupOS2()
    font.setupPost()
    font.save(path)


def test_axes_of_a_variable_font_move_its_outlines_and_overlapping_contours_are_one(tmp_path):
    variable_font(tmp_path / "bars.ttf")

    def drawn(**axes):
        settings = TextSettings(tmp_path / "bars.ttf", axes=tuple(axes.items()))
        return letters("A", settings)[0].region

    assert drawn().area == pytest.approx(0.6 * 0.2 + 2 * 0.2 * 0.2)
    assert len(polygons_of(drawn())) == 1 and not polygons_of(drawn())[0].interiors
    assert drawn(wght=900.0).area == pytest.approx(0.6 * 0.2 + 2 * 0.3 * 0.2)
    with pytest.raises(UsageError, match=r"axis wght of font bars\.ttf is from 400 to 900\. Write 900\."):
        drawn(wght=1000.0)


@needs_plugins("become", "interchange")
def test_letters_from_drops_become_models_of_themselves(tmp_path):
    folder = ProjectFolder(tmp_path)
    assert folder.call("letters", "A061_word", "AB", "--from-drops").code == 0
    shot = read_shot(tmp_path / "shots" / "A061_word.yaml")
    for part, number in zip(shot.subjects, (1, 2), strict=True):
        model = tmp_path / "shots" / "models" / f"A061_word_{part.subject}.ply"
        letter = TextKind.model_construct(text="AB", letter=number).surface(tmp_path)
        assert read_mesh(model).bounds == pytest.approx(letter.bounds, abs=1e-6)
        assert validate(part.motion.subject.build()).euler == validate(read_mesh(model)).euler
    refused = folder.call("letters", "A062_word", "Hi", "--from-drops")
    assert refused.code == 2 and "'i' has several" in refused.err
    assert not (tmp_path / "shots" / "A062_word.yaml").exists()


def test_letters_are_the_same_in_a_process_that_has_loaded_another_harfbuzz():
    command = [sys.executable, "-c", BESIDE_ANOTHER_HARFBUZZ, str(FONT)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr  # it crashed
    assert done.stdout.split() == [shape.region.wkb_hex for shape in letters("Aé", TextSettings(FONT))]
