"""Pictures on disk are whole or absent, and say what they are."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.render.base.render_errors import (
    BadInputError,
    CorruptImageError,
    MachineError,
    MissingImageError,
)
from flowsculpt.render.graphics.typesetting import lettering
from flowsculpt.render.post.image import (
    COMPRESSIONS,
    Compression,
    read_exr,
    read_header,
    read_png,
    write_exr,
    write_png,
)
from flowsculpt.render.scene.aovs import RenderedFrame
from tests.full_disk import disk_of


@pytest.fixture
def layers() -> RenderedFrame:
    rng = np.random.default_rng(3)
    shapes = {"beauty": 3, "albedo": 3, "normal": 3, "position": 3, "depth": 0, "matte": 0}
    arrays = {
        name: rng.random((18, 32, count) if count else (18, 32), dtype=np.float32)
        for name, count in shapes.items()
    }
    return RenderedFrame(arrays, {"seed": 7, "variant": "llvm_ad_rgb"})


def test_layers_come_back_as_they_were(layers: RenderedFrame, tmp_path: Path) -> None:
    write_exr(tmp_path / "a.0001.exr", layers, {})
    again, _ = read_exr(tmp_path / "a.0001.exr")
    assert set(again.arrays) == set(layers.arrays)
    for name, array in layers.arrays.items():
        assert again[name].shape == array.shape
        exact = name in ("position", "depth")
        assert np.array_equal(again[name], array if exact else array.astype(np.float16).astype(np.float32))


def test_a_file_of_half_floats_alone_holds_half_floats(tmp_path: Path) -> None:
    light = np.full((2, 3, 3), 0.1, np.float32)
    write_exr(tmp_path / "a.exr", RenderedFrame({"beauty": light}), {})
    assert np.array_equal(read_exr(tmp_path / "a.exr")[0]["beauty"], light.astype(np.float16))


def test_light_too_bright_for_half_floats_is_finite_in_the_file(
    layers: RenderedFrame, tmp_path: Path
) -> None:
    """The sun's disc has 1.3e5; half floats end at 65504, and Inf would spoil whatever reads the picture."""
    layers["beauty"][0, 0] = (1.3e5, 7e4, 3.0)
    write_exr(tmp_path / "a.0001.exr", layers, {})
    again, _ = read_exr(tmp_path / "a.0001.exr")
    assert again["beauty"][0, 0].tolist() == [65504.0, 65504.0, 3.0]


def test_the_header_comes_back_with_types_and_precision(layers: RenderedFrame, tmp_path: Path) -> None:
    header: dict[str, Any] = {
        "key": "9f03ab",
        "number_like": "12",
        "nothing_like": "null",
        "frame": 12,
        "shutter": 0.1,
        "matrix": [[1.0, 0.0, 1 / 3, 0.0], [0.0, 1e-300, 0.0, 2.0]],
        "camera": {"origin": [0.0, 1.0, 2.5], "field_of_view": 0.4537856055185257},
        "denoised": True,
        "title": "Größe, “quoted” ✓",
    }
    write_exr(tmp_path / "a.exr", layers, header)
    assert read_header(tmp_path / "a.exr") == {**layers.facts, **header}
    assert read_exr(tmp_path / "a.exr")[0].facts == {**layers.facts, **header}


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(
    st.dictionaries(
        st.text("abc_", min_size=1, max_size=6),
        st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20),
        max_size=3,
    )
)
def test_any_text_survives_the_header(
    tmp_path_factory: pytest.TempPathFactory, header: dict[str, str]
) -> None:
    path = tmp_path_factory.mktemp("headers") / "a.exr"
    write_exr(path, RenderedFrame({"beauty": np.zeros((2, 2, 3), np.float32)}), header)
    assert read_header(path) == header


@pytest.mark.parametrize("value", [float("nan"), object(), {1, 2}])
def test_a_value_that_json_cannot_say_is_refused(value: Any, layers: RenderedFrame, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="'odd'"):
        write_exr(tmp_path / "a.exr", layers, {"odd": value})


