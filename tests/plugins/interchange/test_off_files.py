"""OFF files with every prefix, as text of any layout and binary: read right, or refused with the reason."""

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MeshError
from tests.mesh.brick import POINTS, QUADS, read, require_brick, rows

FACES = rows(QUADS, "4 {}")
BODY = rows(POINTS) + FACES
OFF = f"OFF\n8 6 0\n{BODY}"


def with_more(more: str, faces: str = FACES) -> str:
    return rows(POINTS, f"{{}} {more}") + faces


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(f"OFF8 6 0\n{BODY}", id="ModelNet"),
        pytest.param(f"OFF 8 6 0\n{BODY}", id="one line"),
        pytest.param(" ".join(f"OFF\n8 6 12\n{BODY}".split()), id="all on one line"),
        pytest.param(" ".join(f"COFF8 6 0\n{with_more('0.5 0 0 1')}".split()), id="COFF8 on one line"),
        pytest.param(f"OFF\n8 6\n{BODY}", id="no number of edges"),
        pytest.param(f"OFF\n8\n6\n12\n{BODY}", id="three lines"),
        pytest.param(f"8 6 12\n{BODY}", id="no keyword"),
        pytest.param(f"off\n8 6 12\n{BODY}", id="small letters"),
        pytest.param(f"# a brick\n\nOFF # of six\n\n8 6 12\n# vertices\n{BODY}# end\n", id="comments"),
        pytest.param(f"COFF\n8 6 0\n{with_more('255 0 0 255')}", id="COFF"),
        pytest.param(f"COFF8 6 0\n{with_more('0.5 0 0 1')}", id="COFF8"),
        pytest.param(f"OFF\n8 6 0\n{with_more('255 0 0')}", id="colours without C"),
        pytest.param(f"NOFF\n8 6 0\n{with_more('0 0 1')}", id="NOFF"),
        pytest.param(f"CNOFF\n8 6 0\n{with_more('0 0 1 1 0 0 1')}", id="CNOFF"),
        pytest.param(f"NCOFF\n8 6 0\n{with_more('0 0 1 1 0 0 1')}", id="NCOFF"),
        pytest.param(f"STOFF\n8 6 0\n{with_more('0.5 0.5')}", id="STOFF"),
        pytest.param(f"STCNOFF\n8 6 0\n{with_more('0 0 1 1 0 0 1 0.5 0.5')}", id="STCNOFF"),
        pytest.param(f"nOFF\n3\n8 6 0\n{BODY}", id="nOFF"),
        pytest.param(f"4OFF\n8 6 0\n{with_more('1')}", id="4OFF of w 1"),
        pytest.param(
            f"4OFF\n8 6 0\n{rows([(2 * x, 2 * y, 2 * z, 2) for x, y, z in POINTS])}{FACES}", id="4OFF of w 2"
        ),
        pytest.param(
            f"4nOFF 3\n8 6 0\n{rows([(x / 2, y / 2, z / 2, 0.5) for x, y, z in POINTS])}{FACES}", id="4nOFF"
        ),
        pytest.param(OFF.replace("7 3\n", "7 3 255 0 0\n"), id="a face with a colour of integers"),
        pytest.param(OFF.replace("7 3\n", "7 3 0.5 .1 1. 0.5\n"), id="a face with a colour of decimals"),
        pytest.param(OFF.replace("7 3\n", "7 3 4\n"), id="a face with an index of a colour"),
        pytest.param(f"OFF\n8 6 0\n{' '.join(rows(POINTS).split())}\n{FACES}", id="vertices in one line"),
        pytest.param("OFF\n8 6 0\n" + BODY.replace(" ", "\n"), id="a number a line"),
        pytest.param(
            f"COFF\n8 6 0\n{' '.join(with_more('1 0 0 1', '').split())}\n{FACES}", id="COFF, one line"
        ),
    ],
)
def test_forms_of_text_are_read(tmp_path: Path, content: str) -> None:
    require_brick(read(tmp_path / "a.off", content))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be"])
