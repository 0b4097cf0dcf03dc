"""Read and write picture files: EXR with AOVs and a header, PNG and JPEG.

Files are written atomically: a name holds a whole picture or nothing. OpenEXR writes and reads EXRs, in a
third of the time that OpenImageIO takes for channels of different precision; OpenImageIO does the rest.
"""

from __future__ import annotations

import json
import mmap
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import OpenEXR
import OpenImageIO as oiio
from numpy.typing import NDArray

from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.input_files import copied_to_memory
from flowsculpt.render.base.render_errors import (
    BadInputError,
    CorruptImageError,
    MachineError,
    MissingImageError,
)
from flowsculpt.render.post.exr_names import CRYPTO, ExrAttributes, channels_of
from flowsculpt.render.scene.aovs import AOVS, COMPUTED, COPIES, Pixels, RenderedFrame
from flowsculpt.render.scene.picture_file import last_message
from flowsculpt.render.scene.render_camera import PERSPECTIVE, Projection
from flowsculpt.render.scene.rgb_spaces import REC709, WORKING_SPACES

T = TypeVar("T")

Header = Mapping[str, Any]
Displayed = NDArray[np.uint8] | NDArray[np.uint16]

PREFIX = "flowsculpt:"
_ROWS = {b"\1": 1, b"\3": 16}
"""Rows of a chunk by the compression of an EXR, RLE or ZIP, as its header has it."""

BAND = 64
"""Rows that OpenImageIO reads at a time."""

_STARTS = (b"v/1\x01\2\0\0\0", b"v/1\x01\2\4\0\0")
"""The first bytes of an EXR of one part in scanlines, with short names and with long ones."""

CONVENTION, CHANNELS = "layers", "channels"
"""Header entries of a file with the channel names of another program: that program; the names by layer."""

Compression = Literal["zip", "rle", "piz"]

COMPRESSIONS: Mapping[Compression, Any] = {
    "zip": OpenEXR.ZIP_COMPRESSION,
    "rle": OpenEXR.RLE_COMPRESSION,
    "piz": OpenEXR.PIZ_COMPRESSION,
}


def write_exr(
    path: Path,
    layers: RenderedFrame,
    header: Header,
    precision: Mapping[str, str] | None = None,
    *,
    attributes: ExrAttributes | None = None,
    standard: Mapping[str, str] | None = None,
    convention: str | None = None,
    compression: Compression = "zip",
) -> None:
    """Write a frame's AOVs to one EXR; `header` becomes `flowsculpt:` entries besides the frame's own facts.

    precision   half or float by AOV, where it differs from `AOVS`
    attributes  attributes of the OpenEXR standard; those of its colours are written always
    standard    more entries of the header by their whole names
    convention  channel names, one of `quality.CONVENTIONS`, or None for our own
    compression  zip; rle for the next stage, a fifth larger in a third of the time; piz for arrays that are
                 not pictures, smaller by an eighth

    Header values are JSON: strings, numbers, lists (matrices), dicts. Our own channel names are R, G, B for
    the beauty, A for `alpha`, and otherwise like albedo.R or position.X. Half floats end at 65504: a
    brighter pixel, such as one of the sun's disc, has that value.
    Raises MachineError where the disk is full or the folder cannot be written.
    """
    size = layers.size
    space = WORKING_SPACES[{**layers.facts, **header}.get("working_space", REC709.name)]
    written: dict[str, Any] = {
        "compression": COMPRESSIONS[compression],
        "chromaticities": space.chromaticities,
        "colorInteropID": space.interop_id,
        **(attributes or ExrAttributes()).entries(size),
        **(standard or {}),
    }
    channels: dict[str, NDArray[np.float16] | Pixels] = {}
    names: dict[str, list[str]] = {}
    for layer, array in layers.arrays.items():
        kind, own = _precision(layer, precision or {}), channels_of(layer, array[0, 0].size, convention)
        names[layer] = own.names
        channels |= zip(own.names, _planes(array, kind, own.factor), strict=True)
    named = {CONVENTION: convention, CHANNELS: names} if convention else {}
    for name, value in {**layers.facts, **header, **named}.items():
        written[PREFIX + name] = _encode(name, value)
    content = BytesIO()
    with OpenEXR.File(written, channels) as file:
        file.write(content)
    # No copy, and no `getbuffer`: where the disk refuses it, Python 3.12.1 crashes on collecting that.
    with atomic_write(path) as temporary:
        temporary.write_bytes(content.getvalue())


