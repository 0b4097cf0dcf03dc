"""Every encode gives back the frames, the size, the rate and the colours that it was given."""

from __future__ import annotations

import dataclasses
import gc
import os
import resource
import subprocess
import sys
import weakref
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import imageio.v3 as iio
import numpy as np
import pytest

from flowsculpt.render.base.render_errors import (
    BadInputError,
    MachineError,
    MissingInputError,
)
from flowsculpt.render.movie.codecs import ENCODES, Encode
from flowsculpt.render.movie.encode import write_movie
from flowsculpt.render.movie.movie_sound import RATE, Sound, blocks
from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.post.hdr import HDR_DISPLAYS

pytestmark = pytest.mark.renderer

BARS = np.array(
    [
        [235, 235, 235],
        [180, 180, 16],
        [16, 180, 180],
        [16, 180, 16],
        [180, 16, 180],
        [180, 16, 16],
        [16, 16, 180],
        [5, 5, 5],
    ],
    dtype=np.uint16,
)
"""Colour bars, near to what a gamut's corners are."""
FILM_RATE = Fraction(24000, 1001)
ALL = pytest.mark.parametrize("encode", ENCODES.values(), ids=list(ENCODES))
OF_SDR = {name: encode for name, encode in ENCODES.items() if encode.display not in HDR_DISPLAYS}
EACH = pytest.mark.parametrize("encode", OF_SDR.values(), ids=list(OF_SDR))
"""Encodes of high dynamic range differ from them in colours and their light alone."""


