"""OBJ files as other systems and programs write them: read right, or refused with the reason."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.plugins.interchange.obj_files import read_wavefront
from flowsculpt.pipeline.plugins.points.point_files import read_net, read_points
from tests.mesh.brick import OBJ, QUADS, read, require_brick, rows

ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-32-be")
LINE_ENDS = ("\n", "\r\n", "\r", "\n\r")


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("line_end", LINE_ENDS)
def test_encodings_and_line_ends_of_other_systems_lose_nothing(
    tmp_path: Path, encoding: str, line_end: str
) -> None:
    content = OBJ.replace("\n", line_end).encode(encoding)
    assert require_brick(read(tmp_path / "a.obj", content)).sides.tolist() == [4] * 6


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda text: f"\n\n# by hand\n{text}", id="comments and blank lines"),
        pytest.param(lambda text: text.replace("v ", "v\t").replace("f ", "  f  "), id="tabs and indents"),
        pytest.param(lambda text: text.replace("v ", "v\N{NO-BREAK SPACE}"), id="no-break spaces"),
        pytest.param(lambda text: text.replace("\nv", "\f\nv"), id="form feeds"),
        pytest.param(lambda text: text.replace("v 2", "v \\\n2"), id="continued lines"),
        pytest.param(lambda text: text.replace("f ", "usemtl C:\\maps\\\nf ", 1), id="paths of Windows"),
        pytest.param(lambda text: text.replace("v 2 3 1", "v +2.0 3.e0 1E+0"), id="forms of numbers"),
        pytest.param(lambda text: text.replace(" 1\n", " 1 0.5 0.5 1\n"), id="colours of vertices"),
        pytest.param(lambda text: text.replace("v 2 3 1\n", "v 2 3 1 1.0\n"), id="a weight of 1"),
        pytest.param(lambda text: text.replace("f ", "fo "), id="old word for faces"),
        pytest.param(lambda text: text + "vp 0 0\nmg off\nlod 1\nusemap a\nmtllib no.mtl\n", id="others"),
        pytest.param(lambda text: text + "\x1a", id="end of a DOS file"),
        pytest.param(lambda text: text + "# " + "x" * 300_000, id="a long line"),
        pytest.param(lambda text: f"g \N{LATIN SMALL LETTER A WITH DIAERESIS}\n{text}", id="umlauts"),
    ],
)
def test_forms_that_other_programs_write_are_read(tmp_path: Path, change) -> None:  # type: ignore[no-untyped-def]
    require_brick(read(tmp_path / "a.obj", change(OBJ)))


@pytest.mark.parametrize("form", ["{}/1", "{}//1", "{}/1/1", "{}/", "mixed", "negative"])
def test_corners_of_every_form_are_read(tmp_path: Path, form: str) -> None:
    def corner(vertex: int, place: int) -> str:
        if form == "mixed":
            return ("{}", "{}/1", "{}//1", "{}")[place].format(vertex + 1)
        return str(vertex - 8) if form == "negative" else form.format(vertex + 1)

    faces = "".join(f"f {' '.join(corner(v, k) for k, v in enumerate(quad))}\n" for quad in QUADS)
    require_brick(read(tmp_path / "a.obj", OBJ.partition("f")[0] + "vt 0 0\nvn 0 0 1\n" + faces))


STATEMENTS = st.one_of(
    st.tuples(
        st.sampled_from(["v 1 2 3", "v\t1 2 3", "v 1 2 3 1 1 1", "v 1 2 3 1", "v 1 2 3 v"]),
        st.integers(1, 20),
    ),
    st.tuples(
        st.sampled_from(["f 1 2 3", "f 1/1 2/1 3/1", "f 1 2 3 4", "f -1 1 2", "f 1 2/1 3"]),
        st.integers(1, 20),
    ),
    st.tuples(
        st.sampled_from(["", "# f", "g a", "g b", "l 1 2", "v 1 2", "f 1 2 x", "v 1 2\nv 1 2 3 v 3", "f"]),
        st.just(1),
    ),
)


@given(st.lists(STATEMENTS, max_size=8))
def test_many_lines_at_once_are_read_as_each_alone(statements: list[tuple[str, int]]) -> None:
    def result(text: str) -> list[object]:
        try:
            return [
                part.tolist() if isinstance(part, np.ndarray) else part
                for part in read_wavefront(text.encode())
            ]
        except (ValueError, MeshError) as error:
            return [str(error)]

    text = "v 0 0 0\n" * 4 + "".join(f"{line}\n" * count for line, count in statements)
    assert result(text) == result(f"{text}# a backslash has every line read alone: \\")


def test_groups_whose_names_differ_in_letters_of_latin_1_only_are_two(tmp_path: Path) -> None:
    head, mark, tail = OBJ.partition("f 3 4 8 7")
    content = f"g é\n{head}g ö\n{mark}\ng é{tail}".encode("latin-1")
    assert len(require_brick(read(tmp_path / "a.obj", content)).creases) == 4


@pytest.mark.parametrize(
    ("more", "note"),
    [
        ("l 1 2\np 1\np 2\n", "1 line (l) and 2 sets of points (p) left out"),
        ("cstype bezier\ncurv 0 1 1 2 3 4\nend\n", "1 free-form curve (curv) left out"),
        (
            "surf 0 1 0 1 1 2 3 4\nend\nbsp 1 2\n",
            "1 free-form surface (surf) and 1 B-spline patch (bsp) left",
        ),
    ],
)
def test_what_else_a_file_shows_is_noted(tmp_path: Path, more: str, note: str) -> None:
    surface = read(tmp_path / "a.obj", OBJ + more)
    require_brick(surface)
    assert note in surface.warnings[0]
    with pytest.raises(MeshError, match="has no faces") as error:
        read(tmp_path / "a.obj", OBJ.partition("f")[0] + more)
    assert note in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("v 2 3 1", "v 4 6 2 2", "line 8: v 4 6 2 2: its fourth number is a weight"),
        ("v 2 3 1", "v 2 3 1 x", "line 8: v 2 3 1 x: x is not a number"),
        ("v 2 3 1", "v 2,0 3 1", "2,0 is not a number; decimals have a point, as in 2.0"),
        ("v 2 3 1", "v 2 3 1d0", "line 8: v 2 3 1d0: 1d0 is not a number"),
        (
            "v 2 3 1",
            "v 2 3 \0\0",
            "line 8: byte .* is NUL, so the file is not text, or was not written whole",
        ),
        ("v 2 3 1", "v 2 3", "line 8: v 2 3: vertex 8 has 2 coordinates, not 3"),
        ("v 2 3 1", "call other.obj", "line 8: call other.obj: files that this file calls are not read"),
        ("f 1 ", "f -9 ", "line 9: .*-9 counts back beyond the first of 8 vertices"),
        ("f 1 ", "f 1.5 ", "line 9: .*1.5 is not an integer"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_line(tmp_path: Path, old: str, new: str, fault: str) -> None:
    with pytest.raises(MeshError, match=fault):
        read(tmp_path / "a.obj", OBJ.replace(old, new))


def test_text_that_is_cut_within_a_letter_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"it begins as UTF-16 text, and byte .* is not: truncated data"):
        read(tmp_path / "a.obj", OBJ.encode("utf-16")[:-1])


def test_points_and_nets_of_an_obj_have_no_weights_either(tmp_path: Path) -> None:
    file = tmp_path / "net.obj"
    file.write_text(
        "\ufeff" + rows([(x, y, 0) for x in range(4) for y in range(4)], "v {}"), encoding="utf-8"
    )
    assert len(read_points(file).points) == 16
    assert read_net(file, 4).shape == (4, 4, 3)
    file.write_text(rows([(x, y, 0, 2) for x in range(4) for y in range(4)], "v {}"))
    with pytest.raises(MeshError, match="line 1: v 0 0 0 2: its fourth number is a weight"):
        read_net(file, 4)
