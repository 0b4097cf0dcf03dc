"""Sampled fields: what is between samples, outside of them, and what files can be."""

from __future__ import annotations

import base64
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats, Points, Vectors
from flowsculpt.pipeline.errors import MissingInputError, UsageError
from flowsculpt.pipeline.flow import Streamlines
from flowsculpt.pipeline.flow.catalogue.sampled_field import Sampled
from flowsculpt.pipeline.plugins.fields.grid_files import read_samples

X, Y, Z = np.array([-1.0, -0.4, 0.1, 0.3, 1.0]), np.linspace(-1, 1, 6), np.array([-1.0, -0.5, 0.4, 1.0])


def velocity_on(axes: tuple[Floats, ...], of: str = "linear") -> Vectors:
    x, y, z = np.meshgrid(*axes, indexing="ij")
    if of == "linear":
        return np.stack([x + 2 * y - z, 3 * z + 1, x - y], axis=-1)
    return np.stack([np.sin(np.pi * y), np.cos(np.pi * z), np.sin(np.pi * x)], axis=-1)


def save(file: Path, axes: tuple[Floats, ...] = (X, Y, Z), **changed: np.ndarray) -> Path:
    arrays = {"x": axes[0], "y": axes[1], "z": axes[2], "velocity": velocity_on(axes), **changed}
    np.savez(file, **{name: array for name, array in arrays.items() if array is not None})
    return file


def field_of(*files: Path, interval: float = 1.0, **parameters: object) -> Sampled:
    return Sampled(read_samples(files, None, interval).samples, **parameters)  # type: ignore[arg-type]


@pytest.fixture
def inside() -> Points:
    return np.random.default_rng(0).uniform(-1, 1, (200, 3))


@pytest.mark.parametrize("between", ["linear", "cubic"])
def test_what_is_linear_is_found_exactly_up_to_the_border(
    between: str, tmp_path: Path, inside: Points
) -> None:
    field = field_of(save(tmp_path / "a.npz"), between=between)
    corners = np.array([[X[0], Y[-1], Z[0]], [X[-1], Y[-1], Z[-1]], [X[2], Y[3], Z[1]]])
    for points in (inside, corners):
        expected = np.stack([points @ (1, 2, -1), 3 * points[:, 2] + 1, points @ (1, -1, 0)], axis=1)
        np.testing.assert_allclose(field.velocity(points, 0.0), expected, atol=1e-14)


@pytest.mark.parametrize(("between", "order"), [("linear", 2.0), ("cubic", 3.0)])
def test_finer_samples_are_as_much_better_as_theory_says(between: str, order: float, tmp_path: Path) -> None:
    points, errors = np.random.default_rng(1).uniform(-0.7, 0.7, (500, 3)), []
    exact = np.stack(
        [np.sin(np.pi * points[:, 1]), np.cos(np.pi * points[:, 2]), np.sin(np.pi * points[:, 0])], 1
    )
    for count in (21, 41):
        axes = (np.linspace(-1, 1, count),) * 3
        file = save(tmp_path / f"{count}.npz", axes, velocity=velocity_on(axes, "waves"))
        errors.append(np.sqrt(np.mean((field_of(file, between=between).velocity(points, 0.0) - exact) ** 2)))
    assert np.log2(errors[0] / errors[1]) > order - 0.15


def test_outside_it_is_clamped_or_zero_or_repeats(tmp_path: Path, inside: Points) -> None:
    file = save(tmp_path / "a.npz", velocity=velocity_on((X, Y, Z), "waves"))
    outside = inside + np.array([0.0, 0.0, 2.5])
    clamped, zero, repeated = (
        field_of(file, outside=policy).velocity(outside, 0.0) for policy in ("clamp", "zero", "repeat")
    )
    edge = np.minimum(outside, 1.0)
    np.testing.assert_array_equal(clamped, field_of(file).velocity(edge, 0.0))
    assert zero[outside[:, 2] > 1.0].any() is np.False_
    folded = np.column_stack([outside[:, :2], (outside[:, 2] + 1.0) % 2.0 - 1.0])
    np.testing.assert_allclose(repeated, field_of(file).velocity(folded, 0.0), atol=1e-13)


def test_a_repeating_cubic_has_no_kink_where_it_begins_again(tmp_path: Path) -> None:
    axes = (np.linspace(-1, 1, 9),) * 3
    file = save(tmp_path / "a.npz", axes, velocity=velocity_on(axes, "waves"))
    field = field_of(file, between="cubic", outside="repeat")
    h = 1e-6
    at = lambda x: field.velocity(np.array([[x, 0.3, 0.2]]), 0.0)[0]  # noqa: E731
    np.testing.assert_allclose((at(1 + h) - at(1)) / h, (at(1) - at(1 - h)) / h, atol=1e-4)


