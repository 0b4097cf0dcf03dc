"""PLY files as other programs write them: read right, or refused with the reason."""

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh import PolygonMesh, read_polygons
from flowsculpt.pipeline.plugins.interchange.ply_files import read_polygon_file
from tests.mesh.brick import POINTS, QUADS, TRIANGLES, read, require_brick, rows

UNEVEN = (
    "element vertex 5\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
    "element face 2\nproperty list uchar int vertex_index\nproperty short mark\nend_header\n"
)

ROWS = [(0, 0, 0, 9), (1, 0, 0, 9), (1, 1, 0, 9), (0, 1, 0, 9), (2, 0.5, 0, 9)]

VERTEX = "element vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 6\nproperty list uchar int vertex_indices\n"
STRIPS = [0, 1, 2, 3, 6, 7, 4, 5, 0, 1, -1, 1, 5, 3, 7, -1, 0, 2, 4, 6]
"""Three strips around the brick; its vertices 0 to 7 have the bits x, y and z."""


FACES = rows(QUADS, "4 {}")
BODY = rows(POINTS) + FACES


def text(elements: str = VERTEX + FACE, body: str = BODY) -> str:
    return f"ply\nformat ascii 1.0\n{elements}end_header\n{body}"


def faces(order: str = "<", length: str = "u1", kind: str = "i4", table=QUADS) -> bytes:  # type: ignore[no-untyped-def]
    return b"".join(
        np.array(len(row), order + length).tobytes() + np.array(row, order + kind).tobytes() for row in table
    )


def binary(elements: str = VERTEX + FACE, body: bytes = faces(), order: str = "<", kind: str = "f4") -> bytes:
    name = {"<": "little", ">": "big"}[order]
    head = f"ply\nformat binary_{name}_endian 1.0\n{elements}end_header\n".encode()
    return head + np.array(POINTS, order + kind).tobytes() + body


def with_line_ends(content: bytes, line_end: bytes, last: bytes | None = None) -> bytes:
    """Return a file whose header has other line ends; the last one may differ from the others."""
    head, _, body = content.partition(b"end_header\n")
    return head.replace(b"\n", line_end) + b"end_header" + (line_end if last is None else last) + body


LINE_ENDS = (b"\n", b"\r\n", b"\r", b"\n\r")


@pytest.mark.parametrize("line_end", LINE_ENDS)
@pytest.mark.parametrize("last", [*LINE_ENDS, b" \n", b"\t\r\n"])
def test_headers_of_every_line_end_are_read(tmp_path: Path, line_end: bytes, last: bytes) -> None:
    content = binary()
    require_brick(read(tmp_path / "a.ply", with_line_ends(content, line_end, last)))
    require_brick(read(tmp_path / "b.ply", with_line_ends(text().encode(), line_end, last)))


@pytest.mark.parametrize(
    ("line_end", "byte"), [(b"\r", 0x0A), (b"\n", 0x0D), (b"\r\n", 0x0A), (b"\n\r", 0x0D)]
)
def test_a_body_may_begin_with_a_byte_that_ends_lines(tmp_path: Path, line_end: bytes, byte: int) -> None:
    elements = "element mark 1\nproperty uchar a\n" + VERTEX + FACE
    head, mark, body = binary(elements).partition(b"end_header\n")
    content = with_line_ends(head + mark + bytes([byte]) + body, line_end)
    require_brick(read(tmp_path / "a.ply", content))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("length", ["char", "uchar", "short", "ushort", "int", "uint", "int8", "uint32"])
@pytest.mark.parametrize("kind", ["uchar", "short", "int", "uint", "int16", "float"])
def test_lists_of_every_type_are_read(tmp_path: Path, order: str, length: str, kind: str) -> None:
    short = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "i1", "u4", "i2")
    names = ("char", "uchar", "short", "ushort", "int", "uint", "float", "int8", "uint32", "int16")
    codes = dict(zip(names, short, strict=True))
    elements = (
        VERTEX.replace("float", "double") + f"element face 6\nproperty list {length} {kind} vertex_index\n"
    )
    content = binary(elements, faces(order, codes[length], codes[kind]), order, "f8")
    require_brick(read(tmp_path / "a.ply", content))


