"""A movie has the frames, the size, the rate and the colours it was given."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from flowsculpt.render.base.render_errors import (
    BadInputError,
    CorruptImageError,
    MachineError,
    MissingImageError,
)
from flowsculpt.render.movie.codecs import H264, H264_8_BITS
from flowsculpt.render.movie.encode import write_movie
from flowsculpt.render.movie.probe import probe_movie

pytestmark = pytest.mark.renderer

PATCHES = np.array(
    [
        [200, 40, 30],
        [30, 160, 60],
        [40, 60, 190],
        [128, 128, 128],
        [250, 250, 250],
        [8, 8, 8],
        [180, 150, 90],
        [60, 20, 70],
    ],
    dtype=np.uint8,
)


def patches(count: int, height: int = 64, width: int = 128) -> Iterator[np.ndarray]:
    """Eight broad stripes of colour that move one place a frame."""
    for number in range(count):
        stripes = np.roll(PATCHES, number, axis=0)[np.arange(width) * len(PATCHES) // width]
        yield np.tile(stripes, (height, 1, 1))


def decoded(path: Path) -> Iterator[np.ndarray]:
    """RGB 0 … 255 as float, by the BT.709 equations rather than by a player's approximation of them."""
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            planes = frame.reformat(format="yuv444p16le").to_ndarray().astype(np.float64) / 256.0
            y = (planes[..., 0] - 16.0) / 219.0
            cb, cr = (planes[..., 1] - 128.0) / 224.0, (planes[..., 2] - 128.0) / 224.0
            red, blue = y + 1.5748 * cr, y + 1.8556 * cb
            yield 255.0 * np.stack([red, (y - 0.2126 * red - 0.0722 * blue) / 0.7152, blue], axis=-1)


@pytest.mark.parametrize("bits", [8, 10])
def test_a_movie_names_its_colours_and_keeps_them(bits: int, tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    assert write_movie(path, patches(5), Fraction(24), H264 if bits == 10 else H264_8_BITS) == 5
    facts = probe_movie(path)
    assert (facts.frames, facts.width, facts.height, facts.rate) == (5, 128, 64, Fraction(24))
    assert (facts.primaries, facts.transfer, facts.matrix, facts.range) == (1, 1, 1, 1)
    assert facts.pixel_format == ("yuv420p" if bits == 8 else "yuv420p10le")
    for given, shown in zip(patches(5), decoded(path), strict=True):
        inner = np.arange(128).reshape(8, 16)[:, 5:11]  # colour is stored at half resolution
        assert np.abs(given[:, inner] - shown[:, inner]).max() <= 4.0
        assert np.abs((given[:, inner] - shown[:, inner]).mean(axis=(0, 2))).max() <= 2.0


def test_an_odd_size_is_padded_by_its_last_row_and_column(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    write_movie(path, patches(2, 33, 65), Fraction(24), H264_8_BITS)
    facts = probe_movie(path)
    assert (facts.width, facts.height) == (66, 34)
    frame = next(iter(decoded(path)))
    assert np.abs(frame[-1] - frame[-2]).mean() < 3.0


def test_ntsc_rates_are_exact(tmp_path: Path) -> None:
    write_movie(tmp_path / "a.mp4", patches(3), Fraction(24000, 1001), H264_8_BITS)
    assert probe_movie(tmp_path / "a.mp4").rate == Fraction(24000, 1001)


def test_sixteen_bits_keep_a_gradient_that_eight_would_band(tmp_path: Path) -> None:
    ramp = np.linspace(0.20, 0.23, 256) * 65535
    frame = np.repeat(np.tile(ramp, (64, 1))[..., None], 3, axis=2).astype(np.uint16)
    write_movie(tmp_path / "a.mp4", iter([frame]), Fraction(24), H264)
    shown = next(iter(decoded(tmp_path / "a.mp4")))[..., 1].mean(axis=0) / 255.0
    assert (
        np.abs(shown.reshape(16, 16).mean(axis=1) - ramp.reshape(16, 16).mean(axis=1) / 65535).max() < 1 / 255
    )


def test_the_same_frames_are_the_same_file(tmp_path: Path) -> None:
    for name in ("a.mp4", "b.mp4"):
        write_movie(tmp_path / name, patches(4), Fraction(24), H264_8_BITS)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_a_movie_starts_before_it_is_loaded(tmp_path: Path) -> None:
    write_movie(tmp_path / "a.mp4", patches(4), Fraction(24), H264_8_BITS)
    content = (tmp_path / "a.mp4").read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")


def test_frames_are_taken_one_by_one(tmp_path: Path) -> None:
    """A failing source leaves no movie behind, and what stood there stays."""
    path = tmp_path / "a.mp4"
    path.write_bytes(b"an older movie")

    def failing() -> Iterator[np.ndarray]:
        yield from patches(3)
        raise CorruptImageError("a.0004.exr: cannot be read")

    with pytest.raises(CorruptImageError, match="0004"):
        write_movie(path, failing(), Fraction(24), H264_8_BITS)
    assert path.read_bytes() == b"an older movie"
    assert [file.name for file in tmp_path.iterdir()] == ["a.mp4"]


def test_frames_of_two_sizes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="frame 1 has 32×64"):
        write_movie(tmp_path / "a.mp4", iter([*patches(1), *patches(1, 64, 32)]), Fraction(24), H264_8_BITS)
    assert not list(tmp_path.iterdir())


def test_a_movie_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="no frames"):
        write_movie(tmp_path / "a.mp4", iter(()), Fraction(24), H264_8_BITS)
    with pytest.raises(BadInputError, match="float64"):
        write_movie(tmp_path / "a.mp4", iter([np.zeros((4, 4, 3))]), Fraction(24), H264_8_BITS)  # type: ignore[list-item]


def test_a_full_disk_is_reported(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    noise = (rng.integers(0, 255, (64, 64, 3)).astype(np.uint8) for _ in range(12))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, hard))
    try:
        with pytest.raises(MachineError, match="ulimit"):
            write_movie(tmp_path / "a.mp4", noise, Fraction(24), H264_8_BITS)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not list(tmp_path.iterdir())


def test_a_movie_that_is_none_is_reported(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"nothing")
    with pytest.raises(CorruptImageError):
        probe_movie(tmp_path / "a.mp4")
    with pytest.raises(MissingImageError):
        probe_movie(tmp_path / "b.mp4")


def test_a_truncated_movie_is_reported_or_shorter(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    write_movie(path, patches(8), Fraction(24), H264_8_BITS)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    try:
        assert probe_movie(path).frames < 8
    except CorruptImageError as error:
        assert "make it again" in str(error)


def test_the_same_frames_are_the_same_file_every_time(tmp_path: Path) -> None:
    y, x = np.mgrid[0:108, 0:192]
    waves = [
        np.stack([np.sin(x / 9 + i / 3), np.cos(y / 7 + i / 5), ((x + y + 3 * i) % 50) / 25 - 1], axis=-1)
        for i in range(8)
    ]
    frames = [((wave / 2 + 0.5) * 65535).astype(np.uint16) for wave in waves]
    made = set()
    for number in range(10):
        movie = tmp_path / f"{number}.mp4"
        write_movie(movie, iter(frames), Fraction(24), H264_8_BITS)
        made.add(movie.read_bytes())
    assert len(made) == 1