@pytest.mark.parametrize("between", ["linear", "cubic"])
def test_the_gradient_bound_holds(between: str, tmp_path: Path, inside: Points) -> None:
    axes = (np.linspace(-1, 1, 9),) * 3
    rough = np.random.default_rng(3).normal(size=(9, 9, 9, 3))
    field = field_of(
        save(tmp_path / "a.npz", axes, velocity=rough), between=between, scale=2.0, strength=-1.5
    )
    h, points = 1e-6, 2.0 * inside
    pairs = [field.velocity(points + h * e, 0.0) - field.velocity(points - h * e, 0.0) for e in np.eye(3)]
    norms = np.linalg.norm(np.stack(pairs, axis=2) / (2 * h), ord=2, axis=(1, 2))
    assert 0.1 * field.gradient_bound(0.0) < norms.max() <= field.gradient_bound(0.0) * (1 + 1e-6)


def test_a_field_is_placed_and_scaled_like_a_thing(tmp_path: Path, inside: Points) -> None:
    file = save(tmp_path / "a.npz")
    plain, grown = field_of(file), field_of(file, centre=(1.0, -2.0, 0.5), scale=3.0)
    there = np.array([1.0, -2.0, 0.5]) + 3.0 * inside
    np.testing.assert_allclose(grown.velocity(there, 0.0), 3.0 * plain.velocity(inside, 0.0), atol=1e-13)


def test_between_moments_velocities_are_blended_and_loop_or_stay(tmp_path: Path, inside: Points) -> None:
    base = velocity_on((X, Y, Z))
    files = [save(tmp_path / f"wind_{k}.npz", velocity=k * base) for k in range(3)]
    plain = field_of(files[1]).velocity(inside, 0.0)
    held = field_of(*files, interval=0.5, start=0.1, time_scale=2.0)
    looped = field_of(*files, interval=0.5, start=0.1, time_scale=2.0, loop=True)
    for time, factor, again in ((0.0, 0.2, 0.2), (0.2, 1.0, 1.0), (0.3, 1.4, 1.4), (0.6, 2.0, 0.6)):
        np.testing.assert_allclose(held.velocity(inside, time), factor * plain, atol=1e-13)
        np.testing.assert_allclose(looped.velocity(inside, time), again * plain, atol=1e-13)
    archive = save(
        tmp_path / "all.npz", t=0.5 * np.arange(3), velocity=np.stack([k * base for k in range(3)])
    )
    at_once = field_of(archive, start=0.1, time_scale=2.0)
    np.testing.assert_array_equal(at_once.velocity(inside, 0.3), held.velocity(inside, 0.3))


def test_what_acts_tells_contents_and_moments_and_no_addresses(tmp_path: Path) -> None:
    one, same, other = (save(tmp_path / f"{n}.npz") for n in "abc")
    save(other, velocity=2 * velocity_on((X, Y, Z)))
    data = [Streamlines(field_of(file), 1).cache_data(0.0, 0.1) for file in (one, same, other)]
    assert data[0] == data[1] != data[2]
    assert str(field_of(one).block.address) not in str(data[0])


BAD = {
    "x is missing": ({"x": None}, r"array x is missing; .* There are: velocity, y, z"),
    "velocity is missing": ({"velocity": None}, "array velocity is missing"),
    "complex": (
        {"velocity": 1j * velocity_on((X, Y, Z))},
        "velocity holds complex128; it must be real numbers",
    ),
    "descending": ({"y": Y[::-1]}, r"axis y \(shape \(6,\)\) must be a row of 2 or more ascending numbers"),
    "one sample": ({"z": Z[:1]}, "axis z"),
    "text": ({"x": np.array(list("abcde"))}, "axis x"),
    "transposed": ({"velocity": velocity_on((X, Y, Z)).T}, r"velocity has the shape \(3, 4, 6, 5\)"),
    "nan": (
        {"velocity": np.where(np.arange(3) == 1, np.nan, velocity_on((X, Y, Z)))},
        r"at \(-1, -1, -1\).*nan",
    ),
    "no time": ({"t": np.array([0.0, 0.0])}, "axis t"),
}


