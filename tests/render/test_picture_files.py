"""Pictures from outside: windows, orientation, layers and colour spaces, and what keys hold of them."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from PIL import Image, ImageCms

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import from_plain, to_plain
from flowsculpt.render.scene import sky, textures
from flowsculpt.render.scene.rgb_spaces import encoding_of, encoding_of_icc, linear_of_srgb
from flowsculpt.render.scene.sky import Environment, environment_of
from flowsculpt.render.scene.textures import Texture, require_decodable

Floats = np.ndarray[Any, np.dtype[np.floating]]

H, W = 8, 16
PICTURE = np.random.default_rng(1).uniform(0.1, 0.9, (H, W, 3)).astype(np.float32)
FLAT = np.broadcast_to(np.float32([0.5, 0.25, 0.125]), (H, W, 3))

AP1 = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
P3 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290)
XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0 / 3.0, 1.0 / 3.0)
REC709 = (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, 0.3127, 0.3290)
ADOBE = (0.640, 0.330, 0.210, 0.710, 0.150, 0.060, 0.3127, 0.3290)


@pytest.fixture(autouse=True)
def _unchecked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare the process that decodes each file once; `test_a_picture_is_tried…` has it."""
    for module in (textures, sky):
        monkeypatch.setattr(module, "require_decodable", lambda path, digest: None)


def spec_of(
    channels: Sequence[str] = "RGB", kind: str = "float", size: tuple[int, int] = (W, H), **facts: Any
) -> oiio.ImageSpec:
    spec = oiio.ImageSpec(*size, len(channels), kind)
    spec.channelnames = tuple(channels)
    for name, value in facts.items():
        name = name.replace("__", ":")
        if isinstance(value, tuple):
            text = isinstance(value[0], str)
            spec.attribute(name, f"{'string' if text else 'float'}[{len(value)}]", value)
        else:
            spec.attribute(name, value)
    return spec


def write(path: Path, *parts: tuple[oiio.ImageSpec, Floats]) -> Path:
    output = oiio.ImageOutput.create(str(path))
    specs = tuple(spec for spec, _ in parts)
    assert output.open(str(path), specs if len(specs) > 1 else specs[0]), output.geterror()
    for index, (spec, pixels) in enumerate(parts):
        assert not index or output.open(str(path), spec, "AppendSubimage"), output.geterror()
        assert output.write_image(np.ascontiguousarray(pixels, np.float32)), output.geterror()
    output.close()
    return path


def texture(path: Path, space: str | None = None) -> Texture:
    return Texture.of(str(path), sha256(path.read_bytes()).hexdigest(), space)


def environment(path: Path) -> Environment:
    return environment_of(str(path), sha256(path.read_bytes()).hexdigest())


def ocio(pixels: Floats, space: str) -> Floats:
    """Linear Rec.709 by OpenColorIO."""
    buffer = oiio.ImageBuf(np.ascontiguousarray(pixels, np.float32))
    done = oiio.ImageBufAlgo.colorconvert(buffer, space, "lin_rec709_scene", colorconfig="ocio://default")
    assert not done.has_error
    return np.asarray(done.get_pixels(oiio.FLOAT))


# Windows


PLACES = [(3, 1), (9, 5), (-4, -2), (-4, 1), (3, -2), (-15, -7)]


@pytest.mark.parametrize(
    ("suffix", "x", "y"),
    [*(("exr", *place) for place in PLACES), *(("tif", *place) for place in PLACES[:2]), ("rla", 3, 1)],
)
def test_the_display_window_is_the_picture(suffix: str, x: int, y: int, tmp_path: Path) -> None:
    spec = spec_of()
    spec.x, spec.y, spec.full_width, spec.full_height = x, y, 12, 6
    found = texture(write(tmp_path / f"a.{suffix}", (spec, PICTURE)))
    around = np.zeros((40, 60, 3), np.float32)
    around[10 + y : 10 + y + H, 20 + x : 20 + x + W] = PICTURE
    assert np.array_equal(found.pixels(), around[10:16, 20:32])
    assert found.reading == "window (0, 0, 12, 6)"


def test_a_display_window_without_pixels_is_refused(tmp_path: Path) -> None:
    spec = spec_of()
    spec.x = 50
    spec.full_x, spec.full_width, spec.full_height = 0, 20, 6
    with pytest.raises(BadInputError, match="its display window is empty"):
        texture(write(tmp_path / "a.exr", (spec, PICTURE)))


def test_a_place_on_a_page_is_no_window(tmp_path: Path) -> None:
    spec = spec_of(kind="uint8")
    spec.x, spec.y = 3, 2
    for name in ("a.tif", "a.png"):
        found = texture(write(tmp_path / name, (spec, PICTURE)), "data")
        assert found.pixels() == pytest.approx(PICTURE, abs=0.003) and not found.reading


