"""Readers find out files of the store that hold anything but what was put there."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.production.store import readers
from flowsculpt.pipeline.production.store.digests import CorruptFileError
from flowsculpt.pipeline.production.store.readers import write_npz
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.base.render_errors import CorruptImageError
from flowsculpt.render.post.image import write_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from tests.full_disk import disk_of

pytestmark = pytest.mark.quick

KEY, OTHER = "0123456789abcdef" * 2, "f" * 32
SIZE = (16, 9)
BOX = "title: A\nframes: 1-1\nsubject: {solid: box, size: [2, 2, 2]}\nresample: {max_edge_length: 0.5}\n"


def write_picture(path: Path, key: str = KEY, size: tuple[int, int] = SIZE, value: float = 0.5) -> None:
    beauty = np.random.default_rng(1).random((size[1], size[0], 3), np.float32)
    beauty[3, 4] = value
    write_exr(path, RenderedFrame({"beauty": beauty}), {"key": key})


def cut(path: Path, share: float) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x10
    path.write_bytes(bytes(content))


PICTURES: dict[str, Callable[[Path], None]] = {
    "foreign": lambda path: write_picture(path, key=OTHER),
    "of another size": lambda path: write_picture(path, size=(8, 9)),
    "not finite": lambda path: write_picture(path, value=np.nan),
    "truncated": lambda path: cut(path, 0.6),
    "empty": lambda path: cut(path, 0.0),
    "no picture": lambda path: path.write_text("a picture") and None,
}


def test_a_picture_comes_back_with_its_header(tmp_path: Path) -> None:
    write_picture(tmp_path / "a.exr")
    layers, header = readers.picture(KEY, SIZE)(tmp_path / "a.exr")
    assert layers.size == SIZE and header["key"] == KEY


@pytest.mark.parametrize("what", PICTURES)
def test_a_picture_that_is_another_or_broken_is_found_out(what: str, tmp_path: Path) -> None:
    write_picture(tmp_path / "a.exr")
    PICTURES[what](tmp_path / "a.exr")
    with pytest.raises((CorruptFileError, CorruptImageError)):
        readers.picture(KEY, SIZE)(tmp_path / "a.exr")


def test_a_mesh_that_is_another_or_broken_is_found_out(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(BOX)
    frame = next(iter(animate(read_shot(tmp_path / "a.yaml"))))
    good, path = tmp_path / "good.npz", tmp_path / "a.npz"
    write_npz(good, readers.with_key(KEY, frame.to_arrays()))
    assert np.array_equal(readers.mesh_frame(KEY, frame.number)(good).mesh.vertices, frame.mesh.vertices)
    damages: tuple[Callable[[Path], None], ...] = (
        flip,
        lambda path: cut(path, 0.7),
        lambda path: cut(path, 0.0),
        lambda path: write_npz(path, readers.with_key(OTHER, frame.to_arrays())),
        lambda path: write_npz(path, readers.with_key(KEY, {"report": np.array("{}")})),
        lambda path: write_npz(
            path, readers.with_key(KEY, {**frame.to_arrays(), "report": np.array("[" * 9999)})
        ),
    )
    for damage in damages:
        shutil.copy(good, path)
        damage(path)
        with pytest.raises(CorruptFileError):
            readers.mesh_frame(KEY, frame.number)(path)


def test_large_arrays_that_compress_well_take_less_room_and_come_back_bit_for_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    named = {
        "faces": np.arange(1_200_000, dtype=np.int32).reshape(-1, 3),
        "points": rng.random((100_000, 3)),
        "few": np.zeros(8, np.int64),
        "none": np.empty((0, 3)),
        "text": np.array("{}"),
    }
    write_npz(tmp_path / "a.npz", named)
    write_npz(tmp_path / "b.npz", named)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert (tmp_path / "a.npz").stat().st_size < 0.7 * sum(values.nbytes for values in named.values())
    with np.load(tmp_path / "a.npz", allow_pickle=False) as found:
        assert set(found.files) == set(named)
        for name, values in named.items():
            assert found[name].dtype == values.dtype and found[name].tobytes() == values.tobytes()
            assert found[name].shape == values.shape


def test_a_full_disk_is_told_by_its_number_also_where_arrays_are_compressed(tmp_path: Path) -> None:
    rows = np.arange(3_000_000, dtype=np.int64)
    with disk_of(1 << 20), pytest.raises(OSError) as refused:
        write_npz(tmp_path / "a.npz", {"rows": rows, "noise": np.random.default_rng(1).random(400_000)})
    assert refused.value.errno == errno.EFBIG
