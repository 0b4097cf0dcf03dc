"""A sound file that a program wrote to a pipe is read to its end; one that was cut off is refused."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.render.movie.movie_sound import _counted

COUNT = 4000
SAMPLES = np.arange(1, COUNT + 1, dtype="<i2").tobytes()
SIZE = len(SAMPLES)
FORMAT = struct.pack("<HHIIHH", 1, 1, 48000, 96000, 2, 16)


def wav(data: int, total: int, kind: bytes = b"RIFF", long: bytes = b"") -> bytes:
    head = kind + struct.pack("<I", total) + b"WAVE" + long
    return head + b"fmt " + struct.pack("<I", 16) + FORMAT + b"data" + struct.pack("<I", data) + SAMPLES


def rf64(data: int, total: int) -> bytes:
    long = b"ds64" + struct.pack("<IQQQI", 28, total, data, 0, 0)
    return wav(2**32 - 1, 2**32 - 1, b"RF64", long)


def wave64(data: int, total: int) -> bytes:
    def chunk(name: str, size: int) -> bytes:
        return name.encode() + bytes.fromhex("f3acd3118cd100c04f8edb8a") + struct.pack("<Q", size)

    head = b"riff" + bytes.fromhex("2e91cf11a5d628db04c10000") + struct.pack("<Q", total)
    return head + chunk("wave", 0)[:16] + chunk("fmt ", 40) + FORMAT + chunk("data", data) + SAMPLES


def aiff(data: int, total: int) -> bytes:
    common = struct.pack(">IHIH", 18, 1, COUNT, 16) + bytes.fromhex("400ebb80000000000000")
    head = b"FORM" + struct.pack(">I", total) + b"AIFFCOMM" + common
    return head + b"SSND" + struct.pack(">III", data, 0, 0) + SAMPLES


def au(data: int, _total: int) -> bytes:
    return b".snd" + struct.pack(">IIIII", 24, data, 3, 48000, 1) + SAMPLES


def caf(data: int, _total: int) -> bytes:
    head = b"caff" + struct.pack(">HHq", 1, 0, 0)[:4] + b"desc" + struct.pack(">qd", 32, 48000.0)
    return (
        head + b"lpcm" + struct.pack(">5I", 2, 2, 1, 1, 16) + b"data" + struct.pack(">QI", data, 0) + SAMPLES
    )


def answer(path: Path, content: bytes) -> bytes:
    path.write_bytes(content)
    return _counted(str(path))


@pytest.mark.parametrize(
    ("made", "data", "total"),
    [
        (wav, SIZE, SIZE + 36),
        (wav, SIZE, SIZE + 44),
        (wav, SIZE + 44, SIZE + 36),
        (wav, 0, 0),
        (wav, 0, 36),
        (wav, 2**32 - 1, 2**32 - 1),
        (wav, 0x7FFFF000, 0x7FFFF024),
        (wav, 0x7FFFFFFF - 36, 0x7FFFFFFF),
        (wav, 0x80000000, 0x80000024),
        (rf64, SIZE, SIZE + 72),
        (rf64, 0, 0),
        (rf64, 2**64 - 1, 2**64 - 1),
        (wave64, SIZE + 24, SIZE + 104),
        (wave64, 24, 104),
        (wave64, 2**63 - 1, 2**64 - 1),
        (aiff, SIZE + 8, SIZE + 46),
        (aiff, 0, 0),
        (aiff, 0x7F000008, 0x7F00002E),
        (au, 2**32 - 1, 0),
        (au, 0, 0),
        (caf, 2**64 - 1, 0),
    ],
)
def test_a_sound_whose_size_its_program_did_not_know_is_read_to_its_end(
    made: Callable[[int, int], bytes], data: int, total: int, tmp_path: Path
) -> None:
    assert answer(tmp_path / "a.sound", made(data, total)).split()[0] == str(COUNT).encode()


@pytest.mark.parametrize(
    ("made", "data", "total"),
    [
        (wav, 2 * SIZE, 2 * SIZE + 36),
        (wav, 2 * SIZE, 0),
        (rf64, 2 * SIZE, 2 * SIZE + 72),
        (wave64, 2 * SIZE, 2 * SIZE + 80),
        (aiff, 2 * SIZE, 2 * SIZE + 38),
        (au, 2 * SIZE, 0),
        (caf, 2 * SIZE, 0),
    ],
)
def test_a_sound_that_was_cut_off_is_refused(
    made: Callable[[int, int], bytes], data: int, total: int, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match="it is cut off"):
        answer(tmp_path / "a.sound", made(data, total))


def test_a_sound_without_samples_is_not_read_on_into_its_remarks(tmp_path: Path) -> None:
    remark = b"LIST" + struct.pack("<I", SIZE)
    empty = wav(0, SIZE + 44).removesuffix(SAMPLES) + remark + SAMPLES
    with pytest.raises(ValueError, match="it holds none"):
        answer(tmp_path / "a.wav", empty)
