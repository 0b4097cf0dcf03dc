"""Tags of spherical and stereo movies, by which players show them around the viewer.

MP4 and QuickTime have the boxes `st3d` and `sv3d` of the Spherical Video V2 RFC. Whole spheres have the older
XML of the V1 RFC too, which some players know alone. Matroska has elements of its own. No tag of a dome
exists in these, and WebP has none at all.
"""

from __future__ import annotations

import struct
from pathlib import Path

import av

from render.base.atomic_write import atomic_write, cannot_write
from render.movie.boxes import Box, edit_index, full_box, parse_boxes
from render.movie.codecs import MATROSKA
from render.scene.projection import Projection

_SOURCE = "flowsculpt"
"""The name of the program that wrote the tags."""

_MONO, _LEFT_RIGHT = 0, 2
"""Stereo modes of `st3d`."""

_QUARTER = 1 << 30
"""A quarter, as a fraction of 2³²."""

_SAMPLE_ENTRY_BYTES = 78
"""Bytes of a VisualSampleEntry before the boxes in it."""

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
    entry.boxes = [*boxes[:place], _stereo_box(projection), _spherical_box(projection), *boxes[place:]]
    entry.fixed = entry.fixed[:_SAMPLE_ENTRY_BYTES]


def _stereo_box(projection: Projection) -> Box:
    """Return the box `st3d`."""
    return full_box(b"st3d", bytes([_LEFT_RIGHT if projection.is_stereo else _MONO]))


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
        raise cannot_write(path, path, error.strerror) from None
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