@pytest.mark.parametrize(("changed", "says"), BAD.values(), ids=BAD)
def test_what_is_wrong_with_an_archive_is_told_with_its_file(
    changed: dict, says: str, tmp_path: Path
) -> None:
    file = save(tmp_path / "bad.npz", **changed)
    with pytest.raises(UsageError, match=says) as told:
        read_samples((file,))
    assert str(told.value).startswith(f"{file}: ") and "\n" not in str(told.value)


def test_what_is_no_archive_or_not_there_or_of_another_grid_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_text("hello")
    with pytest.raises(UsageError, match="cannot be read as an archive"):
        read_samples((tmp_path / "a.npz",))
    with pytest.raises(MissingInputError, match=r"gone\.npz: file not found"):
        read_samples((tmp_path / "gone.npz",))
    (tmp_path / "a.csv").write_text("1")
    with pytest.raises(UsageError, match=r"not a format of fields; use \.vti, \.vtr, .*\.nc"):
        read_samples((tmp_path / "a.csv",))
    files = save(tmp_path / "b.npz"), save(tmp_path / "c.npz", (2 * X, Y, Z))
    with pytest.raises(UsageError, match=r"c.npz: its grid differs from that of b.npz"):
        read_samples(files)


def packed(array: np.ndarray, how: str, header: str) -> bytes:
    """Return the bytes that VTK writes for an array: a header and the data, or compressed blocks."""
    raw = array.tobytes()
    if how != "zlib":
        return np.array([len(raw)], header).tobytes() + raw
    size = 100
    blocks = [zlib.compress(raw[i : i + size]) for i in range(0, len(raw), size)]
    head = np.array([len(blocks), size, len(raw) % size, *map(len, blocks)], header).tobytes()
    return head + b"".join(blocks)


def coded(data: bytes, how: str, header: str) -> str:
    """The base64 of that: packed, its header stands apart."""
    if how != "zlib":
        return base64.b64encode(data).decode()
    count = int(np.frombuffer(data, header, 1)[0])
    head = (3 + count) * np.dtype(header).itemsize
    return (base64.b64encode(data[:head]) + base64.b64encode(data[head:])).decode()


def vtk_file(file: Path, how: str, header: str, dtype: str) -> Path:
    """A rectilinear or image grid as VTK would write it, in one of its ways."""
    order, kind = ("BigEndian" if dtype[0] == ">" else "LittleEndian"), f"Float{8 * int(dtype[2])}"
    axes = (
        (X, Y, Z)
        if file.suffix == ".vtr"
        else (0.5 * np.arange(-2, 3), 0.1 + np.arange(6.0), -np.arange(-3, 1.0)[::-1])
    )
    if file.suffix == ".vti":
        axes = (0.5 * np.arange(-2, 3), 0.1 + np.arange(6.0), 2.0 * np.arange(4))
    values = velocity_on(axes).transpose(2, 1, 0, 3).reshape(-1, 3).astype(dtype)
    appended, offset = [], 0

    def array(name: str, data: np.ndarray, components: int) -> str:
        nonlocal offset
        data = data.astype(dtype)
        open_ = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}"'
        if how == "ascii":
            return f'{open_} format="ascii">{" ".join(map(repr, data.ravel().tolist()))}</DataArray>'
        content = packed(data, how, header)
        if how in ("binary", "zlib"):
            return f'{open_} format="binary">{coded(content, how, header)}</DataArray>'
        content = content if how == "raw" else base64.b64encode(content)
        appended.append(content)
        offset += len(content)
        return f'{open_} format="appended" offset="{offset - len(content)}"/>'

    points = f'<PointData Vectors="u">{array("u", values, 3)}{array("w", 2 * values, 3)}</PointData>'
    if file.suffix == ".vtr":
        grid = "RectilinearGrid"
        inner = (
            "<Coordinates>"
            + "".join(array(n, a, 1) for n, a in zip("xyz", axes, strict=True))
            + "</Coordinates>"
        )
        attributes = 'WholeExtent="0 4 0 5 0 3"'
        extent = "0 4 0 5 0 3"
    else:
        grid, inner = "ImageData", ""
        attributes = 'WholeExtent="-2 2 0 5 0 3" Origin="0 0.1 0" Spacing="0.5 1 2"'
        extent = "-2 2 0 5 0 3"
    packer = ' compressor="vtkZLibDataCompressor"' if how == "zlib" else ""
    wide = "UInt64" if header[-1] == "8" else "UInt32"
    how_packed = f'byte_order="{order}" header_type="{wide}"{packer}'
    head = f'<?xml version="1.0"?>\n<VTKFile type="{grid}" version="1.0" {how_packed}>'
    body = f'<{grid} {attributes}><Piece Extent="{extent}">{points}{inner}</Piece></{grid}>'
    tail = b""
    if appended:
        encoding = "raw" if how == "raw" else "base64"
        tail = f'<AppendedData encoding="{encoding}">\n_'.encode() + b"".join(appended) + b"\n</AppendedData>"
    file.write_bytes((head + body).encode() + tail + b"</VTKFile>")
    return file


