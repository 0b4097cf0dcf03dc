"""Files of samples that are not what they say: told in one line, and without filling the memory first."""

from __future__ import annotations

import base64
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MissingInputError, UsageError
from flowsculpt.pipeline.plugins.fields import grid_files
from flowsculpt.pipeline.plugins.fields.grid_files import read_samples
from flowsculpt.render.base.input_files import InputFile

AXIS = np.linspace(-1.0, 1.0, 4)
ONES = np.ones((4, 4, 4, 3))
U = 'Name="u" NumberOfComponents="3" format="ascii">'


def archive(file: Path, **more: np.ndarray) -> Path:
    np.savez_compressed(file, **{"x": AXIS, "y": AXIS, "z": AXIS, "velocity": ONES, **more})
    return file


def image(file: Path, old: str = "", new: str = "") -> Path:
    values = " ".join(["1"] * 192)
    text = (
        '<?xml version="1.0"?>\n<VTKFile type="ImageData" byte_order="LittleEndian">\n'
        '<ImageData WholeExtent="0 3 0 3 0 3"><Piece Extent="0 3 0 3 0 3"><PointData>\n'
        f'<DataArray type="Float64" {U}{values}</DataArray></PointData></Piece></ImageData></VTKFile>'
    )
    assert old in text
    file.write_text(text.replace(old, new, 1))
    return file


def edited(file: Path, edit: Callable[[bytearray], None]) -> Path:
    content = bytearray(file.read_bytes())
    edit(content)
    file.write_bytes(content)
    return file


def of_zip(place: int, value: int) -> Callable[[bytearray], None]:
    """Sets a byte of every header of an archive: flags are at 6, the method at 8, and 2 later at its end."""

    def edit(content: bytearray) -> None:
        for mark, shift in ((b"PK\x03\x04", 0), (b"PK\x01\x02", 2)):
            at = content.find(mark)
            while at >= 0:
                content[at + place + shift] = value
                at = content.find(mark, at + 4)

    return edit


def a_row(folder: Path) -> Path:
    np.save(folder / "a.npy", AXIS)
    return (folder / "a.npy").rename(folder / "a.npz")


def spoilt(content: bytearray) -> None:
    """Packed bytes of the first array that cannot be unpacked."""
    begin = 30 + content[26] + content[28]
    content[begin : begin + 40] = b"\xff" * 40


def packed_too_much(folder: Path) -> Path:
    """A block of one megabyte where the grid has room for 1536 bytes."""
    block = zlib.compress(bytes(1 << 20))
    head = np.array([1, 1 << 20, 0, len(block)], "<u4").tobytes()
    text = (base64.b64encode(head) + base64.b64encode(block)).decode()
    file = image(folder / "a.vti", " ".join(["1"] * 192), text)
    edit = file.read_text().replace('format="ascii"', 'format="binary"')
    file.write_text(edit.replace("byte_order", 'compressor="vtkZLibDataCompressor" byte_order'))
    return file


DAMAGED: dict[str, tuple[Callable[[Path], Path], str]] = {
    "a row for an archive": (a_row, "cannot be read as an archive of arrays.*not a zip file"),
    "encrypted": (lambda f: edited(archive(f / "a.npz"), of_zip(6, 1)), "is encrypted"),
    "unknown packing": (lambda f: edited(archive(f / "a.npz"), of_zip(8, 99)), "compression method"),
    "spoilt": (lambda f: edited(archive(f / "a.npz"), spoilt), "as an archive of arrays.*(invalid|Error)"),
    "objects": (lambda f: archive(f / "a.npz", x=np.array([1, None])), "Object arrays cannot be loaded"),
    "huge extent": (
        lambda f: image(f / "a.vti", 'Piece Extent="0 3', 'Piece Extent="0 1000000000000000'),
        "GiB of velocities are too many; 8 GiB are the most",
    ),
    "nan extent": (
        lambda f: image(f / "a.vti", 'Piece Extent="0 3', 'Piece Extent="0 nan'),
        "Extent is '0 nan 0 3 0 3'; it must be 6 numbers",
    ),
    "half extent": (
        lambda f: image(f / "a.vti", 'Piece Extent="0 3', 'Piece Extent="0 2.5'),
        "and must be 6 whole numbers",
    ),
    "unknown encoding": (lambda f: image(f / "a.vti", '"1.0"?', '"1.0" encoding="foo"?'), "unknown encoding"),
    "utf-32": (
        lambda f: image(f / "a.vti", '"1.0"?', '"1.0" encoding="utf-32"?'),
        "cannot be read as a grid, as VTK and ParaView write one",
    ),
    "out of bounds": (
        lambda f: image(f / "a.vti", f'Float64" {U}1', f'Int8" {U}300'),
        "cannot be read as a grid.*(300|out of bounds)",
    ),
    "no number": (lambda f: image(f / "a.vti", ">1 1", ">1 one"), "could not convert string to float: 'one'"),
    "packed too much": (packed_too_much, "more numbers than it should have"),
}


