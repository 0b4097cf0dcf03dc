"""STL files as other programs write them: read right, or refused with the reason."""

import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.plugins.interchange import stl_files
from tests.mesh.brick import POINTS, TRIANGLES, read, require_brick

FACETS = [
    "facet normal 0 0 0\n outer loop\n"
    + "".join(f"  vertex {' '.join(f'{n:.6e}' for n in POINTS[v])}\n" for v in triangle)
    + " endloop\nendfacet\n"
    for triangle in TRIANGLES
]
TEXT = f"solid brick\n{''.join(FACETS)}endsolid brick\n"

CORNERS = np.array(POINTS, "<f4")[np.array(TRIANGLES)].reshape(12, 9)
RECORDS = b"".join(bytes(12) + row.tobytes() + b"\x07\x80" for row in CORNERS)


def binary(promised: int = 12, header: bytes = b"", records: bytes = RECORDS) -> bytes:
    return header.ljust(80, b"\0") + np.array(promised, "<u4").tobytes() + records


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(" ".join(TEXT.split()), id="one line"),
        pytest.param("solid " + " ".join("".join(FACETS).split()) + " endsolid", id="one line, no name"),
        pytest.param(TEXT.upper(), id="capitals"),
        pytest.param(TEXT.replace(" ", "\t"), id="tabs"),
        pytest.param(TEXT.replace("facet normal 0 0 0", "facet normal"), id="no numbers of normals"),
        pytest.param(TEXT.replace("facet normal 0 0 0", "facet"), id="no normals"),
        pytest.param(
            TEXT.replace("normal 0 0 0", "normal nan nan -nan(ind)"), id="normals that are no numbers"
        ),
        pytest.param(
            TEXT.replace("brick", "a solid facet vertex \N{GREEK SMALL LETTER ALPHA}"), id="a name of words"
        ),
        pytest.param(TEXT.replace(" brick", ""), id="no name"),
        pytest.param(re.sub("end(facet|loop|solid)", r"end \1", TEXT), id="ends of two words"),
        pytest.param(
            f"solid a\n{''.join(FACETS[:5])}endsolid a\nsolid\nendsolid\n"
            f"solid b\n{''.join(FACETS[5:])}endsolid b",
            id="three solids",
        ),
        pytest.param(
            " ".join(
                f"solid a {''.join(FACETS[:5])} endsolid a solid b {''.join(FACETS[5:])} endsolid b".split()
            ),
            id="two solids on one line",
        ),
        pytest.param(f"solid {'x' * 3000}\n{TEXT.partition('brick')[2]}", id="a long name"),
        pytest.param("\n\n  " + TEXT, id="blank lines"),
    ],
)
def test_forms_of_text_are_read(tmp_path: Path, content: str) -> None:
    require_brick(read(tmp_path / "a.stl", content))


def test_text_is_read_in_blocks_that_take_no_more_memory_than_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stl_files, "_BLOCK", 10)
    require_brick(read(tmp_path / "a.stl", TEXT))
    require_brick(read(tmp_path / "a.stl", TEXT.replace(" normal 0 0 0", "")))
    for facet, fault in (
        (FACETS[5].replace("e+00", ",5", 1), "triangle 5: "),
        (FACETS[5].replace("  vertex", "  vertex 0 0 0\n vertex", 1), "facet 5 has 4 vertices"),
    ):
        with pytest.raises(MeshError, match=fault):
            read(tmp_path / "a.stl", TEXT.replace(FACETS[5], facet))
    monkeypatch.setattr(stl_files, "_BLOCK", 10_000)
    content = (TEXT * 400).encode()
    tracemalloc.start()
    surface = stl_files.read_stl(content)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(surface.corners) == 3 * 12 * 400 and most < 3 * len(content)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be"])
@pytest.mark.parametrize("line_end", ["\r\n", "\r", "\n\r"])
def test_encodings_and_line_ends_of_other_systems_lose_nothing(
    tmp_path: Path, encoding: str, line_end: str
) -> None:
    require_brick(read(tmp_path / "a.stl", TEXT.replace("\n", line_end).encode(encoding)))


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(binary(header=b"solid brick"), id="a header that begins with solid"),
        pytest.param(binary(header=b"solid facet normal"), id="a header of words of text"),
        pytest.param(binary(header=b"\xff\xfes\0o\0"), id="a header like UTF-16"),
        pytest.param(binary() + bytes(512), id="padded with zeros"),
        pytest.param(binary() + b"\r\nwritten by hand", id="fewer bytes after it than a triangle has"),
    ],
)
def test_binary_files_are_read(tmp_path: Path, content: bytes) -> None:
    require_brick(read(tmp_path / "a.stl", content))


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (binary(4), "its header promises 4 triangles, and there is room for 12"),
        (binary(0), "its header promises 0 triangles, and there is room for 12"),
        (binary(13), "it ends early: its header promises 13 triangles, and 12 are there"),
        (binary(4, b"solid brick"), "its header promises 4 triangles, and there is room for 12"),
        (binary() + b"x" * 50, "its header promises 12 triangles, and there is room for 13"),
        (TEXT.partition("endsolid")[0].encode(), "it ends early: endsolid is missing after 12 triangles"),
        ((TEXT + TEXT[:300]).encode(), "it ends early: endsolid is missing after 13 triangles"),
        (TEXT.replace("  vertex", "  vertex 0 0 0\n vertex", 1).encode(), "facet 0 has 4 vertices"),
        (TEXT.replace("e+00", ",5", 1).encode(), "triangle 0: 0.000000,5 is not a number"),
        (TEXT.replace("3.000000e+00", "3,0", 1).encode(), "decimals have a point, as in 3.0"),
        (TEXT.replace("endfacet", "\0", 1).encode(), "line 8: byte .* is NUL"),
    ],
)
def test_what_cannot_be_read_is_refused_with_the_reason(tmp_path: Path, content: bytes, fault: str) -> None:
    with pytest.raises(MeshError, match=fault):
        read(tmp_path / "a.stl", content)
