"""Chunks of Zarr stores are read once points touch them, and points move as if all had been read."""

from __future__ import annotations

import warnings
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.flow import Streamlines, Sum
from flowsculpt.pipeline.flow.catalogue.basic import Translation
from flowsculpt.pipeline.flow.catalogue.sampled_field import Sampled
from flowsculpt.pipeline.flow.flow_map import checked_displacement
from flowsculpt.pipeline.plugins.fields import windowed_samples
from flowsculpt.pipeline.plugins.fields.cf_files import CFSamples, cf_samples
from flowsculpt.pipeline.plugins.fields.cf_headers import Selection
from flowsculpt.pipeline.plugins.fields.chunked_times import SampledByChunk, TimeChunks
from flowsculpt.pipeline.plugins.fields.grid_layout import Placing
from flowsculpt.pipeline.plugins.fields.stored_arrays import ChunkGrid
from flowsculpt.pipeline.shot import read_shot

xarray = pytest.importorskip("xarray")
zarr = pytest.importorskip("zarr")
numcodecs = pytest.importorskip("numcodecs")

DIMS = ("time", "z", "y", "x")


def write(folder: Path, shape: tuple[int, int, int] = (9, 10, 11), **more: Any) -> Path:
    """Write a store of two times of random velocities from -1 to 1 along each axis.

    more  `sizes` of chunks, `turned` axes, `dims` in their order, and what xarray takes
    """
    generator, dims = np.random.default_rng(3), more.pop("dims", DIMS)
    axes = {name: np.linspace(-1.0, 1.0, n) for name, n in zip("zyx", shape, strict=True)}
    axes |= {name: axes[name][::-1] for name in more.pop("turned", "")}
    speed, sizes = {"units": "m s-1"}, dict(zip(DIMS, (1, *more.pop("sizes", (4, 4, 4))), strict=True))
    encoding = {"chunks": tuple(sizes[name] for name in dims), **more.pop("encoding", {})}
    lengths = {"time": 2, **{name: len(axis) for name, axis in axes.items()}}
    data = xarray.Dataset(
        {n: (dims, generator.normal(size=[lengths[d] for d in dims]).astype("f4"), speed) for n in "uvw"},
        {name: (name, axis, {"units": "m", "axis": name.upper()}) for name, axis in axes.items()}
        | {"time": ("time", [0.0, 1.0], {"units": "seconds since 2020-01-01"})},
    )
    store = folder / "a.zarr"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data.to_zarr(store, mode="w", encoding=dict.fromkeys("uvw", encoding), **more)
    return store


def samples_of(store: Path, placing: Placing = Placing()) -> CFSamples:  # noqa: B008
    return cf_samples((store,), Selection(), placing)[0]


def chunks_read(samples: CFSamples, index: int = 0) -> int:
    return int(samples.chunks(index).is_read.sum())


def by_chunk(field: Sampled) -> SampledByChunk:
    return SampledByChunk(**{each.name: getattr(field, each.name) for each in fields(field)})


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.tuples(*[st.integers(2, 9)] * 3),
    sizes=st.tuples(*[st.integers(1, 5)] * 3),
    turned=st.sampled_from(["", "x", "yz", "xyz"]),
    dims=st.permutations(DIMS),
    up=st.sampled_from(["y", "z"]),
    between=st.sampled_from(["linear", "cubic"]),
    outside=st.sampled_from(["clamp", "zero"]),
    time=st.floats(0.0, 1.0),
)
def test_velocities_have_the_bits_of_those_among_samples_that_were_all_read(
    tmp_path_factory: pytest.TempPathFactory, seed: int, time: float, **given: Any
) -> None:
    how = {name: given.pop(name) for name in ("between", "outside")}
    placing = Placing(up=given.pop("up"))
    store = write(tmp_path_factory.mktemp("store"), **given)
    whole = Sampled(samples_of(store, placing), **how)
    lazy = by_chunk(Sampled(samples_of(store, placing), **how))
    generator = np.random.default_rng(seed)
    nodes = np.stack([generator.choice(axis, 40) for axis in whole.samples.axes], axis=1)
    for points in (generator.uniform(-1.3, 1.3, (3, 3)), nodes, generator.uniform(-1.3, 1.3, (300, 3))):
        np.testing.assert_array_equal(lazy.velocity(points, time), whole.velocity(points, time))
    assert lazy.cache_data(time) == whole.cache_data(time)


@pytest.mark.parametrize("substeps", [None, 3])
def test_points_move_alike_in_many_threads(tmp_path: Path, substeps: int | None) -> None:
    store, points = write(tmp_path), np.random.default_rng(1).uniform(-1.0, 1.0, (20_000, 3))
    flows = [Streamlines(kind(samples_of(store)), substeps) for kind in (Sampled, SampledByChunk)]
    whole, lazy = (flow.displace(points, 0.1, 0.3) for flow in flows)
    np.testing.assert_array_equal(lazy, whole)


