"""Files that once crashed, hung or flooded a reader, or could: damaged, hostile, or of no regular kind."""

from __future__ import annotations

import io
import json
import os
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


class PastFailure(NamedTuple):
    """kind: of the reader; fact: what the message says; empty for a file that is read."""

    kind: str
    name: str
    make: Callable[[Path], object]
    fact: str


def _bytes(content: bytes | str) -> Callable[[Path], object]:
    text = content.encode() if isinstance(content, str) else content
    return lambda path: path.write_bytes(text)


def _ply(header: str, body: bytes | str, form: str = "ascii") -> Callable[[Path], object]:
    head = f"ply\nformat {form} 1.0\n{header}\nend_header\n".encode()
    return _bytes(head + (body.encode() if isinstance(body, str) else body))


_VERTICES = "element vertex 3\nproperty float x\nproperty float y\nproperty float z"
_FACES = "element face {}\nproperty list {} int vertex_indices"
_CORNERS = "0 0 0 1 0 0 0 1 0 "


def _npz(**members: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return file.getvalue()


def _npy(shape: tuple[int, ...], content: bytes = b"", dtype: str = "<f8") -> bytes:
    file = io.BytesIO()
    header = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, header)  # type: ignore[arg-type]
    return file.getvalue() + content


_POINTS = _npy((4, 3), np.arange(12.0).tobytes())


def _half_a_gibibyte(path: Path) -> None:
    """Write points beside an array of 512 MiB that nobody asks for."""
    path.write_bytes(_npz(points=_POINTS, other=_npy((1 << 26,), bytes(1 << 29))))


def _fan(count: int) -> str:
    """Return an OBJ of triangles that share one edge."""
    points = "".join(f"v 0 {k} 1\n" for k in range(count))
    return f"v 0 0 0\nv 1 0 0\n{points}" + "".join(f"f 1 2 {k + 3}\n" for k in range(count))


def _polygon(corners: int) -> str:
    at = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    points = "".join(f"v {x:.6f} {y:.6f} 0\n" for x, y in zip(np.cos(at), np.sin(at), strict=True))
    return f"{points}f {' '.join(map(str, range(1, corners + 1)))}\n"


def _glb(scene: dict[str, object], binary: bytes = b"\x00" * 36) -> bytes:
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    chunks = (
        struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(binary)) + b"BIN\x00" + binary
    )
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def _scene(**changes: object) -> bytes:
    return _glb(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
            "bufferViews": [{"buffer": 0, "byteLength": 36}],
            "buffers": [{"byteLength": 36}],
            **changes,
        }
    )