def _planes(array: Pixels, kind: str, factor: float) -> Iterator[NDArray[np.float16] | Pixels]:
    """Yield the channels (H, W) of a layer, times a factor, as they are stored."""
    from flowsculpt.render.post.half_floats import to_half  # numba, which reading a header does not need

    for plane in np.moveaxis(np.atleast_3d(array), 2, 0):
        values = np.multiply(plane, np.float32(factor), dtype=np.float32, order="C")
        yield to_half(values) if kind == "half" else values


def read_exr(path: Path) -> tuple[RenderedFrame, dict[str, Any]]:
    """Read every pixel; return the frame and its `flowsculpt:` entries, which are also the frame's facts.

    Raises MissingImageError where there is no such file, CorruptImageError where it ends too early or
    is no EXR.
    """

    def read(file: Any, content: Path) -> tuple[RenderedFrame, dict[str, Any]]:
        header, channels = _header(file.spec()), file.spec().channelnames
        convention, named = header.pop(CONVENTION, None), header.pop(CHANNELS, None)
        columns = _columns(channels, named)
        arrays = _openexr_layers(content, channels, columns) or _layers(file, path, columns)
        for layer, indices in columns.items() if convention else ():
            arrays[layer] *= np.float32(channels_of(layer, len(indices), convention).factor)
        return RenderedFrame(arrays, header), header

    return _read_copy(path, read)


def read_header(path: Path) -> dict[str, Any]:
    """Read only the `flowsculpt:` entries. Raises as `read_exr` does."""
    header = _read(path, lambda file, _: _header(file.spec()))
    return header or _read_copy(path, lambda file, _: _header(file.spec()))


def write_png(path: Path, picture: Displayed, header: Header | None = None) -> None:
    """Write display values (H, W, 3) or (H, W, 4), 8 or 16 bits. Raises MachineError."""
    kinds = {np.dtype(np.uint8): oiio.UINT8, np.dtype(np.uint16): oiio.UINT16}
    if picture.ndim != 3 or picture.dtype not in kinds:
        raise BadInputError(f"a PNG cannot hold {picture.dtype} of shape {picture.shape}; quantise it first")
    height, width, channels = picture.shape
    spec = oiio.ImageSpec(width, height, channels, kinds[picture.dtype])
    spec.attribute("oiio:ColorSpace", "srgb_rec709_display")
    for name, value in (header or {}).items():
        spec.attribute(PREFIX + name, _encode(name, value))
    _write(path, "png", spec, np.ascontiguousarray(picture))


def write_jpeg(
    path: Path,
    picture: Displayed,
    header: Header | None = None,
    projection: Projection = PERSPECTIVE,
) -> None:
    """Write display values (H, W, 3) of 8 bits, at high quality and 4:4:4. Raises MachineError.

    A spherical picture has the XMP by which viewers show it as a panorama.
    """
    if picture.ndim != 3 or picture.dtype != np.uint8:
        raise BadInputError(
            f"a JPEG cannot hold {picture.dtype} of shape {picture.shape}; quantise it to 8 bits"
        )
    height, width, channels = picture.shape
    spec = oiio.ImageSpec(width, height, channels, oiio.UINT8)
    spec.attribute("compression", "jpeg:95")
    spec.attribute("jpeg:subsampling", "4:4:4")
    spec.attribute("oiio:ColorSpace", "srgb_rec709_display")
    spec.attribute("ImageDescription", json.dumps(dict(header or {}), sort_keys=True))
    if projection.kind == "spherical":
        for name, value in _panorama(width, height).items():
            spec.attribute(f"GPano:{name}", value)
    _write(path, "jpeg", spec, np.ascontiguousarray(picture))


def write_still(
    path: Path,
    picture: Displayed,
    header: Header | None = None,
    *,
    form: str = "png",
    projection: Projection = PERSPECTIVE,
) -> None:
    """Write display values (H, W, 3) as PNG, of 8 or 16 bits, or as JPEG, of 8 bits. Raises MachineError.

    form        jpeg; all others are PNG
    projection  of the picture: viewers show a spherical JPEG as a panorama
    """
    if form == "jpeg":
        write_jpeg(path, picture, header, projection)
    else:
        write_png(path, picture, header)


