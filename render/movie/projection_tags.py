"""Tags of spherical and stereo movies, by which players show them around the viewer.

MP4 and QuickTime have the boxes `st3d` and `sv3d` of the Spherical Video V2 RFC. Whole spheres have the older
XML of the V1 RFC too, which some players know alone. Matroska has elements of its own. No tag of a dome
exists in these, and WebP has none at all.

A box (ISO/IEC 14496-12) is a size, a kind of four letters and content. The index, the box `moov`, says where
in the file the pictures are. Where it stands before them and grows, they move, and their positions in it are
renewed.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import av

from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.render_errors import CorruptImageError, MachineError
from flowsculpt.render.movie.codecs import MATROSKA
from flowsculpt.render.scene.render_camera import Projection

_FIXED_BYTES = {b"moov": 0, b"trak": 0, b"mdia": 0, b"minf": 0, b"stbl": 0, b"stsd": 8}
"""Kinds that hold boxes, and how many bytes of other content they have before them."""

_POSITIONS = {b"stco": "I", b"co64": "Q"}
"""Kinds that hold positions of pictures and sound in the file, and how `struct` calls their numbers."""

_BLOCK = 1 << 22  # bytes that are moved at once


@dataclass
class Box:
    """A box in memory.

    kind   four letters
    fixed  content before the boxes in it; all content where it holds none
    boxes  the boxes in it
    """

    kind: bytes
    fixed: bytes = b""
    boxes: list[Box] = field(default_factory=list)

    @classmethod
    def parse(cls, kind: bytes, content: bytes) -> Box:
        """Return a box of content; boxes in it are found where its kind holds some. Raises ValueError."""
        if kind not in _FIXED_BYTES:
            return cls(kind, content)
        fixed = _FIXED_BYTES[kind]
        return cls(kind, content[:fixed], parse_boxes(content[fixed:]))

    def __bytes__(self) -> bytes:
        content = self.fixed + b"".join(map(bytes, self.boxes))
        return struct.pack(">I4s", 8 + len(content), self.kind) + content

    def within(self, *kinds: bytes) -> Iterator[Box]:
        """Yield the boxes at the end of a path of kinds: `moov.within(b"trak", b"mdia")`."""
        first, *others = kinds
        for box in self.boxes:
            if box.kind == first:
                yield from box.within(*others) if others else (box,)


def full_box(kind: bytes, content: bytes) -> Box:
    """Return a box with version 0 and no flags."""
    return Box(kind, bytes(4) + content)


def parse_boxes(content: bytes) -> list[Box]:
    """Return the boxes of content. Raises ValueError where sizes do not add up."""
    boxes, start = [], 0
    while start < len(content):
        header = content[start : start + 8]
        size = int.from_bytes(header[:4], "big")
        if size < 8 or start + size > len(content):
            raise ValueError(f"a box at byte {start} has a size of {size}")
        boxes.append(Box.parse(header[4:], content[start + 8 : start + size]))
        start += size
    return boxes


def edit_index(path: Path, edit: Callable[[Box], None]) -> None:
    """Change the index of a movie in place; `edit` takes the box `moov` and adds boxes to it.

    A failure leaves a damaged file: `path` is to be the draft of an `atomic_write`.
    Raises CorruptImageError where the file has not one whole index or is cut into fragments.
    """
    with path.open("r+b") as file:
        try:
            start, size = _index_of(file)
            file.seek(start + 8)
            index = Box.parse(b"moov", file.read(size - 8))
        except ValueError as error:
            raise CorruptImageError(f"{path}: its index cannot be changed ({error}); make it again") from None
        edit(index)
        _insert(file, start, size, _moved(index, start + size, size))


def _index_of(file: BinaryIO) -> tuple[int, int]:
    """Return where the index of a file stands and how long it is, bytes. Raises ValueError."""
    end, start, found = file.seek(0, 2), 0, []
    while start < end:
        file.seek(start)
        header = file.read(16)
        size = int.from_bytes(header[:4], "big")
        if size == 1:  # the size follows, in 64 bits
            size = int.from_bytes(header[8:], "big")
        if size == 0:  # to the end of the file
            size = end - start
        if size < 8 or start + size > end:
            raise ValueError(f"a box at byte {start} has a size of {size}")
        if header[4:8] == b"moof":
            raise ValueError("it is cut into fragments")
        if header[4:8] == b"moov":
            found.append((start, size))
        start += size
    if len(found) != 1:
        raise ValueError(f"it has {len(found)} of them")
    return found[0]


def _moved(index: Box, end: int, size: int) -> bytes:
    """Return an index with the positions of what moved. Those past 4 GiB need 64 bits.

    end   where the index ended
    size  its size
    """
    tables = [box for kind in _POSITIONS for box in index.within(b"trak", b"mdia", b"minf", b"stbl", kind)]
    before = [_positions(table) for table in tables]
    is_settled = False
    while not is_settled:
        is_settled, growth = True, len(bytes(index)) - size
        for table, positions in zip(tables, before, strict=True):
            moved = [position + growth if position >= end else position for position in positions]
            if table.kind == b"stco" and max(moved, default=0) >= 1 << 32:
                table.kind, is_settled = b"co64", False  # it is longer, so everything moves farther
            numbers = struct.pack(f">{len(moved)}{_POSITIONS[table.kind]}", *moved)
            table.fixed = table.fixed[:8] + numbers
    return bytes(index)


def _positions(table: Box) -> tuple[int, ...]:
    """Return the positions in a box `stco` or `co64`, which come after its version and their count."""
    (count,) = struct.unpack_from(">I", table.fixed, 4)
    return struct.unpack_from(f">{count}{_POSITIONS[table.kind]}", table.fixed, 8)


def _insert(file: BinaryIO, start: int, size: int, new: bytes) -> None:
    """Replace `size` bytes at `start` by as many or more; what follows moves, the last of it first."""
    shift, place = len(new) - size, file.seek(0, 2)
    while shift and place > start + size:
        block = min(_BLOCK, place - start - size)
        place -= block
        file.seek(place)
        content = file.read(block)
        file.seek(place + shift)
        file.write(content)
    file.seek(start)
    file.write(new)


_SOURCE = "flowsculpt"  # the name of the program that wrote the tags
_MONO, _LEFT_RIGHT = 0, 2  # stereo modes of `st3d`
_QUARTER = 1 << 30  # a quarter, as a fraction of 2³²
_SAMPLE_ENTRY_BYTES = 78  # bytes of a VisualSampleEntry before the boxes in it

_TRAILING = (b"pasp", b"clap", b"colr", b"btrt")
"""Optional boxes of a VisualSampleEntry, which the RFC has after the tags."""

_V1_UUID = bytes.fromhex("ffcc8263f8554a938814587a02521fdd")

_V1_XML = f"""<?xml version="1.0"?>\
<rdf:SphericalVideo xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" \
xmlns:GSpherical="http://ns.google.com/videos/1.0/spherical/">\
<GSpherical:Spherical>true</GSpherical:Spherical>\
<GSpherical:Stitched>true</GSpherical:Stitched>\
<GSpherical:StitchingSoftware>{_SOURCE}</GSpherical:StitchingSoftware>\
<GSpherical:ProjectionType>equirectangular</GSpherical:ProjectionType>\
</rdf:SphericalVideo>"""


def is_tagged(projection: Projection, container: str) -> bool:
    """Tell whether movies of a projection have tags, in a container by FFmpeg's name."""
    return projection.kind in ("spherical", "vr180") and container in ("mp4", "mov", "matroska")