@pytest.mark.parametrize("line_end", ["\r\n", "\r", "\n\r"])
def test_encodings_and_line_ends_of_other_systems_lose_nothing(
    tmp_path: Path, encoding: str, line_end: str
) -> None:
    require_brick(read(tmp_path / "a.off", OFF.replace("\n", line_end).encode(encoding)))


def binary(
    keyword: str, table: list[tuple[float, ...]], colours: tuple[int, ...] = (), line_end: str = "\n"
) -> bytes:
    ints = [np.array([4, *quad, len(colours), *colours], ">i4").tobytes() for quad in QUADS]
    counts = ([3] if "n" in keyword else []) + [8, 6, 0]
    head = f"{keyword} BINARY{line_end}".encode() + np.array(counts, ">i4").tobytes()
    return head + np.array(table, ">f4").tobytes() + b"".join(ints)


COLOURED = [(*point, 1.0, 0.0, 0.0, 1.0) for point in POINTS]


@pytest.mark.parametrize(
    "content",
    [
        binary("OFF", POINTS),  # type: ignore[arg-type]
        binary("OFF", POINTS, line_end="\r\n"),  # type: ignore[arg-type]
        binary("OFF", POINTS, (7,)),  # type: ignore[arg-type]
        binary("OFF", POINTS, (0, 0, 0, 0)),  # type: ignore[arg-type]
        binary("nOFF", POINTS),  # type: ignore[arg-type]
        binary("COFF", COLOURED),
        binary("STCNOFF", [(*point, 0, 0, 1, 1, 0, 0, 1, 0, 0) for point in POINTS]),
        binary("4OFF", [(2 * x, 2 * y, 2 * z, 2) for x, y, z in POINTS]),
    ],
)
def test_binary_files_are_read(tmp_path: Path, content: bytes) -> None:
    require_brick(read(tmp_path / "a.off", content))


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("nOFF\n4\n8 6 0\n", r"its vertices have 4 dimensions \(nOFF\)"),
        (f"4OFF\n8 6 0\n{with_more('0')}", r"vertex 0 has w 0 \(4OFF\)"),
        (f"4OFF\n8 6 0\n{BODY}", "vertex 0 has 3 coordinates, not 4"),
        (OFF.replace("8 6", "8 5"), "its header promises 5 faces, and 1 row follows the last of them"),
        (OFF.replace("8 6", "8 7"), "its header promises 7 faces, and 6 are there"),
        (OFF.replace("8 6", "7 6"), "its header promises 6 faces, and 1 row follows the last of them"),
        (OFF.replace("2 3 1", "2,0 3 1"), "vertex 7: 2,0 is not a number; decimals have a point, as in 2.0"),
        (OFF.replace("4 0 1 3 2", "4 0 1 3 2.5"), "face 0: 2.5 is not an integer"),
        ("OFF\n8 six 0\n", "it has no OFF header"),
        ("OFF 8 6 0 0 0 0 1", "its header promises 8 vertices, and 1 is there"),
        ("{ appearance { } OFF\n", "it has no OFF header"),
        (OFF.replace("2 3 1", "2 3 \0"), "line 10: byte .* is NUL"),
    ],
)
def test_what_cannot_be_read_is_refused_with_the_reason(tmp_path: Path, content: str, fault: str) -> None:
    with pytest.raises(MeshError, match=fault):
        read(tmp_path / "a.off", content)


@pytest.mark.parametrize("size", range(12, len(binary("OFF", POINTS))))  # type: ignore[arg-type]
def test_no_cut_binary_file_is_read(tmp_path: Path, size: int) -> None:
    with pytest.raises(MeshError, match=r"it ends early|it ends within its header"):
        read(tmp_path / "a.off", binary("OFF", POINTS)[:size])  # type: ignore[arg-type]