WAYS = [
    ("ascii", "<u4", "<f8"),
    ("binary", "<u4", "<f4"),
    ("binary", "<u8", "<f8"),
    ("zlib", "<u4", "<f8"),
    ("zlib", "<u8", "<f4"),
    ("raw", "<u8", "<f8"),
    ("base64", "<u4", "<f8"),
    ("raw", ">u4", ">f8"),
]


@pytest.mark.parametrize("suffix", ["vti", "vtr"])
@pytest.mark.parametrize(("how", "header", "dtype"), WAYS, ids=[" ".join(way) for way in WAYS])
def test_vtk_files_are_read_in_all_their_ways(
    suffix: str, how: str, header: str, dtype: str, tmp_path: Path
) -> None:
    file = vtk_file(tmp_path / f"a.{suffix}", how, header, dtype)
    samples = read_samples((file,)).samples
    assert samples.velocity.shape == (1, 5, 6, 4, 3)
    tolerance = 1e-14 if dtype.endswith("8") else 1e-6
    np.testing.assert_allclose(samples.velocity[0], velocity_on(samples.axes), atol=10 * tolerance)
    np.testing.assert_allclose(samples.axes[1], Y if suffix == "vtr" else 0.1 + np.arange(6), atol=tolerance)
    np.testing.assert_allclose(
        samples.axes[0], X if suffix == "vtr" else 0.5 * np.arange(-2, 3), atol=tolerance
    )
    twice = read_samples((file,), array="w").samples
    np.testing.assert_allclose(twice.velocity, 2 * samples.velocity, rtol=1e-6)


def changed(file: Path, old: str, new: str) -> Path:
    file.write_bytes(file.read_bytes().replace(old.encode(), new.encode()))
    return file


WRONG = {
    "not XML": ("</VTKFile>", "", "not XML"),
    "unstructured": ('type="ImageData"', 'type="UnstructuredGrid"', "its type is UnstructuredGrid"),
    "too few points": ('Piece Extent="-2 2', 'Piece Extent="-2 1', "360 numbers for 96 points"),
    "no vectors": (
        'NumberOfComponents="3"',
        'NumberOfComponents="1"',
        "three components at its points or cells.",
    ),
    "another name": ('Vectors="u"', 'Vectors="q"', "no array q of three components"),
    "which": ('Vectors="u"', "", "not one array of three components at its points or cells. There are: u, w"),
    "packer": (
        "byte_order",
        'compressor="vtkZstdDataCompressor" byte_order',
        "compressed by vtkZstdDataCompressor",
    ),
    "cut short": ('"binary">', '"binary">////', "array u cannot be read .*bytes are announced"),
    "spacing": ('Spacing="0.5 1 2"', 'Spacing="0.5 one 2"', "Spacing is '0.5 one 2'; it must be 3 numbers"),
}


@pytest.mark.parametrize(("old", "new", "says"), WRONG.values(), ids=WRONG)
def test_what_is_wrong_with_a_vtk_file_is_told(old: str, new: str, says: str, tmp_path: Path) -> None:
    file = changed(vtk_file(tmp_path / "a.vti", "binary", "<u4", "<f8"), old, new)
    with pytest.raises(UsageError, match=says) as told:
        read_samples((file,))
    assert str(told.value).startswith(f"{file}: ")


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_a_damaged_vtk_file_is_told_or_read_and_nothing_else(data: st.DataObject, tmp_path_factory) -> None:
    file = vtk_file(
        tmp_path_factory.mktemp("vtk") / "a.vtr", data.draw(st.sampled_from(["zlib", "raw"])), "<u4", "<f8"
    )
    content = bytearray(file.read_bytes())
    for _ in range(3):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at] = data.draw(st.integers(0, 255))
    file.write_bytes(content[: data.draw(st.integers(len(content) // 2, len(content)))])
    try:
        samples = read_samples((file,)).samples
    except UsageError as error:
        assert str(file) in str(error)
    else:
        assert np.isfinite(samples.velocity).all()