# Orientation


def stored(upright: Floats, orientation: int) -> Floats:
    """Pixels that a program shows as `upright`, by the words of EXIF on the first row and column."""
    row, column = {
        1: ("top", "left"), 2: ("top", "right"), 3: ("bottom", "right"), 4: ("bottom", "left"),
        5: ("left", "top"), 6: ("right", "top"), 7: ("right", "bottom"), 8: ("left", "bottom"),
    }[orientation]  # fmt: skip
    turned = upright if row in ("top", "bottom") else upright.transpose(1, 0, 2)
    turned = turned[::-1] if row in ("bottom", "right") else turned
    return turned[:, ::-1] if column in ("bottom", "right") else turned


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("name", ["a.jpg", "a.tif", "a.png", "a.exr", "a.webp"])
@pytest.mark.parametrize("space", [None, "data"])
def test_a_picture_is_upright(name: str, orientation: int, space: str | None, tmp_path: Path) -> None:
    upright = np.zeros((16, 32, 3), np.float32)
    upright[:8, :16], upright[:8, 16:], upright[8:, :16] = 1.0, (0, 0, 1), (0, 1, 0)
    pixels = np.ascontiguousarray(stored(upright, orientation))
    if name == "a.webp":
        exif = Image.Exif()
        exif[0x112] = orientation
        Image.fromarray((255 * pixels).astype(np.uint8)).save(tmp_path / name, exif=exif, lossless=True)
    else:
        size = pixels.shape[1], pixels.shape[0]
        spec = spec_of(kind="half" if name == "a.exr" else "uint8", size=size, Orientation=orientation)
        spec.attribute("compression", "jpeg:100" if name == "a.jpg" else "zip")
        spec.attribute("jpeg:subsampling", "4:4:4")
        write(tmp_path / name, (spec, pixels))
    found = texture(tmp_path / name, space)
    assert found.pixels() == pytest.approx(upright, abs=0.02)
    assert found.reading == ("" if orientation == 1 else f"orientation {orientation}")


def radiance(path: Path, upright: Floats, sizes: str, *lines: str) -> Path:
    """Write a Radiance picture, uncompressed; `sizes` is its last line of text, such as `-Y 8 +X 16`."""
    pixels = upright[::-1] if "+Y" in sizes else upright
    pixels = pixels[:, ::-1] if "-X" in sizes else pixels
    pixels = pixels if "Y" in sizes[:2] else pixels.transpose(1, 0, 2)
    exponent = np.ceil(np.log2(pixels.max(axis=2, keepdims=True))) + 1
    mantissa = np.round(pixels / 2.0**exponent * 256.0)
    body = np.concatenate([mantissa, exponent + 128], axis=2).astype(np.uint8).tobytes()
    head = "\n".join(["#?RADIANCE", *lines, "FORMAT=32-bit_rle_rgbe", "", sizes, ""])
    path.write_bytes(head.encode() + body)
    return path


SIGNS = [(y, x) for y in "-+" for x in "-+"]


@pytest.mark.parametrize(
    "sizes", [*(f"{y}Y 4 {x}X 7" for y, x in SIGNS), *(f"{x}X 7 {y}Y 4" for y, x in SIGNS)]
)
def test_a_radiance_picture_is_upright_by_its_axes(sizes: str, tmp_path: Path) -> None:
    upright = PICTURE[:4, :7]
    found = texture(radiance(tmp_path / "a.hdr", upright, sizes))
    assert found.pixels() == pytest.approx(upright, abs=0.004)
    assert bool(found.reading) == (sizes != "-Y 4 +X 7")


# Layers and parts


def layered(layers: Sequence[str], meant: str) -> tuple[oiio.ImageSpec, Floats]:
    """A part with channels of layers, each of another grey; those of `meant` hold the picture."""
    spec = spec_of(layers)
    pixels = np.empty((H, W, len(layers)), np.float32)
    pixels[...] = np.linspace(0.0, 0.05, len(layers))
    for channel, place in zip("RGB", range(3), strict=True):
        for index, name in enumerate(layers):
            prefix, _, suffix = name.rpartition(".")
            if prefix == meant and suffix.upper() in (channel, "XYZ"[place], ("RED", "GREEN", "BLUE")[place]):
                pixels[..., index] = PICTURE[..., place]
    return spec, pixels


def rgb(*layers: str) -> list[str]:
    return [f"{layer}.{channel}".lstrip(".") for layer in layers for channel in "RGB"]