@pytest.mark.parametrize(
    ("between", "x", "count"), [("linear", 0.0, 1), ("linear", 0.35, 2), ("cubic", -0.35, 2)]
)
def test_a_point_reads_the_chunks_of_its_nodes_alone(
    tmp_path: Path, between: Any, x: float, count: int
) -> None:
    samples = samples_of(write(tmp_path, (12, 12, 12)))
    field = SampledByChunk(samples, between)
    field.velocity(np.array([[x, 0.0, 0.0]]), 0.0)
    assert chunks_read(samples) == count
    field.velocity(np.random.default_rng(1).uniform(-1.0, 1.0, (500, 3)), 0.0)
    assert chunks_read(samples) == len(samples.chunks(0).is_read) == 27


CODECS_2 = [
    None,
    numcodecs.Blosc(),
    numcodecs.Zstd(),
    numcodecs.Zlib(),
    numcodecs.GZip(),
    numcodecs.LZ4(),
    numcodecs.BZ2(),
]
CODECS_3 = [(), zarr.codecs.BloscCodec(), zarr.codecs.ZstdCodec(), zarr.codecs.GzipCodec()]


@pytest.mark.parametrize(
    ("more", "is_direct"),
    [
        ({"zarr_format": 2, "encoding": {"compressors": codec}}, not isinstance(codec, numcodecs.BZ2))
        for codec in CODECS_2
    ]
    + [({"zarr_format": 3, "encoding": {"compressors": codec}}, True) for codec in CODECS_3]
    + [
        ({"zarr_format": 2, "encoding": {"dtype": ">f8"}}, True),
        ({"zarr_format": 3, "encoding": {"dtype": "i2", "scale_factor": 0.01, "_FillValue": 0}}, True),
        ({"zarr_format": 2, "encoding": {"filters": [numcodecs.Delta("f4")]}}, False),
        ({"zarr_format": 3, "encoding": {"shards": (1, 8, 8, 8)}}, False),
        (
            {
                "zarr_format": 3,
                "encoding": {"compressors": (zarr.codecs.ZstdCodec(), zarr.codecs.Crc32cCodec())},
            },
            False,
        ),
    ],
)
def test_chunks_are_read_as_zarr_reads_them(tmp_path: Path, more: dict[str, Any], is_direct: bool) -> None:
    store = write(tmp_path, **more)
    (store / "v" / ("1.1.1.1" if more["zarr_format"] == 2 else "c/1/1/1/1")).unlink()
    samples = samples_of(store)
    assert (ChunkGrid.of(store / "u").dtype is not None) == is_direct
    np.testing.assert_array_equal(samples.velocities(1), samples.read(1))


def test_copies_of_metadata_that_are_stale_change_no_velocity(tmp_path: Path) -> None:
    store = write(tmp_path, zarr_format=2, encoding={"_FillValue": np.float32(-9.0)}, consolidated=True)
    np.testing.assert_array_equal(samples_of(store).read(0), samples_of(store).velocities(0))
    (store / "u/0.0.0.0").unlink()
    copies = store / ".zmetadata"
    copies.write_text(copies.read_text().replace('"fill_value": -9.0', '"fill_value": 5.0'))
    samples = samples_of(store)
    np.testing.assert_array_equal(samples.read(0), samples.velocities(0))


def test_data_that_no_single_node_decides_are_read_whole(tmp_path: Path) -> None:
    store = write(tmp_path)
    assert samples_of(store).parts is not None and samples_of(store, Placing(land="slide")).parts is None
    (tmp_path / "s.yaml").write_text("")
    for outside, kind in (("repeat", Sampled), ("zero", SampledByChunk)):
        flows = f"flows: [{{sampled: {{file: a.zarr, outside: {outside}}}}}]"
        text = f"title: T\nframes: 1-2\nsubject: {{solid: icosphere}}\nresample: off\n{flows}"
        (flow,) = read_shot(tmp_path / "s.yaml", text).motion.flow.flows
        assert type(flow.field) is kind