OTHERS = (
    "element edge 2\nproperty list uchar float weights\nproperty int vertex1\nelement no 0\nproperty int a\n"
)
NEAR = VERTEX.replace("vertex 8", "vertex 8\nproperty list uchar int near\nproperty int n")
ONE_LINE = " ".join(text().partition("end_header")[2].split())


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(text("comment end_header\ncomment\nend_header is it\n" + VERTEX + FACE), id="comments"),
        pytest.param(text("obj_info num_cols 4\n" + VERTEX + "comment a\nobj_info\n" + FACE), id="obj_info"),
        pytest.param("\n" + text(), id="a blank line before it"),
        pytest.param(text(OTHERS + VERTEX + FACE, "2 .5 .5 7\n0 3\n" + BODY), id="other elements before"),
        pytest.param(text(FACE + VERTEX, FACES + rows(POINTS)), id="faces before vertices"),
        pytest.param(
            text(NEAR + FACE, rows([(k % 2, *[5] * (k % 2), 9, *p) for k, p in enumerate(POINTS)]) + FACES),
            id="a list before coordinates",
        ),
        pytest.param(
            text(VERTEX + "property uchar red\n" + FACE, rows(POINTS, "{} 255.0") + FACES),
            id="a colour written as a decimal",
        ),
        pytest.param(
            text(VERTEX.replace("float x", "int z").replace("float z", "float x") + FACE,
                 rows([p[::-1] for p in POINTS]) + FACES),
            id="z before x",
        ),
        pytest.param(text(body=ONE_LINE), id="a body of one line"),
    ],
)  # fmt: skip
def test_forms_of_headers_and_text_are_read(tmp_path: Path, content: str) -> None:
    require_brick(read(tmp_path / "a.ply", content))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be"])
def test_text_of_other_encodings_is_read(tmp_path: Path, encoding: str) -> None:
    require_brick(read(tmp_path / "a.ply", text().encode(encoding)))


def test_a_binary_file_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    require_brick(read(tmp_path / "a.ply", b"\xef\xbb\xbf" + binary()))


@pytest.mark.parametrize("kind", ["i4", "u4", "i1"])
@pytest.mark.parametrize("lists", [1, 3])
def test_strips_are_triangles_wound_alike(tmp_path: Path, kind: str, lists: int) -> None:
    strips = [STRIPS] if lists == 1 else [STRIPS[:10], STRIPS[11:15], STRIPS[16:]]
    rows_of = [[v % 256 ** int(kind[1]) for v in strip] if kind[0] == "u" else strip for strip in strips]
    name = {"i4": "int", "u4": "uint", "i1": "char"}[kind]
    elements = VERTEX + f"element tristrips {lists}\nproperty list int {name} vertex_indices\n"
    mesh = require_brick(read(tmp_path / "a.ply", binary(elements, faces("<", "i4", kind, rows_of))))
    assert len(mesh) == 12


def test_strips_with_repeated_vertices_lead_elsewhere(tmp_path: Path) -> None:
    joined = [0, 1, 2, 3, 6, 7, 4, 5, 0, 1, 1, 1, 1, 5, 3, 7, 7, 0, 0, 2, 4, 6]
    elements = VERTEX + "element tristrips 1\nproperty list int int vertex_indices\n"
    require_brick(read(tmp_path / "a.ply", binary(elements, faces("<", "i4", "i4", [joined]))))


@pytest.mark.parametrize("sides", [QUADS[4:], QUADS[:3:-1]])
def test_strips_beside_faces_are_read_too(tmp_path: Path, sides: list[tuple[int, ...]]) -> None:
    elements = VERTEX + FACE.replace("6", "2") + "element tristrips 1\nproperty list int int vertex_indices\n"
    strip = "14 0 1 2 3 6 7 4 5 0 1 -1 -1 -1 -1\n"
    content = text(elements, rows(POINTS) + rows(sides, "4 {}") + strip)
    assert sorted(require_brick(read(tmp_path / "a.ply", content)).sides.tolist()) == [3] * 8 + [4] * 2


def test_a_face_of_two_hundred_corners_is_read(tmp_path: Path) -> None:
    around = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    points = np.column_stack([np.cos(around), np.sin(around), 0.0 * around]).astype("<f4")
    header = binary(VERTEX.replace("8", "200") + FACE.replace("6", "1"), b"").partition(b"end_header\n")
    content = b"".join(header[:2]) + points.tobytes() + faces(table=[list(range(200))])
    assert read(tmp_path / "a.ply", content).mesh.sides.tolist() == [200]


@pytest.mark.parametrize("form", ["even", "uneven"])
def test_faces_of_even_and_uneven_lengths_have_the_same_properties(tmp_path: Path, form: str) -> None:
    table = QUADS if form == "even" else [*QUADS[:5], *[t for t in TRIANGLES if set(t) <= set(QUADS[5])]]
    elements = (
        VERTEX + f"element face {len(table)}\nproperty list uchar int vertex_indices\nproperty short mark\n"
    )
    body = b"".join(faces(table=[row]) + b"\x01\x02" for row in table)
    require_brick(read(tmp_path / "a.ply", binary(elements, body)))
    words = rows(POINTS) + rows([(len(row), *row, 513) for row in table])
    require_brick(read(tmp_path / "b.ply", text(elements, words)))


