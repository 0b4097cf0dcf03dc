"""Chunks of Zarr stores are read as zarr reads them, or by zarr."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.fields.stored_arrays import numbers_of, opened
from flowsculpt.pipeline.plugins.fields.zarr_arrays import ZarrArray

pytest.importorskip("xarray")
zarr = pytest.importorskip("zarr")

SHAPE, CHUNKS = (3, 5, 7), (1, 2, 4)
VALUES = np.random.default_rng(1).integers(-99, 99, SHAPE)

FORMS: dict[str, dict[str, Any]] = {
    "version 2": {"zarr_format": 2, "compressors": None},
    "version 2, zlib": {"zarr_format": 2, "compressors": "zlib"},
    "version 2, blosc": {"zarr_format": 2, "compressors": "blosc"},
    "version 2, big-endian": {"zarr_format": 2, "compressors": None, "dtype": ">f4"},
    "version 2, folders": {"zarr_format": 2, "chunk_key_encoding": {"name": "v2", "separator": "/"}},
    "version 2, lz4": {"zarr_format": 2, "compressors": "lz4", "dtype": "i2"},
    "version 3": {"compressors": None},
    "version 3, zstd": {"compressors": "auto"},
    "version 3, gzip": {"compressors": "gzip", "dtype": "f8"},
    "version 3, big-endian": {"compressors": None, "serializer": "big"},
    "version 3, bytes": {"compressors": None, "dtype": "i1"},
    "version 3, dots": {"chunk_key_encoding": {"name": "default", "separator": "."}},
    "version 3, names of version 2": {"chunk_key_encoding": {"name": "v2", "separator": "."}},
    "filled": {"compressors": None, "fill_value": 7, "absent": True},
    "filled with NaN": {"zarr_format": 2, "fill_value": np.nan, "absent": True},
}
BY_ZARR: dict[str, dict[str, Any]] = {
    "shards": {"shards": (1, 4, 4)},
    "filters": {"zarr_format": 2, "filters": "delta"},
    "columns first": {"zarr_format": 2, "order": "F"},
    "two compressors": {"compressors": "two"},
}


def store(folder: Path, **form: Any) -> Path:
    """Write a store with an array v of VALUES; `absent` leaves out its last time."""
    import numcodecs

    absent, named = form.pop("absent", False), form.get("compressors")
    version = form.setdefault("zarr_format", 3)
    if version == 2 and named:
        form["compressors"] = numcodecs.get_codec({"id": named})
    if version == 3 and named in ("gzip", "two"):
        gzip = zarr.codecs.GzipCodec()
        form["compressors"] = gzip if named == "gzip" else [gzip, zarr.codecs.ZstdCodec()]
    if "serializer" in form:
        form["serializer"] = zarr.codecs.BytesCodec(endian="big")
    if "filters" in form:
        form["filters"] = numcodecs.Delta(dtype="f4")
    root = zarr.open_group(folder / "a.zarr", mode="w", zarr_format=version)
    known = (
        {"dimension_names": list("tyx")}
        if version == 3
        else {"attributes": {"_ARRAY_DIMENSIONS": list("tyx")}}
    )
    del form["zarr_format"]
    array = root.create_array("v", shape=SHAPE, chunks=CHUNKS, **{"dtype": "f4", **known, **form})
    count = SHAPE[0] - absent
    array[:count] = VALUES[:count]
    return folder / "a.zarr"


@pytest.mark.parametrize("form", [*FORMS, *BY_ZARR])
def test_numbers_are_those_that_zarr_reads(tmp_path: Path, form: str) -> None:
    path = store(tmp_path, **{**FORMS, **BY_ZARR}[form])
    assert (ZarrArray.of(path / "v").stored is not None) == (form in FORMS)
    with opened(path) as dataset:
        variable = dataset.variables["v"]
        for at in ({}, {"t": 1}, {"t": 2, "y": slice(1, 4)}, {"x": 3, "y": slice(4, 5)}):
            found, expected = numbers_of(path, None, "v", variable, at), variable.isel(at).values
            np.testing.assert_array_equal(found, expected)
            assert found.dtype == expected.dtype.newbyteorder("=") and found.shape == expected.shape


@given(st.data())
def test_the_chunks_of_any_part_are_those_that_hold_it(data: st.DataObject) -> None:
    shape = data.draw(st.lists(st.integers(1, 9), min_size=1, max_size=3))
    sizes = [data.draw(st.integers(1, 10)) for _ in shape]
    ranges = [range(a := data.draw(st.integers(0, n - 1)), data.draw(st.integers(a + 1, n))) for n in shape]
    array = ZarrArray(Path("a"), tuple(shape), tuple(sizes), (), ".", None)
    named = {numbers for numbers, _ in array.chunks(ranges)}
    places = np.ix_(*(np.array(each) // size for each, size in zip(ranges, sizes, strict=True)))
    assert named == set(zip(*(part.ravel().tolist() for part in np.broadcast_arrays(*places)), strict=True))


def test_a_chunk_that_was_cut_off_is_refused(tmp_path: Path) -> None:
    path = store(tmp_path, compressors=None)
    chunk = path / "v" / "c" / "1" / "0" / "1"
    chunk.write_bytes(chunk.read_bytes()[:-4])
    with (
        pytest.raises(UsageError, match="chunk 1 has 7 numbers instead of 8") as refused,
        opened(path) as dataset,
    ):
        numbers_of(path, None, "v", dataset.variables["v"], {"t": 1})
    assert "Write or copy it again" in str(refused.value)


def test_an_array_that_differs_from_what_the_store_lists_is_read_by_zarr(tmp_path: Path) -> None:
    path = store(tmp_path, zarr_format=2, compressors=None)
    zarr.consolidate_metadata(path)
    about = path / "v" / ".zarray"
    about.write_text(about.read_text().replace('"<f4"', '"<i4"'))
    with opened(path) as dataset:
        found = numbers_of(path, None, "v", dataset.variables["v"], {})
    np.testing.assert_array_equal(found, VALUES.astype(np.float32))