@pytest.mark.slow
def test_the_same_picture_is_the_same_file_whenever_it_is_written(
    layers: RenderedFrame, tmp_path: Path
) -> None:
    for name in ("a.exr", "b.exr"):
        write_exr(tmp_path / name, layers, {"frame": 1})
        time.sleep(1.01)  # headers tell seconds
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("share", [0.99, 0.5, 0.01])
def test_a_truncated_picture_is_reported_in_one_line(
    share: float,
    compression: Compression,
    layers: RenderedFrame,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "a.0007.exr"
    write_exr(path, layers, {}, compression=compression)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(CorruptImageError, match=r"a\.0007\.exr") as raised:
        read_exr(path)
    assert raised.value.exit_code == 1
    assert "\n" not in str(raised.value)
    assert not "".join(capfd.readouterr())


def test_a_picture_with_a_changed_byte_is_reported(layers: RenderedFrame, tmp_path: Path) -> None:
    path = tmp_path / "a.0007.exr"
    write_exr(path, layers, {})
    content = bytearray(path.read_bytes())
    content[-100] ^= 0x10
    path.write_bytes(content)
    with pytest.raises(CorruptImageError, match="cannot be read to its end"):
        read_exr(path)


def test_a_picture_holds_the_same_by_any_compression(layers: RenderedFrame, tmp_path: Path) -> None:
    read = []
    for compression in COMPRESSIONS:
        write_exr(path := tmp_path / f"{compression}.exr", layers, {"frame": 3}, compression=compression)
        read.append(read_exr(path))
    finished, header = read[0]
    for raw, raw_header in read[1:]:
        assert raw_header == header and raw.arrays.keys() == finished.arrays.keys()
        assert all(np.array_equal(raw[name], finished[name]) for name in finished.arrays)


def test_pictures_of_other_programs_are_read(tmp_path: Path) -> None:
    """Their compression may be any, and what they store below or above may not be ours."""
    light = np.random.default_rng(3).random((37, 20, 3), dtype=np.float32)
    for number, compression in enumerate(("none", "zips", "piz", "zip")):
        spec = oiio.ImageSpec(20, 37, 3, oiio.FLOAT)
        spec.attribute("compression", compression)
        output = oiio.ImageOutput.create("exr")
        assert output.open(str(tmp_path / f"{number}.exr"), spec) and output.write_image(light)
        output.close()
        assert np.array_equal(read_exr(tmp_path / f"{number}.exr")[0]["beauty"], light)


def test_a_file_that_is_no_picture_is_reported(tmp_path: Path) -> None:
    (tmp_path / "a.exr").write_text("not a picture")
    for read in (read_exr, read_header, read_png):
        with pytest.raises(CorruptImageError):
            read(tmp_path / "a.exr")


def test_a_missing_picture_is_reported(tmp_path: Path) -> None:
    with pytest.raises(MissingImageError) as raised:
        read_exr(tmp_path / "none.exr")
    assert raised.value.exit_code == 3


@pytest.mark.parametrize("name", ["a.exr", "a.png"])
def test_a_full_disk_is_reported_and_keeps_the_old_picture(
    name: str, layers: RenderedFrame, tmp_path: Path
) -> None:
    path = tmp_path / name

    def write() -> None:
        if name.endswith(".exr"):
            write_exr(path, layers, {})
        else:
            write_png(path, (layers["beauty"] * 255).astype(np.uint8))

    write()
    before = path.read_bytes()
    with disk_of(700), pytest.raises(MachineError, match="larger than this process may write") as raised:
        write()
    assert raised.value.exit_code == 4
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_a_folder_that_cannot_be_made_is_reported(layers: RenderedFrame, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(MachineError, match="cannot be written"):
        write_exr(tmp_path / "file" / "a.exr", layers, {})


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_display_values_come_back_as_they_were(kind: type, tmp_path: Path) -> None:
    values: Any = (
        np.random.default_rng(1).integers(0, np.iinfo(kind).max, (9, 7, 3), endpoint=True).astype(kind)
    )
    write_png(tmp_path / "a.png", values, {"look": "clay"})
    again = read_png(tmp_path / "a.png")
    assert again.dtype == kind
    assert np.array_equal(again, values)


def test_linear_light_is_no_png(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="float32"):
        write_png(tmp_path / "a.png", np.zeros((2, 2, 3), np.float32))  # type: ignore[arg-type]


def test_lettering_grows_with_spacing_and_knows_its_fonts() -> None:
    tight, wide = lettering("FLOW", "DroidSans", 20), lettering("FLOW", "DroidSans", 20, spacing=0.5)
    assert wide.shape[1] - tight.shape[1] == pytest.approx(3 * 10, abs=2)
    assert tight.max() > 0.9
    with pytest.raises(BadInputError, match="NoSuchFont"):
        lettering("FLOW", "NoSuchFont", 20)