@pytest.mark.parametrize(
    ("channels", "meant"),
    [
        ([*rgb("A.albedo", ""), "A", "Z"], ""),
        ([*rgb("ViewLayer.Combined"), "ViewLayer.Combined.A", "ViewLayer.Depth.Z", *rgb("V.DiffCol")],
         "ViewLayer.Combined"),
        ([*rgb("One.Combined", "Composite.Combined", "Two.Combined")], "Composite.Combined"),
        ([*rgb("albedo", "beauty"), "N.X", "N.Y", "N.Z"], "beauty"),
        (["C.r", "C.g", "C.b", "Cd.r", "Cd.g", "Cd.b"], "C"),
        ([*rgb("albedo", "diffuse_direct", "diffuse")], "diffuse"),
        (["Z", "any.red", "any.green", "any.blue", "N.X", "N.Y", "N.Z"], "any"),
        (["N.X", "N.Y", "N.Z"], "N"),
        ([*rgb("left", "right")], "left"),
        ([*rgb("left.albedo", "left.beauty", "right.albedo", "right.beauty")], "left.beauty"),
        (["R", "G", "B", *rgb("right")], ""),
    ],
)  # fmt: skip
def test_the_beauty_is_the_picture(channels: list[str], meant: str, tmp_path: Path) -> None:
    found = texture(write(tmp_path / "a.exr", layered(channels, meant)))
    assert np.array_equal(found.pixels(), PICTURE)


@pytest.mark.parametrize(
    ("parts", "meant"),
    [
        ([("albedo", "", "RGB"), ("rgba", "", "RGBA"), ("depth", "", "Z")], 1),
        ([("N", "", ["N.X", "N.Y", "N.Z"]), ("beauty", "", rgb("beauty"))], 1),
        ([("rgba.right", "right", "RGB"), ("rgba.left", "left", "RGB")], 1),
        ([("a", "main", "RGB"), ("b", "other", "RGB")], 0),
        ([("depth", "", "Z"), ("L.Combined", "", rgb("L.Combined"))], 1),
        ([("depth", "", "Z"), ("Part 2", "", "RGB")], 1),
    ],
)
def test_the_part_of_the_beauty_is_the_picture(
    parts: list[tuple[str, str, Sequence[str]]], meant: int, tmp_path: Path
) -> None:
    written = []
    for index, (name, view, channels) in enumerate(parts):
        spec = spec_of(channels, oiio__subimagename=name, **({"view": view} if view else {}))
        pixels = np.full((H, W, len(channels)), 0.05, np.float32)
        if index == meant:
            pixels[..., :3] = PICTURE
        written.append((spec, pixels))
    found = texture(write(tmp_path / "a.exr", *written))
    assert np.array_equal(found.pixels(), PICTURE) and bool(found.reading) == (meant > 0)


@pytest.mark.parametrize(
    ("channels", "names"),
    [
        (rgb("albedo2", "spec"), "albedo2, spec"),
        (rgb("one.beauty", "two.beauty"), "one.beauty, two.beauty"),
        (["Y", "RY", "BY"], "luminance and chroma"),
        (["mask.A", "depth.Z", "id.Y", "id2.Y"], "mask, depth, id, id2"),
        (["A", "Z", "ZBack"], "a/z/zback"),
        (["U", "V"], "u/v"),
        (["R", "G"], "r/g"),
    ],
)
def test_layers_among_which_none_is_meant_are_listed(channels: list[str], names: str, tmp_path: Path) -> None:
    with pytest.raises(BadInputError) as caught:
        texture(write(tmp_path / "a.exr", layered(channels, "")))
    assert all(name in str(caught.value) for name in names.split(", "))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    "channels",
    [["Y"], ["Y", "A"], ["Z"], ["Z", "A"], ["A"], ["mask.A"], ["Y", "A", "Z", "N.X", "N.Y", "N.Z"]],
)
def test_one_channel_of_an_exr_is_grey(channels: list[str], tmp_path: Path) -> None:
    pixels = np.full((H, W, len(channels)), 0.05, np.float32)
    pixels[..., 0] = 0.75
    found = texture(write(tmp_path / "a.exr", (spec_of(channels), pixels)))
    assert (found.pixels() == 0.75).all() and bool(found.reading) == (
        len(channels) > 2 or channels == ["Z", "A"]
    )


def test_deep_pixels_are_refused(tmp_path: Path) -> None:
    spec, deep = spec_of(kind="half"), oiio.DeepData()
    spec.deep = True
    deep.init(H * W, 3, (oiio.TypeDesc("half"),) * 3, tuple("RGB"))
    output = oiio.ImageOutput.create("a.exr")
    assert output.open(str(tmp_path / "a.exr"), spec) and output.write_deep_image(deep)
    output.close()
    with pytest.raises(BadInputError, match="deep pixels; flatten it"):
        texture(tmp_path / "a.exr")