@pytest.mark.parametrize("substeps", [None, 3])
def test_a_chunk_that_changes_stops_the_points_that_touch_it_alone(
    tmp_path: Path, substeps: int | None
) -> None:
    store = write(tmp_path, (12, 12, 12))
    samples = samples_of(store)
    samples.slopes(0), samples.slopes(1)
    samples._kept.clear()
    changed = store / "u" / "c" / "0" / "2" / "1" / "1"
    changed.write_bytes((store / "u" / "c" / "0" / "1" / "1" / "1").read_bytes())
    flow = Streamlines(SampledByChunk(samples, strength=0.01), substeps)
    for _ in range(2):
        assert np.isfinite(checked_displacement(flow, np.zeros((5, 3)), 0.0, 0.2, 1)).all()
        with pytest.raises(
            FlowsculptError, match=r"2/1/1: it was changed since the work was planned; run again"
        ):
            checked_displacement(flow, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.9]]), 0.0, 0.2, 1)
    with pytest.raises(FlowsculptError, match="run again"):
        flow.field.velocity(np.array([[0.0, 0.0, 0.9]]), 0.0)


@pytest.mark.parametrize("codec", CODECS_2[1:6])
@pytest.mark.parametrize("length", [0, 4**3 * 2])
def test_a_chunk_of_too_few_numbers_is_an_error_that_names_it(
    tmp_path: Path, codec: Any, length: int
) -> None:
    store = write(tmp_path, zarr_format=2, encoding={"compressors": codec})
    (store / "v" / "0.1.1.1").write_bytes(bytes(codec.encode(bytes(length))) if length else b"")
    with pytest.raises(FlowsculptError, match=r"v/0\.1\.1\.1: it cannot be read .*Write or copy it again"):
        samples_of(store).velocities(0)


@pytest.mark.parametrize("substeps", [None, 3])
def test_a_chunk_that_cannot_be_read_stops_its_points_alone_until_it_can(
    tmp_path: Path, substeps: int | None
) -> None:
    store, points = write(tmp_path, (12, 12, 12)), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.9]])
    flow = Streamlines(Sum((SampledByChunk(samples_of(store), strength=0.01), Translation())), substeps)
    chunk = store / "u" / "c" / "0" / "2" / "1" / "1"
    content = chunk.read_bytes()
    flow.field.fields[0].samples.slopes(0), flow.field.fields[0].samples._kept.clear()
    chunk.write_bytes(content[:-4])
    for _ in range(2):
        with pytest.raises(FlowsculptError, match="2/1/1: it cannot be read"):
            checked_displacement(flow, points, 0.0, 0.2, 1)
        with pytest.raises(FlowsculptError, match="2/1/1: it cannot be read"):
            flow.field.velocity(points, 0.0)
        assert np.isfinite(checked_displacement(flow, np.full((1, 3), -0.9), 0.0, 0.2, 1)).all()
    chunk.write_bytes(content)
    whole = Streamlines(Sum((Sampled(samples_of(store), strength=0.01), Translation())), substeps)
    np.testing.assert_array_equal(
        checked_displacement(flow, points, 0.0, 0.2, 1), whole.displace(points, 0.0, 0.2)
    )


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_ctrl_c_before_a_chunk_is_read_leaves_no_velocity_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, point, ends = write(tmp_path), np.zeros((1, 3)), [KeyboardInterrupt]
    original = TimeChunks._fill_wanted

    def interrupted(chunks: TimeChunks) -> None:
        if ends:
            raise ends.pop()
        original(chunks)

    monkeypatch.setattr(TimeChunks, "_fill_wanted", interrupted)
    found = SampledByChunk(samples_of(store)).velocity(point, 0.0)
    np.testing.assert_array_equal(found, Sampled(samples_of(store)).velocity(point, 0.0))


def test_a_chunk_that_is_needed_again_and_again_is_kept_in_the_temporary_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, read = write(tmp_path), list[int]()
    monkeypatch.setattr(windowed_samples, "KEPT_BYTES", 0)
    monkeypatch.setattr(windowed_samples, "KEPT", 1)
    near, all_over = np.full((1, 3), 0.9), np.random.default_rng(1).uniform(-1.0, 1.0, (300, 3))
    whole = [Sampled(samples_of(store)).velocity(points, 0.0) for points in (near, all_over)]
    original = CFSamples.read_chunk

    def counted(samples: CFSamples, index: int, *more: Any) -> Any:
        read.append(index)
        return original(samples, index, *more)

    monkeypatch.setattr(CFSamples, "read_chunk", counted)
    field = SampledByChunk(samples_of(store))
    for _ in range(6):
        np.testing.assert_array_equal(field.velocity(near, 0.0), whole[0])
        field.velocity(near, 1.0)
    few = chunks_read(field.samples)
    assert read.count(0) == read.count(1) == few * (windowed_samples.ONCE_EACH_CHUNK + 1) and few < 27
    np.testing.assert_array_equal(field.velocity(all_over, 0.0), whole[1])
    assert read.count(0) == few * windowed_samples.ONCE_EACH_CHUNK + 27