def tag_movie(path: Path, projection: Projection, container: str) -> None:
    """Tag a movie in place: `path` is the draft of an `atomic_write`. Its pictures stay as they are.

    Raises CorruptImageError for a file that is no whole movie, and MachineError where it cannot be written.
    """
    if container == "matroska":
        _tag_matroska(path, projection)
    else:
        edit_index(path, lambda index: _tag_index(index, projection))


def _tag_index(index: Box, projection: Projection) -> None:
    """Add the tags to the tracks of pictures in an index."""
    for track in index.within(b"trak"):
        (handler,) = track.within(b"mdia", b"hdlr")
        if handler.fixed[8:12] != b"vide":
            continue
        for entries in track.within(b"mdia", b"minf", b"stbl", b"stsd"):
            for entry in entries.boxes:
                _tag_entry(entry, projection)
        if projection.kind == "spherical":
            track.boxes.append(Box(b"uuid", _V1_UUID + _V1_XML.encode()))


def _tag_entry(entry: Box, projection: Projection) -> None:
    """Add the boxes to a VisualSampleEntry: after what its codec needs, before what any may have."""
    boxes = parse_boxes(entry.fixed[_SAMPLE_ENTRY_BYTES:])
    place = next((i for i, box in enumerate(boxes) if box.kind in _TRAILING), len(boxes))
    stereo = full_box(b"st3d", bytes([_LEFT_RIGHT if projection.is_stereo else _MONO]))
    entry.boxes = [*boxes[:place], stereo, _spherical_box(projection), *boxes[place:]]
    entry.fixed = entry.fixed[:_SAMPLE_ENTRY_BYTES]


def _spherical_box(projection: Projection) -> Box:
    """Return the box `sv3d`: the forward direction is in the middle, and half a sphere has no back."""
    aside = _QUARTER if projection.kind == "vr180" else 0
    header = full_box(b"prhd", struct.pack(">3i", 0, 0, 0))  # yaw, pitch and roll
    bounds = full_box(b"equi", struct.pack(">4I", 0, 0, aside, aside))  # top, bottom, left, right
    source = full_box(b"svhd", _SOURCE.encode() + b"\0")
    return Box(b"sv3d", boxes=[source, Box(b"proj", boxes=[header, bounds])])


def _tag_matroska(path: Path, projection: Projection) -> None:
    """Copy the packets of a movie into one with tags, which FFmpeg writes.

    FFmpeg takes the tags from a track that it has read: that of an MP4 file with the first picture.
    """
    sample = path.with_name(f"{path.stem}.sample.mp4")
    try:
        with av.open(str(path)) as movie, av.open(str(sample), "w") as tagged:
            packet = next(movie.demux(video=0))
            packet.stream = tagged.add_stream_from_template(movie.streams.video[0])
            tagged.mux(packet)
        tag_movie(sample, projection, "mp4")
        with atomic_write(path, flush=False) as draft:
            _copy_with_track_of(sample, path, draft)
    except av.error.FFmpegError as error:
        raise MachineError.of_draft(path, path, error.strerror) from None
    finally:
        sample.unlink(missing_ok=True)


def _copy_with_track_of(sample: Path, movie: Path, copy: Path) -> None:
    """Copy a Matroska movie; its pictures get the track of another, with its tags."""
    with (
        av.open(str(sample)) as tagged,
        av.open(str(movie)) as source,
        av.open(str(copy), "w", "matroska", container_options=dict(MATROSKA.options)) as target,
    ):
        target.metadata.update(source.metadata)
        tracks = {}
        for stream in source.streams:
            template = tagged.streams.video[0] if stream.type == "video" else stream
            track = tracks[stream.index] = target.add_stream_from_template(template)
            if stream.type == "video":
                track.codec_context.framerate = stream.average_rate
        for packet in source.demux():
            if packet.size:
                packet.stream = tracks[packet.stream.index]
                target.mux(packet)