def test_the_first_page_or_frame_is_the_picture(tmp_path: Path) -> None:
    pages = [Image.new("RGB", (W, H), colour) for colour in ((255, 0, 0), (0, 255, 0))]
    for name in ("a.tif", "a.gif"):
        pages[0].save(tmp_path / name, save_all=True, append_images=pages[1:])
        found = texture(tmp_path / name)
        assert (found.pixels() == np.float32([1, 0, 0])).all() and not found.reading


@pytest.mark.parametrize("progressive", [False, True])
def test_a_jpeg_that_ends_early_is_refused_and_one_with_more_bytes_is_read(
    progressive: bool, tmp_path: Path
) -> None:
    pixels = np.random.default_rng(1).integers(0, 255, (64, 64, 3), np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.jpg", progressive=progressive)
    whole = (tmp_path / "a.jpg").read_bytes()
    (tmp_path / "cut.jpg").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(BadInputError, match=r"cut\.jpg: it cannot be read to its end \(.*[Pp]remature end"):
        texture(tmp_path / "cut.jpg")
    (tmp_path / "more.jpg").write_bytes(whole[:-2] + b"\0\0\0" + whole[-2:] + b"trailer")
    assert np.array_equal(texture(tmp_path / "more.jpg").pixels(), texture(tmp_path / "a.jpg").pixels())


def test_a_mipmapped_file_is_read_at_its_full_size(tmp_path: Path) -> None:
    source = oiio.ImageBuf(np.ascontiguousarray(PICTURE))
    for name in ("a.tx", "a.exr"):
        assert oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, source, str(tmp_path / name))
        found = texture(tmp_path / name)
        assert found.pixels() == pytest.approx(PICTURE, abs=1e-3) and not found.reading


# Colour spaces


def png(path: Path, *chunks: tuple[bytes, bytes], value: int = 128, grey: bool = False) -> Path:
    """Write a PNG of one colour with chunks before its pixels."""

    def chunk(name: bytes, content: bytes) -> bytes:
        return (
            struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
        )

    row = b"\0" + bytes([value, value // 2, value // 4][: 1 if grey else 3]) * W
    head = struct.pack(">IIBBBBB", W, H, 8, 0 if grey else 2, 0, 0, 0)
    parts = [(b"IHDR", head), *chunks, (b"IDAT", zlib.compress(row * H)), (b"IEND", b"")]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts))
    return path


def chrm(primaries: Sequence[float]) -> bytes:
    """The chunk of chromaticities, white first."""
    return struct.pack(">8I", *(round(1e5 * value) for value in (*primaries[6:], *primaries[:6])))


def icc(primaries: Sequence[float], curve: bytes, kind: bytes = b"RGB ", name: str = "made") -> bytes:
    """An ICC profile of chromaticities (under D65) and one curve."""
    encoding, srgb = encoding_of(primaries), ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).profile
    assert encoding is not None
    colorants = [getattr(srgb, f"{colour}_colorant")[0] for colour in ("red", "green", "blue")]
    columns = np.array(colorants).T @ encoding.matrix

    def xyz(values: Floats) -> bytes:
        return b"XYZ \0\0\0\0" + struct.pack(">3i", *np.round(65536 * values).astype(int))

    words = b"desc\0\0\0\0" + struct.pack(">I", len(name) + 1) + name.encode() + bytes(79)
    tags = {b"desc": words, b"wtpt": xyz(np.array([0.9642, 1.0, 0.8249]))}
    if kind == b"GRAY":
        tags[b"kTRC"] = curve
    else:
        tags |= {b"%cXYZ" % "rgb"[i].encode(): xyz(columns[:, i]) for i in range(3)}
        tags |= {b"%cTRC" % letter.encode(): curve for letter in "rgb"}
    table, body = struct.pack(">I", len(tags)), b""
    for tag, content in tags.items():
        content += bytes(-len(content) % 4)
        table += struct.pack(">4sII", tag, 132 + 12 * len(tags) + len(body), len(content))
        body += content
    size = 128 + len(table) + len(body)
    head = struct.pack(">I4sI4s4s4s", size, b"\0" * 4, 0x02400000, b"mntr", kind, b"XYZ ") + bytes(12)
    head += b"acsp" + bytes(28) + struct.pack(">3i", 63190, 65536, 54061) + bytes(48)
    return head + table + body


def gamma(exponent: float) -> bytes:
    return b"curv\0\0\0\0" + struct.pack(">IH", 1, round(256 * exponent)) + b"\0\0"


SRGB_CURVE = b"para\0\0\0\0\0\3\0\0" + struct.pack(
    ">5i", *(round(65536 * v) for v in (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045))
)
TABLE = b"curv\0\0\0\0" + struct.pack(
    ">I1024H", 1024, *np.round(65535 * np.linspace(0, 1, 1024) ** 1.8).astype(int)
)