def bars(count: int, height: int = 72, width: int = 128, coverage: bool = False) -> Iterator[np.ndarray]:
    """Colour bars that move one place a frame, 16 bits; a coverage grows from left to right."""
    for number in range(count):
        row = np.roll(BARS, number, axis=0)[np.arange(width) * len(BARS) // width] * 257
        if coverage:
            cover = np.linspace(0, 65535, width).astype(np.uint16)[:, None]
            row = np.concatenate([row, cover], axis=1)
        yield np.tile(row, (height, 1, 1)).astype(np.uint16)


def rgb(planes: np.ndarray, matrix: int) -> np.ndarray:
    """Limited-range planes of 16 bits (H, W, 3) as RGB 0 … 255, by equations of BT.709 (1) or BT.2020 (9)."""
    y, cb, cr = np.moveaxis(planes.astype(np.float64) / 256.0, 2, 0)
    y, cb, cr = (y - 16.0) / 219.0, (cb - 128.0) / 224.0, (cr - 128.0) / 224.0
    r, b = (0.2126, 0.0722) if matrix == 1 else (0.2627, 0.0593)
    red, blue = y + 2.0 * (1.0 - r) * cr, y + 2.0 * (1.0 - b) * cb
    return 255.0 * np.stack([red, (y - r * red - b * blue) / (1.0 - r - b), blue], axis=-1)


def decoded(path: Path) -> list[np.ndarray]:
    """RGB 0 … 255 of all frames."""
    if path.suffix == ".webp":
        return [frame[..., :3].astype(np.float64) for frame in iio.imiter(path, plugin="pillow")]
    with av.open(str(path)) as container:
        frames = []
        for frame in container.decode(max(container.streams.video, key=lambda stream: stream.frames)):
            if frame.format.name.startswith("gbr"):
                frames.append(frame.reformat(format="rgb48le").to_ndarray() / 257.0)
            else:
                matrix = int(container.streams.video[0].codec_context.colorspace)
                frames.append(rgb(frame.reformat(format="yuv444p16le").to_ndarray(), matrix))
        return frames


@ALL
def test_an_encode_keeps_count_size_rate_and_colours(encode: Encode, tmp_path: Path) -> None:
    path = tmp_path / f"a{encode.suffix}"
    assert write_movie(path, bars(6), FILM_RATE, encode, "00:00:01:18") == 6
    facts = probe_movie(path)
    assert (facts.frames, facts.width, facts.height) == (6, 128, 72)
    shown = decoded(path)
    inner = np.arange(128).reshape(8, 16)[:, 4:12]
    for given, found in zip(bars(6), shown, strict=True):
        flat = (given / 257.0)[8:-8, inner], found[8:-8, inner]
        assert np.abs(flat[0].mean(axis=(0, 2)) - flat[1].mean(axis=(0, 2))).max() <= 2.0
        assert np.abs(flat[0] - flat[1]).max() <= 4.0
    if encode.suffix == ".webp":
        assert abs(facts.rate - FILM_RATE) < Fraction(1, 5)  # its times are whole milliseconds
        return
    assert facts.rate == FILM_RATE
    assert facts.timecode == ("00:00:01:18" if encode.has_timecode else "")
    transfers = {"pq": 16, "hlg": 18}
    expected = (1, 1, 0, 2) if encode.is_rgb else (1, 1, 1, 1)
    if encode.display in transfers:
        expected = (9, transfers[encode.display], 9, 1)
    assert (facts.primaries, facts.transfer, facts.matrix, facts.range) == expected
    assert not facts.alpha


def test_every_frame_of_a_review_movie_is_whole(tmp_path: Path) -> None:
    write_movie(tmp_path / "a.mp4", bars(8), Fraction(24), ENCODES["review"])
    with av.open(str(tmp_path / "a.mp4")) as container:
        assert all(packet.is_keyframe for packet in container.demux(video=0) if packet.size)
    assert probe_movie(tmp_path / "a.mp4").pixel_format == "yuv420p"


def test_players_of_apple_find_their_tag(tmp_path: Path) -> None:
    write_movie(tmp_path / "a.mp4", bars(3), Fraction(24), ENCODES["h265"])
    facts = probe_movie(tmp_path / "a.mp4")
    assert (facts.codec, facts.tag, facts.pixel_format) == ("hevc", "hvc1", "yuv420p10le")


H265 = """\
import sys; from fractions import Fraction; from pathlib import Path; import numpy as np
from flowsculpt.render.movie.codecs import ENCODES
from flowsculpt.render.movie.encode import write_movie
folder = Path(sys.argv[1])
for count in (1, 2):
    frames = iter(np.zeros((count, 65, 129, 3), np.uint8))
    write_movie(folder / f"short.{count}.mp4", frames, Fraction(12000), ENCODES["h265"])
for width, height in (64, 64), (48, 40):
    frames = np.random.default_rng(3).integers(0, 65536, (8, height, width, 3)).astype(np.uint16)
    write_movie(folder / f"narrow.{width}.mp4", iter(frames), Fraction(24), ENCODES["hdr10"])
"""


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two folders with the movies of H265, by processes whose new memory held other bytes.

    MALLOC_PERTURB_ makes glibc fill new memory; MALLOC_CHECK_ makes it stop a program that writes too far.
    """
    folders = []
    for fill in ("1", "90"):
        folders.append(tmp_path_factory.mktemp("filled"))
        checks = {"LD_PRELOAD": "libc_malloc_debug.so.0", "MALLOC_CHECK_": "3", "MALLOC_PERTURB_": fill}
        command = [sys.executable, "-c", H265, str(folders[-1])]
        subprocess.run(command, env={**os.environ, **checks}, check=True)
    return folders


@pytest.mark.parametrize("count", [1, 2])
def test_short_h265_movies_have_decoding_times_whatever_the_memory_held(
    count: int, filled: list[Path]
) -> None:
    """For one or two frames x265 subtracts a delay that it never set.

    At 12000 frames per second the file counts time as the encoder does, so no rounding hides a wrong one.
    """
    for folder in filled:
        with av.open(str(folder / f"short.{count}.mp4")) as container:
            times = [(packet.pts, packet.dts) for packet in container.demux(video=0) if packet.size]
        assert times == [(n, n) for n in range(count)]


@pytest.mark.parametrize("width", [48, 64])
def test_narrow_h265_movies_are_the_same_file_whatever_the_memory_held(
    width: int, filled: list[Path]
) -> None:
    """x265 by itself reads memory that it never set at 64 pixels, and writes past a buffer at 48."""
    one, other = (folder / f"narrow.{width}.mp4" for folder in filled)
    assert one.read_bytes() == other.read_bytes()


def test_a_failing_encoder_is_named_and_the_disk_is_not_blamed(tmp_path: Path) -> None:
    broken = dataclasses.replace(ENCODES["h265"], options={**ENCODES["h265"].options, "preset": "no such"})
    with pytest.raises(MachineError, match="the encoder libx265 failed") as raised:
        write_movie(tmp_path / "a.mp4", bars(1), Fraction(24), broken)
    assert "disk" not in str(raised.value)
    assert not list(tmp_path.iterdir())


@EACH
@pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="Linux tells how a thread is scheduled")
def test_no_encoder_leaves_the_process_with_another_priority(encode: Encode, tmp_path: Path) -> None:
    before = os.sched_getscheduler(0)
    write_movie(tmp_path / f"a{encode.container.suffix}", bars(3), Fraction(24), encode)
    assert os.sched_getscheduler(0) == before


def test_the_archive_loses_nothing(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 65536, (3, 33, 65, 3)).astype(np.uint16)
    write_movie(tmp_path / "a.mkv", iter(noise), Fraction(25), ENCODES["ffv1"])
    with av.open(str(tmp_path / "a.mkv")) as container:
        for given, frame in zip(noise, container.decode(video=0), strict=True):
            assert (frame.reformat(format="rgb48le").to_ndarray() == given).all()


def test_coverage_comes_back_as_alpha(tmp_path: Path) -> None:
    path = tmp_path / "a.mov"
    write_movie(path, bars(3, coverage=True), Fraction(24), ENCODES["prores4444"])
    assert probe_movie(path).alpha
    with av.open(str(path)) as container:
        for frame, given in zip(container.decode(video=0), bars(3, coverage=True), strict=True):
            found = frame.reformat(format="yuva444p16le")
            alpha = np.frombuffer(found.planes[3], np.uint16).reshape(72, -1)[:, :128] / 257.0
            assert np.abs(alpha - given[..., 3] / 257.0).max() < 0.5


@EACH
def test_coverage_is_dropped_where_it_cannot_be_kept(encode: Encode, tmp_path: Path) -> None:
    path = tmp_path / f"a{encode.suffix}"
    write_movie(path, bars(2, coverage=True), Fraction(24), encode)
    assert probe_movie(path).alpha == (encode.alpha_format is not None)


@EACH
def test_odd_sizes_are_kept_or_repeated_once(encode: Encode, tmp_path: Path) -> None:
    path = tmp_path / f"a{encode.suffix}"
    write_movie(path, bars(2, 65, 129), Fraction(24), encode)
    facts = probe_movie(path)
    assert (facts.width, facts.height) == ((130, 66) if encode.is_subsampled else (129, 65))
    frame = decoded(path)[0]
    assert np.abs(frame[60, 8] - frame[-1, 8]).max() < 4.0


@EACH
def test_the_same_frames_and_sound_are_the_same_file(encode: Encode, tone: Path, tmp_path: Path) -> None:
    names = [tmp_path / f"{name}{encode.suffix}" for name in "ab"]
    for path in names:
        heard = blocks(Sound(tone), Fraction(5, 24))
        write_movie(path, bars(5), Fraction(24), encode, "01:00:00:00", heard)
    assert names[0].read_bytes() == names[1].read_bytes()


def test_threads_that_convert_frames_leave_each_others_rows_alone(tmp_path: Path) -> None:
    """FFmpeg's threads overwrite four pixels of a row where 10 bits and a width not divisible by 16 meet."""
    fast = dataclasses.replace(ENCODES["h264"], options={**ENCODES["h264"].options, "preset": "ultrafast"})
    names = [tmp_path / "a.mp4", tmp_path / "b.mp4"]
    for path in names:
        write_movie(path, bars(12, 1080, 1922), Fraction(24), fast)
    assert names[0].read_bytes() == names[1].read_bytes()


@EACH
def test_frames_are_let_go_while_others_come(encode: Encode, tmp_path: Path) -> None:
    """However long a film is, few of its frames are held."""
    living, most = [0], 0

    def gone() -> None:
        living[0] -= 1

    def counted() -> Iterator[np.ndarray]:
        nonlocal most
        for frame in bars(90, 64, 64):
            weakref.finalize(frame, gone)
            living[0] += 1
            most = max(most, living[0])
            yield frame

    write_movie(tmp_path / f"a{encode.suffix}", counted(), Fraction(24), encode)
    gc.collect()
    assert most <= 4
    assert living == [0]


def test_what_cannot_be_encoded_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    with pytest.raises(BadInputError, match="no frames"):
        write_movie(path, iter(()), Fraction(24), ENCODES["h264"])
    with pytest.raises(BadInputError, match="frame 2 has 32×64 pixels where the first has 64×64 pixels"):
        write_movie(path, iter([*bars(2, 64, 64), *bars(1, 64, 32)]), Fraction(24), ENCODES["h264"])
    with pytest.raises(BadInputError, match="av1 cannot hold pictures of 48×32 pixels"):
        write_movie(path, bars(1, 32, 48), Fraction(24), ENCODES["av1"])
    with pytest.raises(MachineError, match="cannot be written"):
        (tmp_path / "file").touch()
        write_movie(tmp_path / "file" / "a.mp4", bars(1), Fraction(24), ENCODES["h264"])
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


@EACH
def test_a_full_disk_is_told_in_one_line(encode: Encode, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    noise = (rng.integers(0, 65535, (64, 64, 3)).astype(np.uint16) for _ in range(12))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, hard))
    try:
        with pytest.raises(MachineError, match="ulimit") as told:
            write_movie(tmp_path / f"a{encode.suffix}", noise, Fraction(24), encode)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "\n" not in str(told.value)
    assert not list(tmp_path.iterdir())