GRID = "element range_grid 2\nproperty list uchar int vertex_indices\n"


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (text(VERTEX + GRID, rows(POINTS) + "1 0\n0\n"), "a scanner's grid of ranges"),
        (
            text(VERTEX + FACE.replace("vertex_indices", "corners")),
            "its header gives face no list of vertex_ind",
        ),
        (text(VERTEX + "element face 1\nproperty int vertex_index\n", rows(POINTS) + "3"), "face no list of"),
        (text(VERTEX.replace(" x", " a") + FACE), "its vertices have no x, y and z"),
        (
            text(VERTEX.replace("float x", "list uchar float x") + FACE),
            "promises less than it holds: 5 numbers",
        ),
        (
            text().replace("ascii", "binary"),
            "its format binary is not one of ascii, binary_little_endian, binary",
        ),
        (text().replace("element face 6", "element face six"), "its header has the line element face six"),
        (text().replace("element face 6", "element face 6 7"), "its header has the line element face 6 7"),
        (text().replace("float x", "float x y"), "its header has the line property float x y"),
        (text().replace("face 6", "face 5"), "promises less than it holds: 5 numbers after face 4"),
        (text().replace("vertex 8", "vertex 7"), "promises less than|names vertex|length of a list"),
        (text().replace("2 3 1\n", "2,0 3 1\n"), "vertex 7: 2,0 is not a number; decimals have a point"),
        (
            text().replace("4 0 1 3 2\n", "4 0 1 3 2.5\n"),
            "its face names vertices by numbers that are not int",
        ),
        (text().replace("end_header", "end_heading"), "it has no PLY header"),
        (binary().replace(b"face 6", b"face 5").decode("latin-1"), "promises less than it holds: 17 bytes"),
    ],
)
def test_what_cannot_be_read_is_refused_with_the_reason(tmp_path: Path, content: str, fault: str) -> None:
    with pytest.raises(MeshError, match=fault):
        read(tmp_path / "a.ply", content.encode("latin-1"))


def test_points_have_the_properties_of_vertices_but_no_lists(tmp_path: Path) -> None:
    from flowsculpt.pipeline.plugins.points.point_files import read_points

    elements = VERTEX + "property list uchar int near\nproperty uchar red\n"
    (tmp_path / "a.ply").write_text(
        "\ufeff" + text(elements, rows([(*p, 1, 5, 255) for p in POINTS])), "utf-8"
    )
    cloud = read_points(tmp_path / "a.ply")
    assert cloud.points.tolist() == [list(p) for p in POINTS]
    assert list(cloud.attributes) == ["red"] and cloud.attributes["red"].tolist() == [255] * 8


def polygons(mesh: PolygonMesh) -> list[list[int]]:
    return [mesh.face(k).tolist() for k in range(len(mesh))]


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_files_of_either_byte_order_and_uneven_faces_are_read(tmp_path: Path, order: str) -> None:
    name = "little" if order == "<" else "big"
    vertex = np.dtype([(axis, f"{order}f4") for axis in "xyz"] + [("red", "u1")])
    quad = _row(order, (0, 1, 2, 3))
    body = np.array(ROWS, vertex).tobytes() + quad + _row(order, (2, 1, 4))
    header = f"ply\nformat binary_{name}_endian 1.0\ncomment made by hand\n{UNEVEN}"
    (tmp_path / "two.ply").write_bytes(header.encode() + body)
    assert polygons(read_polygons(tmp_path / "two.ply")) == [[0, 1, 2, 3], [2, 1, 4]]


def _row(order: str, face: tuple[int, ...]) -> bytes:
    corners: AnyArray = np.array(face, f"{order}i4")
    return bytes([len(face)]) + corners.tobytes() + np.array(7, f"{order}i2").tobytes()


def test_a_text_ply_is_read(tmp_path: Path) -> None:
    rows = "\n".join(" ".join(str(n) for n in row) for row in ROWS)
    (tmp_path / "two.ply").write_text(f"ply\nformat ascii 1.0\n{UNEVEN}{rows}\n4 0 1 2 3 7\n3 2 1 4 7\n")
    assert polygons(read_polygons(tmp_path / "two.ply")) == [[0, 1, 2, 3], [2, 1, 4]]


@pytest.mark.parametrize(
    "names",
    [
        *(
            "vx vy vz",
            "velocity_x velocity_y velocity_z",
            "velocityx velocityy velocityz",
            "vel_x vel_y vel_z",
        ),
        *("velocity_0 velocity_1 velocity_2", "v_1 v_2 v_3", "velocity", "velocities", "v", ".velocities"),
    ],
)
def test_velocities_are_read_by_the_names_that_programs_give_them(names: str) -> None:
    is_list = len(names.split()) == 1
    kinds = [f"property {'list uchar float' if is_list else 'float'} {name}" for name in names.split()]
    header = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {axis}" for axis in "xyz")]
    header += [*kinds, "element face 1", "property list uchar int vertex_indices", "end_header"]
    rows = [f"{x} {x * x} 0 {'3 ' if is_list else ''}{x} 2 3" for x in range(3)]
    surface = read_polygon_file("\n".join([*header, *rows, "3 0 1 2"]).encode())
    assert surface.velocities is not None
    assert surface.velocities.tolist() == [[0, 2, 3], [1, 2, 3], [2, 2, 3]]
