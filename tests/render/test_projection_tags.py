"""FFmpeg, which wrote none of the tags in MP4, reads them; the pictures are those of movies without."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from flowsculpt.render.base.render_errors import MachineError
from flowsculpt.render.movie.codecs import ENCODES, Encode
from flowsculpt.render.movie.encode import write_movie
from flowsculpt.render.movie.movie_sound import Samples
from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.movie.projection_tags import Box, is_tagged
from flowsculpt.render.scene.render_camera import KINDS, PERSPECTIVE, Projection

pytestmark = pytest.mark.renderer

SPHERICAL, VR180, DOME = map(Projection, ("spherical", "vr180", "dome"))
RATE = Fraction(24000, 1001)
TAGGED = [encode for encode in ENCODES.values() if is_tagged(SPHERICAL, encode.container.format)]
EACH = pytest.mark.parametrize("encode", TAGGED, ids=lambda encode: encode.name)

EQUIRECTANGULAR, TILE = 0, 2
"""AVSphericalProjection: a whole sphere, and a part of one, which has bounds."""
FLAT, SIDE_BY_SIDE = 0, 1
"""AVStereo3DType."""
QUARTER = 0x40000000


def frames(count: int = 3) -> Iterator[np.ndarray]:
    """Noise of 16 bits, 64 × 64 pixels."""
    rng = np.random.default_rng(3)
    for _ in range(count):
        yield rng.integers(0, 65536, (64, 64, 3)).astype(np.uint16)


def tone() -> Iterator[Samples]:
    yield np.full((2, 10_000), 0.1, np.float32)


def written(path: Path, encode: Encode, projection: Projection) -> Path:
    write_movie(path, frames(), RATE, encode, "00:59:58:00", tone(), projection)
    return path


def side_data(path: Path) -> dict[str, bytes]:
    """Return what FFmpeg tells of the projection of the first picture, by name."""
    with av.open(str(path)) as container:
        found = next(container.decode(video=0)).side_data
        return {name: bytes(found[name]) for name in ("SPHERICAL", "STEREO3D") if found.get(name)}


def shown_as(path: Path) -> tuple[int, ...]:
    """Projection, yaw, pitch, roll, bounds left, top, right and bottom, and the stereo type."""
    found = side_data(path)
    return *struct.unpack_from("<i3i4I", found["SPHERICAL"]), *struct.unpack_from("<i", found["STEREO3D"])


def packets(path: Path) -> list[tuple[object, ...]]:
    with av.open(str(path)) as container:
        return [
            (packet.stream.type, packet.pts, packet.dts, packet.duration, packet.is_keyframe, bytes(packet))
            for packet in container.demux()
        ]


def pixels(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.reformat(format="rgb48le").to_ndarray() for frame in container.decode(video=0)]


@EACH
def test_players_learn_the_projection_and_the_pictures_stay(encode: Encode, tmp_path: Path) -> None:
    flat = written(tmp_path / f"flat{encode.suffix}", encode, PERSPECTIVE)
    whole = written(tmp_path / f"whole{encode.suffix}", encode, SPHERICAL)
    eyes = written(tmp_path / f"eyes{encode.suffix}", encode, VR180)
    assert not {"SPHERICAL", "STEREO3D"} & set(side_data(flat))
    assert shown_as(whole) == (EQUIRECTANGULAR, 0, 0, 0, 0, 0, 0, 0, FLAT)
    assert shown_as(eyes) == (TILE, 0, 0, 0, QUARTER, 0, QUARTER, 0, SIDE_BY_SIDE)
    assert probe_movie(flat) == probe_movie(whole) == probe_movie(eyes)
    assert packets(flat) == packets(whole) == packets(eyes)
    for before, *after in zip(*map(pixels, (flat, whole, eyes)), strict=True):
        assert all((before == each).all() for each in after)
    assert sorted(tmp_path.iterdir()) == sorted([flat, whole, eyes])


def test_the_index_still_stands_first_where_it_did(tmp_path: Path) -> None:
    first = written(tmp_path / "a.mp4", ENCODES["h264"], SPHERICAL).read_bytes()
    last = written(tmp_path / "a.mov", ENCODES["prores4444"], SPHERICAL).read_bytes()
    assert first.index(b"moov") < first.index(b"mdat")
    assert last.index(b"moov") > last.index(b"mdat")


@pytest.mark.parametrize("projection", [SPHERICAL, VR180], ids=lambda each: each.kind)
@pytest.mark.parametrize("name", ["h264", "h265"])
def test_the_boxes_are_those_that_ffmpeg_writes(name: str, projection: Projection, tmp_path: Path) -> None:
    """FFmpeg copies them from a movie that it read; only the name of the program differs."""
    encode = ENCODES[name]
    ours, theirs = tmp_path / f"a{encode.suffix}", tmp_path / f"b{encode.suffix}"
    written(ours, encode, projection)
    with av.open(str(ours)) as movie, av.open(str(theirs), "w", options={"strict": "unofficial"}) as copy:
        track = copy.add_stream_from_template(movie.streams.video[0])
        for packet in movie.demux(video=0):
            if packet.size:
                packet.stream = track
                copy.mux(packet)
    found = [tag_boxes(path.read_bytes()) for path in (ours, theirs)]
    assert found[0] == found[1]
    assert found[0][0][4:8] == b"st3d" and found[0][-1][4:8] == b"equi"


def tag_boxes(content: bytes) -> list[bytes]:
    """The boxes of tags in a file, without the name of the program."""
    found = []
    for kind in (b"st3d", b"prhd", b"equi"):
        start = content.index(kind) - 4
        found.append(content[start : start + int.from_bytes(content[start : start + 4], "big")])
    return found


def test_whole_spheres_have_the_older_tag_too(tmp_path: Path) -> None:
    """The track of pictures has it, once. FFmpeg reads it where the newer boxes are not there."""
    content = written(tmp_path / "a.mp4", ENCODES["h264"], SPHERICAL).read_bytes()
    assert content.count(b"GSpherical:ProjectionType>equirectangular<") == 1
    (tmp_path / "b.mp4").write_bytes(content.replace(b"sv3d", b"free").replace(b"st3d", b"free"))
    found = side_data(tmp_path / "b.mp4")
    assert struct.unpack_from("<i", found["SPHERICAL"]) == (EQUIRECTANGULAR,)
    assert b"GSpherical" not in written(tmp_path / "c.mp4", ENCODES["h264"], VR180).read_bytes()


def test_tags_stand_after_what_the_codec_needs_and_before_what_any_may_have(tmp_path: Path) -> None:
    content = written(tmp_path / "a.mp4", ENCODES["h264"], VR180).read_bytes()
    places = [content.index(kind) for kind in (b"avcC", b"st3d", b"sv3d", b"svhd", b"prhd", b"equi", b"colr")]
    assert places == sorted(places)


@pytest.mark.parametrize("name", ["review", "prores4444", "ffv1"])
def test_domes_and_perspectives_have_no_tag(name: str, tmp_path: Path) -> None:
    encode, made = ENCODES[name], []
    for number, projection in enumerate((None, PERSPECTIVE, DOME)):
        path = tmp_path / f"{number}{encode.suffix}"
        given = {} if projection is None else {"projection": projection}
        write_movie(path, frames(1), Fraction(24), encode, **given)
        made.append(path.read_bytes())
    assert made[0] == made[1] == made[2]


def test_a_format_without_tags_is_written_as_it_was(tmp_path: Path) -> None:
    for number, projection in enumerate((PERSPECTIVE, SPHERICAL)):
        write_movie(tmp_path / f"{number}.webp", frames(1), RATE, ENCODES["webp"], projection=projection)
    assert (tmp_path / "0.webp").read_bytes() == (tmp_path / "1.webp").read_bytes()
    assert [kind for kind in KINDS if is_tagged(Projection(kind), "webp")] == []


@pytest.mark.parametrize("name", ["review", "ffv1"])
def test_a_tagged_movie_is_the_same_file_every_time(name: str, tmp_path: Path) -> None:
    encode = ENCODES[name]
    made = {written(tmp_path / f"{n}{encode.suffix}", encode, VR180).read_bytes() for n in range(2)}
    assert len(made) == 1


@pytest.mark.parametrize("name", ["h264", "ffv1"])
def test_a_failure_to_tag_leaves_the_movie_that_was_there(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"a{ENCODES[name].suffix}"
    path.write_bytes(b"an older movie")

    def failing(self: Box) -> bytes:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Box, "__bytes__", failing)
    with pytest.raises(MachineError, match="the disk is full"):
        written(path, ENCODES[name], SPHERICAL)
    assert path.read_bytes() == b"an older movie"
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