def _png(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")


def _wav(rate: int, channels: int = 1, size: int = 20_000) -> bytes:
    form = struct.pack("<HHIIHH", 1, channels, rate, rate, 2 * channels % (1 << 16), 16)
    body = b"WAVEfmt " + struct.pack("<I", 16) + form + b"data" + struct.pack("<I", size) + bytes(size)
    return b"RIFF" + struct.pack("<I", len(body)) + body


def _vti(extent: str, values: str = "1 1 1", head: str = "") -> str:
    return (
        f'<?xml version="1.0"?>{head}<VTKFile type="ImageData"><ImageData>'
        f'<Piece Extent="{extent}"><PointData>'
        f'<DataArray type="Float64" Name="u" NumberOfComponents="3" format="ascii">{values}</DataArray>'
        "</PointData></Piece></ImageData></VTKFile>"
    )


_LAUGHS = (
    "<!DOCTYPE a [<!ENTITY a0 'ha'>"
    + "".join(f"<!ENTITY a{k + 1} '{f'&a{k};' * 10}'>" for k in range(12))
    + "]>"
)


_DOUBLED = f'<g id="g0">{"<desc/>" * 2000}</g>' + "".join(
    f'<g id="g{n + 1}"><use href="#g{n}"/><use href="#g{n}"/></g>' for n in range(30)
)
_ARC = '<path d="M0 0a5 6 30 9" style="transform-box: fill-box; transform: scale(2)"/>'


def _svg(body: str) -> str:
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">{body}</svg>'


def _usda(body: str, head: str = "") -> str:
    return f'#usda 1.0\n(\n    defaultPrim = "A"\n{head})\n{body}\n'


_MESH = (
    'def Mesh "A" { int[] faceVertexCounts = %s\n int[] faceVertexIndices = %s\n'
    " point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n%s }"
)


def _clips(text: str) -> str:
    return _usda(f'def "A" (\n clips = {{\n {text}\n }}\n) {{ }}')


def _crowd(count: int) -> str:
    """Return a stage of one point instancer whose prototype is no mesh."""
    indices, places = ", ".join("0" * count), ", ".join(["(0, 0, 0)"] * count)
    return _usda(
        'def PointInstancer "A" {\n rel prototypes = </A/s>\n'
        f" int[] protoIndices = [{indices}]\n point3f[] positions = [{places}]\n"
        ' def Sphere "s" { }\n }'
    )


def _doubled_instances(levels: int) -> str:
    """Return a stage whose prims refer twice to the one before, as instances: 2^levels meshes."""
    parts = [_MESH.replace('"A"', '"p0"') % ("[3]", "[0, 1, 2]", "")]
    twice = '\ndef "%s" (\n instanceable = true\n references = </p%d>\n) { }\n'
    for k in range(levels):
        parts.append(f'def Xform "p{k + 1}" {{ {twice % ("a", k)}\n {twice % ("b", k)} }}')
    return _usda("\n".join(parts) + f'\ndef "A" (references = </p{levels}>) {{ }}')


def _usdz(spaces: int) -> bytes:
    """Return a package whose layer, of so many spaces, is compressed, which USD does not allow."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("a.usda", "#usda 1.0\n" + " " * spaces)
    return file.getvalue()


def _with_pipe(path: Path) -> None:
    """Write a stage with a layer that is a named pipe, which nobody ever writes to."""
    os.mkfifo(path.with_name("pipe.usda"))
    path.write_text(_usda('def "A" (references = @./pipe.usda@) { }'))


PAST_FAILURES = (  # one line each, however long
    PastFailure("model", "a.obj", os.mkfifo, "it is a named pipe; it must be a regular file"),
    PastFailure("model", "b.obj", lambda path: path.symlink_to("/dev/zero"), "it is a device"),
    PastFailure("model", "c.obj", lambda path: path.symlink_to("/proc/kmsg"), "the file is empty"),
    PastFailure("model", "d.obj", Path.mkdir, "it is a folder"),
    PastFailure("picture", "a.png", os.mkfifo, "it is a named pipe"),
    PastFailure("sky", "a.exr", lambda path: path.symlink_to("/dev/zero"), "it is a device"),
    PastFailure("sound", "a.wav", lambda path: path.symlink_to("/dev/zero"), "it is a device"),
    PastFailure("field", "a.npz", os.mkfifo, "it is a named pipe"),
    PastFailure("points", "a.xyz", os.mkfifo, "it is a named pipe"),
    PastFailure("flow", "a.py", os.mkfifo, "a named pipe"),
    PastFailure("view", "a.ocio", os.mkfifo, "it is a named pipe"),
    PastFailure(
        "model",
        "rows.ply",
        _ply(f"{_VERTICES}\nelement foo 99999999999\nproperty int a", _CORNERS),
        "its header promises 99999999999 foos, and 0 are there",
    ),
    PastFailure(
        "model",
        "empty_rows.ply",
        _ply(f"{_VERTICES}\nelement foo 99999999999\n{_FACES.format(1, 'uchar')}", _CORNERS + "3 0 1 2"),
        "",
    ),
    PastFailure(
        "model",
        "length.ply",
        _ply(f"{_VERTICES}\n{_FACES.format(2, 'int')}", _CORNERS + "3 0 1 2 -1 0 1 2"),
        "a list of vertex_indices has the length -1",
    ),
    PastFailure(
        "model",
        "binary_length.ply",
        _ply(
            f"{_VERTICES}\n{_FACES.format(2, 'int')}",
            np.eye(3, dtype="<f4").tobytes() + np.array([3, 0, 1, 2, -1, 0, 0], "<i4").tobytes(),
            "binary_little_endian",
        ),
        "a list of vertex_indices has the length -1",
    ),
    PastFailure(
        "model",
        "digits.ply",
        _ply(f"{_VERTICES}\n{_FACES.format(1, 'int')}", "0 " * 20_000 + "1" * 20_000),
        "has 20000 digits",
    ),
    PastFailure(
        "model", "counts.off", _bytes("OFF\n99999999999 -1 0\n0 0 0\n"), "the file is too short for them"
    ),
    PastFailure("model", "damaged.stl", _bytes(b"solid " + bytes(range(256)) * 3), "has no STL header"),
    PastFailure("model", "huge.obj", _bytes(TRIANGLE.replace("v 1", "v 1e300")), "which is too large"),
    PastFailure(
        "model",
        "tiny.obj",
        _bytes("v 0 0 0\nv 1e-300 0 0\nv 0 1e-300 0\nf 1 2 3\n"),
        "all its faces are degenerate",
    ),
    PastFailure("model", "long.obj", _bytes(TRIANGLE + "f " + "9" * 100_000), "line 5"),
    PastFailure("model", "corners.obj", _bytes(_polygon(20_000)), "20000 corners"),
    PastFailure("model", "fan.obj", _bytes(_fan(20_000)), ""),
    PastFailure("points", "shape.npz", _bytes(_npz(points=_npy((1 << 40, 3)))), "and ends before"),
    PastFailure("points", "negative.npz", _bytes(_npz(points=_npy((-1, 3)))), "and ends before"),
    PastFailure(
        "points", "empty.npz", _bytes(_npz(points=_npy((1 << 40, 3), b"", "|S0"))), "and ends before"
    ),
    PastFailure("points", "unread.npz", _half_a_gibibyte, ""),
    PastFailure("points", "space.npz", _bytes(_npz(**{"a\xa0b\n": _POINTS})), r"There are: a\xa0b\n."),
    PastFailure("points", "cut.npz", _bytes(_npz(points=_POINTS)[:-30]), "not a zip file"),
    PastFailure("points", "wide.xyz", _bytes("0 0 " + "1" * 100_000), "not finite"),
    PastFailure("field", "extent.vti", _bytes(_vti("0 300000000 0 0 0 0")), "bytes can hold"),
    PastFailure("field", "laughs.vti", _bytes(_vti("0 0 0 0 0 0", "&a12;", _LAUGHS)), "XML"),
    PastFailure("field", "deep.vti", _bytes("<a>" * 300_000), "XML"),
    PastFailure(
        "scene", "cycle.glb", _bytes(_scene(nodes=[{"mesh": 0, "children": [0]}])), "its own ancestor"
    ),
    PastFailure(
        "scene",
        "count.glb",
        _bytes(_scene(accessors=[{"bufferView": 0, "componentType": 5126, "count": 10**12, "type": "VEC3"}])),
        "cannot be read",
    ),
    PastFailure(
        "scene",
        "no_view.glb",
        _bytes(_scene(accessors=[{"componentType": 5126, "count": 10**9, "type": "VEC3"}])),
        "cannot be read",
    ),
    PastFailure("stage", "pipe_layer.usda", _with_pipe, "pipe.usda: it is a named pipe"),
    PastFailure("stage", "text.usdc", _bytes(_usda(_MESH % ("[3]", "[0, 1, 2]", ""))), "cannot be read"),
    PastFailure("stage", "words.usd", _bytes("a chair"), "cannot be read"),
    PastFailure(
        "stage",
        "missing.usda",
        _bytes(_usda('def "A" (references = @./gone.usda@) { }')),
        "gone.usda: file not found",
    ),
    PastFailure(
        "stage",
        "absolute.usda",
        _bytes(_usda('def "A" (payload = @/proc/kmsg@</root>) { }')),
        "cannot be read",
    ),
    PastFailure(
        "stage",
        "sublayer.usda",
        _bytes(_usda('def "A" { }', "    subLayers = [@/dev/zero@]\n")),
        "it is a device",
    ),
    PastFailure(
        "stage",
        "network.usda",
        _bytes(_usda('def "A" (references = @http://127.0.0.1:9/a.usda@) { }')),
        "file not found",
    ),
    PastFailure(
        "stage", "self.usda", _bytes(_usda('def "A" (references = @./self.usda@</A>) { }')), "do not compose"
    ),
    PastFailure(
        "stage",
        "cycle.usda",
        _bytes(_usda('def "A" (references = </B>) { }\ndef "B" (references = </A>) { }')),
        "do not compose",
    ),
    PastFailure(
        "stage", "layers.usda", _bytes(_usda("", "    subLayers = [@./layers.usda@]\n")), "do not compose"
    ),
    PastFailure("stage", "doubled.usda", _bytes(_doubled_instances(15)), "it has over 20000 meshes"),
    PastFailure(
        "stage",
        "counts.usda",
        _bytes(_usda(_MESH % ("[2147483647, 2147483647]", "[0, 1, 2]", ""))),
        "faceVertexCounts ask for 4294967294 corners, and faceVertexIndices has 3",
    ),
    PastFailure(
        "stage", "negative.usda", _bytes(_usda(_MESH % ("[-3]", "[0, 1, 2]", ""))), "ask for -3 corners"
    ),
    PastFailure(
        "stage",
        "index.usda",
        _bytes(_usda(_MESH % ("[3]", "[0, 1, 2147483647]", ""))),
        "/A: face 0 names vertex 2147483647; there are 3 vertices",
    ),
    PastFailure(
        "stage",
        "creases.usda",
        _bytes(
            _usda(_MESH % ("[3]", "[0, 1, 2]", "int[] creaseIndices = [9, 1]\n int[] creaseLengths = [2]\n"))
        ),
        "creaseSharpnesses do not fit",
    ),
    PastFailure(
        "stage",
        "type.usda",
        _bytes(_usda('def Mesh "A" { string points = "abc"\n int[] faceVertexCounts = [3]\n }')),
        "/A: points is not of type point3f[]",
    ),
    PastFailure(
        "stage",
        "instancer.usda",
        _bytes(
            _usda(
                'def PointInstancer "A" { rel prototypes = </A>\n int[] protoIndices = [0]\n'
                " point3f[] positions = [(0, 0, 0)]\n }"
            )
        ),
        "is a point instancer within 8 others",
    ),
    PastFailure(
        "stage",
        "clips.usda",
        _bytes(_clips("dictionary default = { asset[] assetPaths = [@./gone.usdc@] }")),
        "gone.usdc: file not found",
    ),
    PastFailure(
        "stage",
        "template.usda",
        _bytes(_clips('dictionary default = { string templateAssetPath = "./a.#.usd" }')),
        "/A: the template of its value clips and its times do not fit",
    ),
    PastFailure("stage", "number.usda", _bytes(_clips("int default = 3")), "/A: its value clips are no"),
    PastFailure("stage", "crowd.usda", _bytes(_crowd(60_000)), "it has over 50000 prims"),
    PastFailure("stage", "deep.usda", _bytes(_usda('def "A" { ' * 100_000)), "its reader crashed"),
    PastFailure(
        "stage", "brackets.usda", _bytes(_usda('def "A" { int a = ' + "[" * 100_000)), "cannot be read"
    ),
    PastFailure("stage", "bomb.usdz", lambda path: path.write_bytes(_usdz(1 << 28)), "cannot be read"),
    PastFailure("picture", "wide.png", _bytes(_png(60_000, 60_000)), "picture"),
    PastFailure("picture", "large.png", _bytes(_png(16_000, 16_000)), "16000 × 16000 pixels"),
    PastFailure("sound", "slow.wav", _bytes(_wav(1)), "it has 1 samples a second"),
    PastFailure("sound", "channels.wav", _bytes(_wav(8000, 60_000)), "cannot be read"),
    PastFailure(
        "sound", "list.wav", _bytes("#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n"), "cannot be read"
    ),
    PastFailure("sound", "concat.wav", _bytes("ffconcat version 1.0\nfile /etc/passwd\n"), "cannot be read"),
    PastFailure(
        "view",
        "deep.ocio",
        _bytes("roles: " + "[" * 100_000),
        "is not an OpenColorIO config",
    ),
    PastFailure("view", "long.ocio", _bytes("x: {src: %s}" % ("a" * 3000)), "is not an OpenColorIO config"),
    PastFailure("drawing", "uses.svg", _bytes(_svg(_DOUBLED)), "shows over 100000 elements"),
    PastFailure("drawing", "laughs.svg", _bytes(_LAUGHS + _svg("&a12;")), "amplification"),
    PastFailure("drawing", "digits.svg", _bytes(_svg(f"<rect width='{'1' * 200_000}x'/>")), "a length of"),
    PastFailure("drawing", "number.svg", _bytes(_svg("<path d='M0 0H1e308V1e308Z'/>")), "reaches beyond"),
    PastFailure("drawing", "stroke.svg", _bytes(_svg("<path d='M0 0H9' stroke-width='-4'/>")), "below 0"),
    PastFailure("drawing", "comments.svg", _bytes(_svg(f"<style>{'/*' * 10**5}</style>")), "shows nothing"),
    PastFailure("drawing", "rules.svg", _bytes(_svg(f"<style>{'a' * 10**5}</style>")), "shows nothing"),
    PastFailure("drawing", "box.svg", _bytes(_svg("<svg viewBox='0 0 0 0'/>")), "within the drawing"),
    PastFailure("drawing", "arc.svg", _bytes(_svg(_ARC)), "is not valid"),
    PastFailure("font", "pointer.ttf", _bytes("version https://git-lfs.github.com/spec/v1"), "Git LFS"),
    PastFailure("font", "short.ttf", _bytes(b"\0\1\0\0" + bytes(20)), "is damaged"),
    PastFailure("flow", "minus.py", _bytes("-" * 100_000 + "1"), "this is not Python"),
    PastFailure("flow", "brackets.py", _bytes("(" * 100_000), "this is not Python"),
    PastFailure("flow", "sum.py", _bytes("+".join("1" * 50_000)), "this is not Python"),
    PastFailure("flow", "zeros.py", _bytes(b"a = 1\x00"), "this is not Python"),
)