def _panorama(width: int, height: int) -> dict[str, str | int]:
    """Return the properties of Google's Photo Sphere XMP for a picture of a whole sphere."""
    return {
        "ProjectionType": "equirectangular",
        "UsePanoramaViewer": "True",
        "FullPanoWidthPixels": width,
        "FullPanoHeightPixels": height,
        "CroppedAreaImageWidthPixels": width,
        "CroppedAreaImageHeightPixels": height,
        "CroppedAreaLeftPixels": 0,
        "CroppedAreaTopPixels": 0,
    }


def jpeg_bytes(picture: NDArray[np.uint8]) -> bytes:
    """Return a JPEG of display values (H, W, 3), for a live page: OpenImageIO writes only files."""
    import imageio.v3 as iio  # takes a moment, and only live pages ask for it

    return iio.imwrite("<bytes>", picture, extension=".jpeg", plugin="pillow", quality=90, subsampling=0)


def read_png(path: Path) -> NDArray[Any]:
    """Read display values (H, W, C), uint8 or uint16 as in the file. Raises as `read_exr` does."""
    spec, pixels = _read(
        path, lambda file, _: (oiio.ImageSpec(file.spec()), _pixels(file, path, file.spec().format))
    )
    return np.asarray(pixels).reshape(spec.height, spec.width, spec.nchannels)


def _precision(layer: str, wanted: Mapping[str, str]) -> str:
    if layer.startswith((CRYPTO, COPIES)):
        return "float"  # IDs are bits, and half floats count to 2048
    known = {**AOVS, **COMPUTED}
    return wanted.get(layer) or (known[layer].precision if layer in known else "half")


def _columns(channels: Sequence[str], named: Mapping[str, list[str]] | None) -> dict[str, list[int]]:
    """Return the places of each layer's channels in a file.

    named  channel names by layer; None where the channels have our own names
    """
    if named is not None:
        return {layer: [channels.index(name) for name in names] for layer, names in named.items()}
    columns: dict[str, list[int]] = {}
    for index, channel in enumerate(channels):
        layer = "alpha" if channel == "A" else channel.rpartition(".")[0] or "beauty"
        columns.setdefault(layer, []).append(index)
    return columns


def _encode(name: str, value: Any) -> str:
    """Return strings as they are, the rest as JSON; a string that would parse as JSON is quoted."""
    try:
        if isinstance(value, str):
            plain = value != "" and _decoded(value) == value  # OpenImageIO drops empty ones
            return value if plain else json.dumps(value)
        return json.dumps(value, allow_nan=False)
    except (TypeError, ValueError):
        raise BadInputError(f"header entry {name!r} is {value!r}; it must be a JSON value") from None


