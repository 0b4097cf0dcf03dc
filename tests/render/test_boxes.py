"""An index grows wherever it stands in a movie, and still tells where all pictures are."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.base.render_errors import CorruptImageError
from flowsculpt.render.movie import projection_tags
from flowsculpt.render.movie.projection_tags import Box, edit_index, full_box, parse_boxes

BYTES = st.binary(min_size=1, max_size=40).map(lambda some: bytes(128 | each for each in some))
"""No letters, so none that are the kind of a box."""
PICTURES = st.lists(BYTES, min_size=1, max_size=6)
FORMATS = {b"stco": "I", b"co64": "Q"}


def table(kind: bytes, positions: list[int]) -> Box:
    """A box that tells where pictures are."""
    return full_box(kind, struct.pack(f">I{len(positions)}{FORMATS[kind]}", len(positions), *positions))


def index_of(tables: list[Box]) -> Box:
    """An index of one track for each table."""
    tracks = []
    for each in tables:
        media = Box(b"mdia", boxes=[Box(b"mdhd", b"time"), Box(b"minf", boxes=[Box(b"stbl", boxes=[each])])])
        tracks.append(Box(b"trak", boxes=[Box(b"tkhd", b"header"), media]))
    return Box(b"moov", boxes=[Box(b"mvhd", b"all"), *tracks, Box(b"udta", b"not looked into")])


def movie(pictures: list[bytes], kinds: list[bytes], is_first: bool, wide: bool) -> bytes:
    """A file whose tracks all name the same pictures; its index stands before or after them.

    wide  the size of the pictures is written in 64 bits
    """
    content = b"".join(pictures)
    size = struct.pack(">I4sQ", 1, b"mdat", 16 + len(content)) if wide else None
    data = (size or struct.pack(">I4s", 8 + len(content), b"mdat")) + content
    head = bytes(Box(b"ftyp", b"mp42"))

    def file(start: int) -> bytes:
        places = [start + sum(map(len, pictures[:n])) for n in range(len(pictures))]
        index = bytes(index_of([table(kind, places) for kind in kinds]))
        return head + (index + bytes(Box(b"free")) + data if is_first else data + index)

    return file(file(0).index(data) + len(data) - len(content))


def named_pictures(content: bytes, lengths: list[int]) -> list[list[bytes]]:
    """The pictures of each track, read where its table says, by offsets that are counted here alone."""
    (start,) = (i for i in range(len(content)) if content[i + 4 : i + 8] == b"moov")
    size = int.from_bytes(content[start : start + 4], "big")
    index = Box.parse(b"moov", content[start + 8 : start + size])
    found = []
    for track in index.within(b"trak", b"mdia", b"minf", b"stbl"):
        (each,) = track.boxes
        (count,) = struct.unpack_from(">I", each.fixed, 4)
        places = struct.unpack_from(f">{count}{FORMATS[each.kind]}", each.fixed, 8)
        found.append([content[at : at + length] for at, length in zip(places, lengths, strict=True)])
    return found


@given(
    pictures=PICTURES,
    kinds=st.lists(st.sampled_from([b"stco", b"co64"]), min_size=1, max_size=3),
    is_first=st.booleans(),
    wide=st.booleans(),
    added=BYTES,
    block=st.integers(1, 50),
)
def test_every_picture_is_found_after_the_index_grew(
    tmp_path_factory: pytest.TempPathFactory,
    pictures: list[bytes],
    kinds: list[bytes],
    is_first: bool,
    wide: bool,
    added: bytes,
    block: int,
) -> None:
    before = movie(pictures, kinds, is_first, wide)
    lengths = [len(picture) for picture in pictures]
    assert named_pictures(before, lengths) == [pictures] * len(kinds)
    path = tmp_path_factory.getbasetemp() / "movie.mp4"
    path.write_bytes(before)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(projection_tags, "_BLOCK", block)  # what follows the index moves in blocks
        edit_index(path, lambda index: next(index.within(b"trak")).boxes.append(Box(b"uuid", added)))
    after = path.read_bytes()
    assert len(after) == len(before) + 8 + len(added)
    assert named_pictures(after, lengths) == [pictures] * len(kinds)


def test_an_index_that_is_not_changed_keeps_its_bytes(tmp_path: Path) -> None:
    before = movie([b"one", b"two"], [b"stco", b"co64"], is_first=True, wide=False)
    path = tmp_path / "a.mp4"
    path.write_bytes(before)
    edit_index(path, lambda index: None)
    assert path.read_bytes() == before


def test_pictures_that_move_past_four_gibibytes_get_positions_of_64_bits() -> None:
    last = (1 << 32) - 10
    index = index_of([table(b"stco", [500, last]), table(b"stco", [400]), table(b"co64", [last])])
    size = len(bytes(index))
    index.boxes.append(Box(b"free", bytes(4)))
    moved = Box.parse(b"moov", projection_tags._moved(index, 450, size)[8:])
    tables = [track.boxes[0] for track in moved.within(b"trak", b"mdia", b"minf", b"stbl")]
    far = last + 12 + 8  # the box, and 64 bits for two positions
    assert [each.kind for each in tables] == [b"co64", b"stco", b"co64"]
    assert [projection_tags._positions(each) for each in tables] == [(520, far), (400,), (far,)]


@given(st.recursive(st.binary(max_size=9), lambda inner: st.lists(inner, max_size=3), max_leaves=9))
def test_boxes_are_written_as_they_were_read(tree: object) -> None:
    def built(node: object) -> Box:
        if isinstance(node, bytes):
            return Box(b"leaf", node)
        assert isinstance(node, list)
        return Box(b"trak", boxes=[built(each) for each in node])

    content = bytes(built(tree))
    (box,) = parse_boxes(content)
    assert bytes(box) == content


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "it has 0 of them"),
        (b"nothing", "a box at byte 0 has a size of"),
        (bytes(Box(b"moov")) * 2, "it has 2 of them"),
        (bytes(Box(b"moov")) + bytes(Box(b"moof")), "it is cut into fragments"),
        (bytes(Box(b"moov", b"\0\0\0\x20trak")), "a box at byte 0 has a size of 32"),
        (bytes(Box(b"moov"))[:-2], "a box at byte 0 has a size of"),
    ],
)
def test_a_file_without_one_whole_index_is_refused_and_stays(
    content: bytes, says: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.mp4"
    path.write_bytes(content)
    with pytest.raises(CorruptImageError, match=says):
        edit_index(path, lambda index: None)
    assert path.read_bytes() == content