@pytest.mark.parametrize(("make", "says"), DAMAGED.values(), ids=DAMAGED)
def test_what_a_file_does_wrong_is_told_in_one_line(
    make: Callable[[Path], Path], says: str, tmp_path: Path
) -> None:
    file = make(tmp_path)
    with pytest.raises(UsageError, match=says) as told:
        read_samples((file,))
    assert str(told.value).startswith(f"{file}: ") and "\n" not in str(told.value)


def test_the_files_that_are_damaged_above_are_sound_before(tmp_path: Path) -> None:
    for file in (archive(tmp_path / "a.npz"), image(tmp_path / "a.vti")):
        np.testing.assert_array_equal(read_samples((file,)).samples.velocity, ONES[None])


@pytest.mark.slow
def test_only_the_arrays_of_a_field_are_unpacked(tmp_path: Path) -> None:
    """Half a gigabyte of something else lies in a file of half a megabyte; a process of its own tells."""
    file = archive(tmp_path / "a.npz", junk=np.zeros(1 << 26))
    assert file.stat().st_size < 1 << 20
    code = (
        "import resource, sys\nfrom pathlib import Path\n"
        "from flowsculpt.pipeline.plugins.fields.grid_files import read_samples\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\nread_samples((Path(sys.argv[1]),))\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)"
    )
    command = [sys.executable, "-c", code, str(file)]
    grown = int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    assert grown < 50 << 10, "kilobytes"


def test_headers_tell_what_is_too_much_before_it_is_unpacked(tmp_path: Path) -> None:
    file = archive(tmp_path / "a.npz")
    huge = np.lib.format.header_data_from_array_1_0(ONES) | {"shape": (1 << 20, 1 << 20, 3)}
    with zipfile.ZipFile(file, "w") as packed:
        for name in "xyz":
            with packed.open(f"{name}.npy", "w") as member:
                np.lib.format.write_array(member, AXIS)
        with packed.open("velocity.npy", "w") as member:
            np.lib.format.write_array_header_1_0(member, huge)
    with pytest.raises(UsageError, match="24576 GiB of velocities are too many; 8 GiB are the most"):
        read_samples((file,))


def test_of_a_long_sequence_the_times_around_a_moment_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = tuple(archive(tmp_path / f"{k}.npz", k=np.full(1, k)) for k in range(3))
    known = read_samples(files).samples
    monkeypatch.setattr(grid_files, "IN_MEMORY", 2 * ONES.nbytes)
    samples = read_samples(files, interval=2.0).samples
    assert samples.times.tolist() == [0.0, 2.0, 4.0]
    np.testing.assert_array_equal(samples.velocities(2), known.velocities(2))
    np.testing.assert_allclose(samples.slopes(1), known.slopes(1))
    samples.digest(0)
    archive(files[0], k=np.full(1, 7))
    with pytest.raises(MissingInputError, match=r"0\.npz: it was changed since the work was planned"):
        samples.velocities(0)
    archive(files[2], x=2 * AXIS)
    again = read_samples(files, interval=2.0).samples
    with pytest.raises(UsageError, match=r"its grid differs from that of 0\.npz"):
        again.velocities(2)


def test_samples_never_go_by_the_digest_of_others(tmp_path: Path) -> None:
    file = archive(tmp_path / "a.npz")
    known = read_samples((file,)).samples
    archive(file, velocity=2 * ONES)
    now = read_samples((file,)).samples
    assert (known.velocity == 1).all() and (now.velocity == 2).all() and known != now


def test_a_file_is_hashed_once_and_parsed_while_it_is_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = tuple(archive(tmp_path / f"{k}.npz", velocity=k * ONES) for k in range(3))
    read: list[str] = []
    parsed: list[str] = []
    content, parse = InputFile.content, grid_files.read_npz
    monkeypatch.setattr(InputFile, "content", lambda file: (read.append(file.path.name), content(file))[1])
    monkeypatch.setattr(
        grid_files, "read_npz", lambda file, *more: (parsed.append(file.name), parse(file, *more))[1]
    )
    first, again = read_samples(files), read_samples(files)
    assert read == 2 * ["0.npz", "1.npz", "2.npz"] and parsed == read[:3]
    assert first == again and first is again
    archive(files[2], velocity=9 * ONES)
    assert read_samples(files) != first and parsed[3:] == read[:3]