def _decoded(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


def _header(spec: Any) -> dict[str, Any]:
    return {
        entry.name.removeprefix(PREFIX): _decoded(str(entry.value))
        for entry in spec.extra_attribs
        if entry.name.startswith(PREFIX)
    }


def _read(path: Path, read: Callable[[Any, Path], T]) -> T:
    """Return what `read` returns of an opened picture and its file; where that fails, of a copy in memory."""
    if not path.is_file():
        raise MissingImageError(f"{path}: picture not found")
    try:
        with _opened(path, path) as file:
            return read(file, path)
    except CorruptImageError:
        return _read_copy(path, read)


def _read_copy(path: Path, read: Callable[[Any, Path], T]) -> T:
    """Return what `read` returns of a copy in memory.

    OpenEXR leaves entries of a header out, without a word, where a read of it is interrupted.
    """
    if not path.is_file():
        raise MissingImageError(f"{path}: picture not found")
    try:
        with copied_to_memory(path) as copy, _opened(copy, path) as file:
            return read(file, copy)
    except OSError as error:
        raise MachineError.of_path(path, error, "read") from error


@contextmanager
def _opened(content: Path, path: Path) -> Iterator[Any]:
    """Open what holds the content of `path`."""
    file = oiio.ImageInput.open(str(content))
    if file is None:
        raise CorruptImageError(f"{path}: cannot be opened ({last_message(oiio)}); make it again")
    try:
        yield file
    finally:
        file.close()


def _pixels(file: Any, path: Path, kind: Any) -> Any:
    """Return all channels of an opened picture."""
    return _whole(file.read_image(0, 0, 0, file.spec().nchannels, kind), file, path)


def _whole(pixels: Any, file: Any, path: Path) -> Any:
    """Return what was read of an opened picture. Raises CorruptImageError where that failed."""
    if pixels is None:
        raise CorruptImageError(f"{path}: cannot be read to its end ({last_message(file)}); make it again")
    return pixels


def _openexr_layers(
    content: Path, channels: Sequence[str], columns: Mapping[str, list[int]]
) -> dict[str, Pixels] | None:
    """Return the layers of an EXR, or None where OpenImageIO has to read it or to say what is wrong with it.

    columns  the places in `channels` of each layer's channels
    """
    if not _has_all_chunks(content):
        return None
    try:
        with OpenEXR.File(str(content), separate_channels=True) as file:
            planes = {name: channel.pixels for name, channel in file.channels().items()}
        return {name: _join([planes.pop(channels[i]) for i in places]) for name, places in columns.items()}
    except (KeyError, RuntimeError, ValueError):
        return None


def _join(planes: Sequence[NDArray[Any]]) -> Pixels:
    """Return the channels (H, W) of a layer as one array, float32."""
    from flowsculpt.render.post.half_floats import (
        fill_from_half,  # numba, which reading a header does not need
    )

    joined = np.empty((*planes[0].shape, len(planes)), np.float32)
    for place, plane in enumerate(planes):
        if plane.dtype == np.float16:
            fill_from_half(joined, place, plane)
        else:
            joined[..., place] = plane
    return joined if len(planes) > 1 else joined[..., 0]


def _has_all_chunks(content: Path) -> bool:
    """Tell whether an EXR that RLE or ZIP compressed ends where its last chunk does.

    OpenEXR prints what it finds wrong with a truncated file.
    Source: https://openexr.com/en/latest/OpenEXRFileLayout.html
    """
    with (
        suppress(LookupError, OSError, ValueError, struct.error),
        content.open("rb") as file,
        mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data,
    ):
        at, attributes = len(_STARTS[0]), dict[bytes, bytes]()
        while data[at]:
            kind = data.find(b"\0", at) + 1
            first = data.find(b"\0", kind) + 5
            (size,) = struct.unpack_from("<I", data, first - 4)
            attributes[data[at : kind - 1]], at = data[first : first + size], first + size
        _, top, _, bottom = struct.unpack("<4i", attributes[b"dataWindow"])
        chunks = range(top, bottom + 1, _ROWS[attributes[b"compression"]])
        places = struct.unpack_from(f"<{len(chunks)}Q", data, at + 1)
        ends = [place + 8 + struct.unpack_from("<i", data, place + 4)[0] for place in places]
        return data[:8] in _STARTS and [at + 1 + 8 * len(places), *ends] == [*places, len(data)]
    return False


def _layers(file: Any, path: Path, columns: Mapping[str, list[int]]) -> dict[str, Pixels]:
    """Return the layers of an opened picture. They are taken apart in bands, so that no pixel is held twice.

    columns  the places of each layer's channels in the file
    """
    spec = file.spec()
    shapes = {layer: (len(places),) if len(places) > 1 else () for layer, places in columns.items()}
    arrays = {
        layer: np.empty((spec.height, spec.width, *shape), np.float32) for layer, shape in shapes.items()
    }
    for first in range(0, spec.height, BAND):
        last = min(first + BAND, spec.height)
        band = file.read_scanlines(spec.y + first, spec.y + last, 0, 0, spec.nchannels, oiio.FLOAT)
        for layer, places in columns.items():
            part = arrays[layer][first:last]
            part[...] = _whole(band, file, path)[..., places].reshape(part.shape)
    return arrays


def _write(path: Path, kind: str, spec: Any, pixels: NDArray[Any]) -> None:
    with atomic_write(path) as temporary:
        output: Any = oiio.ImageOutput.create(kind)
        written = output.open(str(temporary), spec) and output.write_image(pixels)
        reason = "" if written else last_message(output)
        if not (output.close() and written):
            raise MachineError.of_draft(path, temporary, reason or last_message(output))
        _check_whole(temporary, path)


def _check_whole(temporary: Path, path: Path) -> None:
    """Read the file back: the PNG writer does not notice a full disk."""
    try:
        _read(temporary, lambda file, _: _pixels(file, path, oiio.UNKNOWN))
    except (CorruptImageError, MissingImageError) as error:
        reason = str(error).removeprefix(f"{path}: ").removesuffix("; make it again")
        raise MachineError.of_draft(path, temporary, f"the written file {reason}") from error