# Sound


@pytest.fixture
def tone(tmp_path: Path) -> Path:
    """Two seconds of a tone, one channel of 44.1 kHz."""
    path = tmp_path / "tone.wav"
    wave = 0.5 * np.sin(2.0 * np.pi * 441.0 * np.arange(88200) / 44100.0)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=44100, layout="mono")
        frame = av.AudioFrame.from_ndarray((wave * 32767).astype(np.int16)[None], format="s16", layout="mono")
        frame.sample_rate = 44100
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def level(path: Path) -> np.ndarray:
    """The loudest sample of every tenth of a second."""
    with av.open(str(path)) as container:
        heard = np.concatenate(
            [np.abs(f.to_ndarray().reshape(-1, 2).astype(np.float64)) for f in container.decode(audio=0)]
        )
    heard = heard.max(axis=1) / 2**31
    return heard[: len(heard) // 4800 * 4800].reshape(-1, 4800).max(axis=1)


@pytest.mark.parametrize(
    "encode", [e for e in ENCODES.values() if e.container.audio_codec], ids=lambda e: e.name
)
@pytest.mark.parametrize("frames", [12, 72])
def test_sound_is_cut_or_padded_to_the_pictures(
    encode: Encode, frames: int, tone: Path, tmp_path: Path
) -> None:
    path = tmp_path / f"a{encode.suffix}"
    heard = blocks(Sound(tone), Fraction(frames, 24))
    write_movie(path, bars(frames, 64, 64), Fraction(24), encode, "", heard)
    facts = probe_movie(path)
    assert facts.frames == frames
    assert facts.sound == encode.container.audio_codec
    within = 2 * 1024 / RATE if facts.sound == "aac" else 0.0  # AAC comes in blocks
    assert frames / 24 <= facts.seconds <= frames / 24 + within


def test_sound_begins_fades_and_ends_where_it_is_said_to(tone: Path, tmp_path: Path) -> None:
    sound = Sound(tone, start=0.5, gain=-6.0206, fade_in=0.4, fade_out=0.5)
    path = tmp_path / "a.mov"
    heard = blocks(sound, Fraction(72, 24))
    write_movie(path, bars(72, 16, 16), Fraction(24), ENCODES["prores4444"], "", heard)
    loud = level(path)
    assert len(loud) == 30
    assert (loud[:5] == 0.0).all()
    assert loud[5] < 0.07 < loud[7]
    assert np.abs(loud[9:19] - 0.25).max() < 0.01
    assert loud[24] < 0.06
    assert (loud[25:] == 0.0).all()


def test_a_beginning_can_be_left_out(tone: Path) -> None:
    late = np.concatenate(list(blocks(Sound(tone, start=-0.5), Fraction(1))), axis=1)
    whole = np.concatenate(list(blocks(Sound(tone), Fraction(2))), axis=1)
    assert late.shape == (2, RATE)
    assert np.abs(late - whole[:, RATE // 2 : RATE // 2 + RATE]).max() < 1e-6


def test_what_is_no_sound_is_told(tmp_path: Path) -> None:
    with pytest.raises(MissingInputError, match="file not found"):
        next(blocks(Sound(tmp_path / "a.wav"), Fraction(1)))
    (tmp_path / "b.wav").write_bytes(b"not a sound")
    with pytest.raises(BadInputError, match="cannot be read as sound"):
        next(blocks(Sound(tmp_path / "b.wav"), Fraction(1)))
    write_movie(tmp_path / "c.mp4", bars(1), Fraction(24), ENCODES["h264"])
    with pytest.raises(BadInputError, match="it holds none"):
        next(blocks(Sound(tmp_path / "c.mp4"), Fraction(1)))