@pytest.mark.parametrize(
    ("facts", "space"),
    [
        ({"chromaticities": AP1}, "lin_ap1_scene"),
        ({"chromaticities": P3}, "lin_p3d65_scene"),
        ({"chromaticities": ADOBE}, "lin_adobergb_scene"),
        ({"colorInteropID": "lin_ap1_scene"}, "lin_ap1_scene"),
        ({"colorInteropID": "srgb_p3d65_scene"}, "srgb_p3d65_scene"),
        ({"colorInteropID": "g22_rec709_scene", "chromaticities": AP1}, "g22_rec709_scene"),
        ({"colorInteropID": "unknown", "chromaticities": AP1}, "lin_ap1_scene"),
        ({"colorInteropID": "show:own", "chromaticities": AP1}, "lin_ap1_scene"),
        ({"acesImageContainerFlag": 1, "compression": "none"}, "lin_ap0_scene"),
    ],
)
def test_colours_of_an_exr_are_those_of_its_space(facts: dict[str, Any], space: str, tmp_path: Path) -> None:
    path = write(tmp_path / "a.exr", (spec_of(kind="half", **facts), FLAT))
    found, plain = texture(path), texture(path, "data")
    assert found.pixels() == pytest.approx(np.clip(ocio(FLAT, space), 0.0, 1.0), abs=2e-4)
    assert np.array_equal(plain.pixels(), FLAT)
    assert found.reading and not plain.reading


def test_tristimulus_values_become_colours(tmp_path: Path) -> None:
    path = write(tmp_path / "a.exr", (spec_of(chromaticities=XYZ), np.full((H, W, 3), 0.5)))
    assert texture(path).pixels() == pytest.approx(np.full((H, W, 3), 0.5), abs=1e-6), "equal energy is white"


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"colorInteropID": "show:own"}, "its colour space show:own is not in OpenColorIO's"),
        ({"chromaticities": (0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3)}, "chromaticities span no colours"),
        ({"chromaticities": (0.6, 0.3, 0.3, 0.6, 0.1, 0.1, 0.3, 0.0)}, "chromaticities span no colours"),
    ],
)
def test_spaces_that_cannot_be_converted_are_refused(
    facts: dict[str, Any], message: str, tmp_path: Path
) -> None:
    path = write(tmp_path / "a.exr", (spec_of(**facts), FLAT))
    with pytest.raises(BadInputError, match=message):
        texture(path)
    assert np.array_equal(texture(path, "linear").pixels(), FLAT), "the shot's word counts"


@pytest.mark.parametrize("points", [(9, 1), (9, 14), (5, 1), (9, 18)])
def test_code_points_without_a_space_are_refused(points: tuple[int, int], tmp_path: Path) -> None:
    path = png(tmp_path / "a.png", (b"cICP", bytes([*points, 0, 1])))
    with pytest.raises(BadInputError, match="colour space"):
        texture(path)


@pytest.mark.parametrize("points", [(1, 13), (2, 2), (1, 2)])
def test_code_points_that_say_nothing_change_nothing(points: tuple[int, int], tmp_path: Path) -> None:
    found = texture(png(tmp_path / "a.png", (b"cICP", bytes([*points, 0, 1]))))
    assert np.array_equal(found.pixels(), texture(png(tmp_path / "b.png")).pixels()) and not found.reading


def subsampled(path: Path) -> Path:
    """Write an EXR of luminance and chroma of half its size."""

    def attribute(name: str, kind: str, value: bytes) -> bytes:
        return f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value

    channels = b"".join(
        name + struct.pack("<BiB3xii", 0, 1, 0, step, step)
        for name, step in ((b"BY", 2), (b"RY", 2), (b"Y", 1))
    )
    window, rows = struct.pack("<4i", 0, 0, 3, 3), []
    for row in range(4):
        content = np.full(8 if row % 2 == 0 else 4, 0.5, np.float16).tobytes()
        rows.append(struct.pack("<ii", row, len(content)) + content)
    head = b"\x76\x2f\x31\x01\2\0\0\0" + attribute("channels", "chlist", channels + b"\0")
    head += attribute("compression", "compression", b"\0") + attribute("lineOrder", "lineOrder", b"\0")
    head += attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    head += attribute("pixelAspectRatio", "float", struct.pack("<f", 1.0))
    head += attribute("screenWindowCenter", "v2f", bytes(8))
    head += attribute("screenWindowWidth", "float", struct.pack("<f", 1.0)) + b"\0"
    starts = len(head) + 32 + np.cumsum([0, *map(len, rows[:-1])])
    path.write_bytes(head + struct.pack("<4Q", *starts.tolist()) + b"".join(rows))
    return path


def test_pixels_that_openimageio_does_not_decode_have_its_reason(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="Subsampled channels are not supported"):
        texture(subsampled(tmp_path / "a.exr"))
    path = radiance(tmp_path / "a.hdr", PICTURE, f"-Y {H} +X {W}")
    path.write_bytes(path.read_bytes().replace(b"rle_rgbe", b"rle_xyze"))
    with pytest.raises(BadInputError, match=r"cannot be read as a picture \(its pixels are in CIE XYZ\)"):
        texture(path)


def stored_linear(path: Path) -> Floats:
    """Pixels as stored, from 0 to 1."""
    return texture(path, "data").pixels()


@pytest.mark.parametrize(
    ("chunks", "linear"),
    [
        ([(b"gAMA", struct.pack(">I", 100000))], lambda v: v),
        ([(b"gAMA", struct.pack(">I", 55556))], lambda v: v**1.8),
        ([(b"gAMA", struct.pack(">I", 45455)), (b"cHRM", chrm(P3))],
         lambda v: ocio(v, "srgb_p3d65_scene")),
        ([(b"cICP", bytes([12, 13, 0, 1]))], lambda v: ocio(v, "srgb_p3d65_scene")),
        ([(b"cICP", bytes([1, 8, 0, 1])), (b"sRGB", b"\0")], lambda v: v),
        ([(b"iCCP", b"p3\0\0" + zlib.compress(icc(P3, SRGB_CURVE)))], lambda v: ocio(v, "srgb_p3d65_scene")),
    ],
)  # fmt: skip
def test_colours_of_a_png_are_those_of_its_chunks(
    chunks: list[tuple[bytes, bytes]], linear: Callable[[Floats], Floats], tmp_path: Path
) -> None:
    path = png(tmp_path / "a.png", *chunks)
    found = texture(path)
    assert found.pixels() == pytest.approx(np.clip(linear(stored_linear(path)), 0.0, 1.0), abs=1e-3)
    assert found.reading and not texture(path, "data").reading


PROFILES = {
    "Adobe RGB": (icc(ADOBE, gamma(2.2)), lambda v: ocio(v, "g22_adobergb_scene")),
    "Display P3": (icc(P3, SRGB_CURVE), lambda v: ocio(v, "srgb_p3d65_scene")),
    "table": (icc(REC709, TABLE), lambda v: v**1.8),
}


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tif", "a.webp"])
def test_colours_are_those_of_the_profile(profile: str, name: str, tmp_path: Path) -> None:
    content, linear = PROFILES[profile]
    picture = Image.new("RGB", (W, H), (180, 120, 60))
    picture.save(tmp_path / name, icc_profile=content, quality=100)
    found, shown = texture(tmp_path / name), stored_linear(tmp_path / name)
    assert found.pixels() == pytest.approx(np.clip(linear(shown), 0.0, 1.0), abs=2e-3)
    assert found.reading == "profile made"


@pytest.mark.parametrize("primaries", [ADOBE, P3, AP1])
def test_profiles_are_read_as_littlecms_reads_them(primaries: tuple[float, ...], tmp_path: Path) -> None:
    content = icc(primaries, gamma(2.2))
    picture = Image.new("RGB", (W, H), (150, 120, 90))
    srgb = ImageCms.createProfile("sRGB")
    theirs = ImageCms.profileToProfile(picture, ImageCms.ImageCmsProfile(_bytes(content)), srgb, 1)
    assert theirs is not None
    picture.save(tmp_path / "a.png", icc_profile=content)
    theirs_linear = linear_of_srgb(np.asarray(theirs) / 255.0)
    assert texture(tmp_path / "a.png").pixels() == pytest.approx(theirs_linear, abs=0.005)


def _bytes(content: bytes) -> Any:
    import io

    return io.BytesIO(content)


def test_a_profile_of_grey_is_its_curve(tmp_path: Path) -> None:
    picture = Image.new("L", (W, H), 128)
    picture.save(tmp_path / "a.png", icc_profile=icc(REC709, gamma(1.5), b"GRAY"))
    assert texture(tmp_path / "a.png").pixels() == pytest.approx(
        np.full((H, W, 3), (128 / 255) ** 1.5), abs=1e-4
    )


def test_photographs_in_adobe_rgb_by_exif(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA001] = 65535
    exif.get_ifd(0x8769)[0xA005] = {1: "R03"}
    Image.new("RGB", (W, H), (180, 120, 60)).save(tmp_path / "a.jpg", exif=exif, quality=100)
    expected = np.clip(ocio(stored_linear(tmp_path / "a.jpg"), "g22_adobergb_scene"), 0.0, 1.0)
    assert texture(tmp_path / "a.jpg").pixels() == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("damage", [b"", b"\0" * 128, icc(P3, SRGB_CURVE)[:300], icc(P3, b"mft2")])
def test_damaged_profiles_have_one_reason(damage: bytes) -> None:
    with pytest.raises(ValueError, match="its colour profile is"):
        encoding_of_icc(damage)


def test_inks_are_refused(tmp_path: Path) -> None:
    for kind, name in (("CMYK", "a.jpg"), ("CMYK", "a.tif"), ("LAB", "b.tif")):
        Image.new(kind, (W, H)).save(tmp_path / name)
        with pytest.raises(BadInputError, match=rf"its colours are \w*{kind}; write it as RGB"):
            texture(tmp_path / name)


def test_a_profile_that_is_a_table_is_refused_by_its_name(tmp_path: Path) -> None:
    profile = icc(P3, SRGB_CURVE, name="Scanner 9").replace(b"rXYZ", b"A2B0")
    Image.new("RGB", (W, H)).save(tmp_path / "a.png", icc_profile=profile)
    with pytest.raises(
        BadInputError, match=r"is a table, not curves and primaries \(Scanner 9\); write it in"
    ):
        texture(tmp_path / "a.png")
    assert texture(tmp_path / "a.png", "srgb").pixels().max() == 0.0


def test_a_dpx_is_read_by_its_transfer_or_the_shots_word(tmp_path: Path) -> None:
    for transfer, space in (("Linear", "linear"), ("ITU-R 709-4", "srgb")):
        path = write(tmp_path / "a.dpx", (spec_of(kind="uint16", dpx__Transfer=transfer), FLAT))
        assert np.array_equal(texture(path).pixels(), texture(path, space).pixels())
    for transfer in ("Printing density", "Logarithmic", "Undefined"):
        path = write(tmp_path / "a.dpx", (spec_of(kind="uint16", dpx__Transfer=transfer), FLAT))
        with pytest.raises(BadInputError, match=f"its transfer is {transfer}"):
            texture(path)
        assert texture(path, "ACEScct").pixels().shape == (H, W, 3)


def test_exposures_of_a_radiance_picture_are_divided_out(tmp_path: Path) -> None:
    path = radiance(
        tmp_path / "a.hdr", PICTURE, f"-Y {H} +X {W}", "EXPOSURE=2", "EXPOSURE= 2.0", "COLORCORR=1 1 .5"
    )
    expected = np.clip(PICTURE / [4, 4, 2], 0, 1)
    assert texture(path).pixels() == pytest.approx(expected, abs=2e-3)
    plain = radiance(
        tmp_path / "b.hdr", PICTURE, f"-Y {H} +X {W}", "EXPOSURE=1.0", "PRIMARIES=0 0 0 0 0 0 0 0"
    )
    assert texture(plain).pixels() == pytest.approx(PICTURE, abs=0.004) and not texture(plain).reading


def test_primaries_of_a_radiance_picture_are_converted(tmp_path: Path) -> None:
    line = "PRIMARIES= " + " ".join(map(str, P3))
    path = radiance(tmp_path / "a.hdr", PICTURE, f"-Y {H} +X {W}", line)
    expected = np.clip(ocio(stored_linear(path), "lin_p3d65_scene"), 0.0, 1.0)
    assert texture(path).pixels() == pytest.approx(expected, abs=1e-4)


# Keys


def plain_files(folder: Path) -> list[Path]:
    """Files of every kind that needs no interpretation."""
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    picture = Image.new("RGB", (W, H), (180, 120, 60))
    for name in ("profile.jpg", "profile.png", "profile.tif"):
        picture.save(folder / name, icc_profile=srgb)
    for name in ("plain.jpg", "plain.png", "plain.tif", "plain.webp", "plain.bmp", "plain.tga", "plain.gif"):
        picture.save(folder / name)
    rec709 = spec_of(chromaticities=REC709, colorInteropID="lin_rec709_scene")
    return [
        *sorted(folder.iterdir()),
        png(folder / "gamma.png", (b"gAMA", struct.pack(">I", 45455)), (b"cHRM", chrm(REC709))),
        png(folder / "srgb.png", (b"gAMA", struct.pack(">I", 100000)), (b"sRGB", b"\0")),
        write(folder / "sixteen.png", (spec_of(kind="uint16"), PICTURE)),
        write(folder / "float.tif", (spec_of(), PICTURE)),
        write(folder / "half.exr", (spec_of("RGBA", "half"), np.ones((H, W, 4)))),
        write(folder / "rec709.exr", (rec709, PICTURE)),
        write(folder / "zeros.exr", (spec_of(chromaticities=(0.0,) * 8), PICTURE)),
        radiance(folder / "a.hdr", PICTURE, f"-Y {H} +X {W}"),
    ]  # fmt: skip


def test_keys_and_pixels_of_ordinary_pictures_stay(tmp_path: Path) -> None:
    for path in plain_files(tmp_path):
        found, digest = texture(path), sha256(path.read_bytes()).hexdigest()
        assert to_plain(found) == {"digest": digest, "space": None}, path.name
        file = oiio.ImageInput.open(str(path))
        before = file.read_image(0, 0, 0, 3)
        is_float = path.suffix in (".exr", ".hdr") or path.name == "float.tif"
        linear = np.clip(before, 0, 1) if is_float else linear_of_srgb(before)
        assert np.array_equal(found.pixels(), linear.astype(np.float32)), path.name


def test_keys_hold_how_other_pictures_are_read(tmp_path: Path) -> None:
    path = write(tmp_path / "a.exr", (spec_of(chromaticities=AP1, Orientation=3), PICTURE))
    found = texture(path)
    assert to_plain(found)["reading"] == f"orientation 3, chromaticities {tuple(map(float, np.float32(AP1)))}"
    assert to_plain(texture(path, "data")) == {
        "digest": found.digest, "space": "data", "reading": "orientation 3"
    }  # fmt: skip
    assert from_plain(Texture, to_plain(found)).reading == found.reading
    square = np.broadcast_to(np.float32(0.5), (H, 2 * H, 3))
    assert "reading" not in to_plain(environment(write(tmp_path / "b.exr", (spec_of(), square))))


# Environment maps


def test_a_map_is_its_display_window_upright_and_in_its_space(tmp_path: Path) -> None:
    light = 5.0 * PICTURE[:, :16]
    cut = spec_of(size=(W, H - 3), chromaticities=AP1)
    cut.full_width, cut.full_height = W, H
    found = environment(write(tmp_path / "a.exr", (cut, light[:-3])))
    expected = np.maximum(ocio(light, "lin_ap1_scene"), 0.0)
    assert found.pixels()[:-3] == pytest.approx(expected[:-3], abs=2e-3)
    assert (found.pixels()[-3:] == 0.0).all() and found.pixels().shape == (H, W, 3)
    turned = np.ascontiguousarray(stored(light, 6))
    found = environment(write(tmp_path / "b.exr", (spec_of(size=(H, W), Orientation=6), turned)))
    assert np.array_equal(found.pixels(), light) and to_plain(found)["reading"] == "orientation 6"
    spec, pixels = layered([*rgb("albedo", "L.Combined"), "L.Depth.Z"], "L.Combined")
    assert np.array_equal(environment(write(tmp_path / "c.exr", (spec, pixels))).pixels(), PICTURE)


def test_a_map_of_a_wide_gamut_lights_the_working_space_with_its_own_colours(tmp_path: Path) -> None:
    red = np.broadcast_to(np.float32([1.0, 0.0, 0.0]), (H, W, 3))
    path = write(tmp_path / "a.exr", (spec_of(chromaticities=AP1), red))
    found = environment(path)
    assert found.pixels().min() == 0.0
    aces = Environment(found.digest, path=str(path), working_space="acescg")
    assert aces.pixels() == pytest.approx(red, abs=1e-5)


@pytest.mark.parametrize(
    ("name", "spec", "message"),
    [
        ("a.exr", spec_of(size=(4, 24), textureformat="CubeFace Environment"), "it is a cube map"),
        ("a.tif", spec_of(kind="uint16"), "it is in integers, display values; a map of light is linear"),
        ("a.exr", spec_of(colorInteropID="srgb_rec709_scene"), "it is in srgb_rec709_scene; a map of light"),
        ("a.exr", spec_of("YA"), "a picture of 2 channels"),
        ("a.exr", spec_of(size=(12, 8)), "it is 12 × 8 pixels"),
    ],
)
def test_files_that_are_no_map_of_light_are_refused(
    name: str, spec: oiio.ImageSpec, message: str, tmp_path: Path
) -> None:
    pixels = np.full((spec.height, spec.width, spec.nchannels), 0.5, np.float32)
    with pytest.raises(BadInputError, match=message):
        environment(write(tmp_path / name, (oiio.ImageSpec(spec), pixels)))


# The process that decodes a file first


def test_a_picture_is_tried_as_it_is_read(tmp_path: Path) -> None:
    path = write(tmp_path / "a.exr", layered([*rgb("albedo", "beauty")], "beauty"))
    require_decodable(str(path), sha256(path.read_bytes()).hexdigest())
    spec = spec_of()
    spec.full_width = spec.full_height = 12_000
    large = write(tmp_path / "b.exr", (spec, PICTURE))
    with pytest.raises(BadInputError, match="promises a display window of 12000 × 12000 pixels, and it has"):
        require_decodable(str(large), sha256(large.read_bytes()).hexdigest())
    assert textures.MOST_PIXELS > 12_000**2
