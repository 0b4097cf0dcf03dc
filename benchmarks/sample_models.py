"""Models as they are found: with faults of connectivity, in all formats, of any size and at any place.

`MODELS` has for each a function that writes its file into a folder and returns the path.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from flowsculpt.pipeline.arrays import AnyArray, Indices, Points
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, torus
from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh

Polygons = Sequence[Sequence[int]]


def _obj(folder: Path, name: str, vertices: AnyArray, faces: Polygons | AnyArray, head: str = "") -> Path:
    path = folder / f"{name}.obj"
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in np.asarray(vertices).tolist()]
    lines += [
        "f " + " ".join(str(corner + 1) for corner in face) for face in np.asarray(faces, object).tolist()
    ]
    path.write_text(head + "\n".join(lines) + "\n")
    return path


def _written(folder: Path, name: str, mesh: TriangleMesh) -> Path:
    """Write a mesh in the format of the name's suffix."""
    path = folder / name
    write_mesh(mesh, path)
    return path


def _figure() -> tuple[Points, Indices]:
    """Return a cone with a ball on its tip, along z: the head is up where z is."""
    ball = icosphere(10, 0.5)
    around = np.linspace(0.0, 2.0 * math.pi, 32, endpoint=False)
    ring = np.stack([0.8 * np.cos(around), 0.8 * np.sin(around), np.full(32, -1.5)], axis=1)
    cone = np.vstack([ring, [[0, 0, 1.0]], [[0, 0, -1.5]]])
    sides = [(k, (k + 1) % 32, 32) for k in range(32)] + [((k + 1) % 32, k, 33) for k in range(32)]
    return np.vstack([cone, ball.vertices + np.array((0, 0, 1.3))]), np.vstack(
        [sides, ball.faces + len(cone)]
    )


def _joined(*meshes: TriangleMesh) -> tuple[Points, Indices]:
    counts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = np.vstack([mesh.faces + first for mesh, first in zip(meshes, counts, strict=False)])
    return np.vstack([mesh.vertices for mesh in meshes]), faces.astype(np.int32)


def _moved(mesh: TriangleMesh, *offset: float) -> TriangleMesh:
    return mesh.with_vertices(mesh.vertices + np.array(offset))


def _pinched(folder: Path) -> Path:
    ball = icosphere(8)
    vertices, faces = _joined(ball, _moved(ball, 2, 0, 0))
    right, left = (
        int(np.argmax(ball.vertices[:, 0])),
        int(np.argmin(ball.vertices[:, 0])) + len(ball.vertices),
    )
    vertices[right] = vertices[left] = (1.0, 0.0, 0.0)
    return _obj(folder, "pinched", vertices, np.where(faces == left, right, faces))


def _third_face(folder: Path) -> Path:
    ball = icosphere(8)
    fin = [*ball.faces[0][:2], len(ball.vertices)]
    return _obj(folder, "third_face", np.vstack([ball.vertices, [[0, 3, 0]]]), np.vstack([ball.faces, fin]))


def _open_shell(folder: Path) -> Path:
    ball = icosphere(12)
    upper = (ball.vertices[ball.faces][:, :, 1] > 0.1).any(axis=1)
    return _obj(folder, "open_shell", ball.vertices, ball.faces[upper])


def _parts(folder: Path) -> Path:
    balls = [_moved(icosphere(5, 0.4), *place) for place in np.random.default_rng(4).uniform(-1, 1, (5, 3))]
    return _obj(folder, "parts", *_joined(*balls))


def _prism(folder: Path) -> Path:
    """Write a prism with sides of four corners, and ends of twelve."""
    around = np.linspace(0.0, 2.0 * math.pi, 12, endpoint=False)
    ring = np.stack([np.cos(around), np.zeros(12), -np.sin(around)], axis=1)
    sides = [[k, (k + 1) % 12, (k + 1) % 12 + 12, k + 12] for k in range(12)]
    ends = [list(range(11, -1, -1)), list(range(12, 24))]
    return _obj(
        folder, "prism", np.vstack([ring - np.array((0, 1, 0)), ring + np.array((0, 1, 0))]), [*sides, *ends]
    )


def _quads(folder: Path) -> Path:
    """Write a torus of quadrangles as an ASCII PLY."""
    n, m = 48, 20
    u, v = np.meshgrid(2 * math.pi * np.arange(n) / n, 2 * math.pi * np.arange(m) / m, indexing="ij")
    points = np.stack(
        [(1 + 0.4 * np.cos(v)) * np.cos(u), 0.4 * np.sin(v), (1 + 0.4 * np.cos(v)) * np.sin(u)], -1
    )

    def corner(i: int, j: int) -> int:
        return i % n * m + j % m

    faces = [
        f"4 {corner(i, j)} {corner(i, j + 1)} {corner(i + 1, j + 1)} {corner(i + 1, j)}"
        for i in range(n)
        for j in range(m)
    ]
    head = f"ply\nformat ascii 1.0\nelement vertex {n * m}\n"
    head += "property float x\nproperty float y\nproperty float z\n"
    head += f"element face {n * m}\nproperty list uchar int vertex_indices\nend_header\n"
    path = folder / "quads.ply"
    rows = [" ".join(f"{x:.7g}" for x in point) for point in points.reshape(-1, 3)]
    path.write_text(head + "\n".join([*rows, *faces]) + "\n")
    return path


def _big_endian(folder: Path) -> Path:
    mesh = torus(1.0, 0.4, 0.15)
    counts = f"element vertex {len(mesh.vertices)}\nproperty double x\nproperty double y\nproperty double z\n"
    counts += f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = np.zeros(len(mesh.faces), [("count", "u1"), ("corners", ">i4", 3)])
    rows["count"], rows["corners"] = 3, mesh.faces
    path = folder / "big_endian.ply"
    head = f"ply\nformat binary_big_endian 1.0\n{counts}".encode()
    path.write_bytes(head + mesh.vertices.astype(">f8").tobytes() + rows.tobytes())
    return path


def _ascii_stl(folder: Path) -> Path:
    mesh, path = torus(1.0, 0.4, 0.2), folder / "ascii.stl"
    facets = [
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x:.7g} {y:.7g} {z:.7g}\n" for x, y, z in corners)
        + "endloop\nendfacet\n"
        for corners in mesh.vertices[mesh.faces].tolist()
    ]
    path.write_text("solid torus\n" + "".join(facets) + "endsolid torus\n")
    return path


def _soup(folder: Path) -> Path:
    ball = icosphere(8)
    return _obj(
        folder, "soup", ball.vertices[ball.faces].reshape(-1, 3), np.arange(ball.faces.size).reshape(-1, 3)
    )


def _flipped(folder: Path) -> Path:
    ball = icosphere(8)
    faces = ball.faces.copy()
    faces[::2] = faces[::2, ::-1]
    return _obj(folder, "flipped", ball.vertices, faces)


def _degenerate(folder: Path) -> Path:
    ball = icosphere(8)
    flat = np.array([[0, 0, 1], [5, 5, 5], *ball.faces[:3].tolist()])
    return _obj(folder, "degenerate", ball.vertices, np.vstack([ball.faces, flat]))


def _unused(folder: Path) -> Path:
    ball = icosphere(8)
    return _obj(folder, "unused", np.vstack([ball.vertices, [[50, 50, 50], [0, 0, 0]]]), ball.faces)


def _moebius(folder: Path) -> Path:
    n = 60
    turn, side = np.meshgrid(2 * math.pi * np.arange(n) / n, [-0.3, 0.0, 0.3], indexing="ij")
    radius = 1 + side * np.cos(turn / 2)
    points = np.stack([radius * np.cos(turn), side * np.sin(turn / 2), radius * np.sin(turn)], -1).reshape(
        -1, 3
    )
    faces = []
    for i in range(n):
        for j in range(2):
            k = i + 1 if i + 1 < n else 0
            b, c = (3 * k + j, 3 * k + j + 1) if k else (2 - j, 1 - j)
            faces.append([3 * i + j, 3 * i + j + 1, c, b])
    return _obj(folder, "moebius", points, faces)


def _knot(folder: Path) -> Path:
    """Write a thin tube along a trefoil."""
    n, m = 300, 10
    t = 2 * math.pi * np.arange(n) / n
    line = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1)
    along = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
    side = np.cross(along, (0, 0, 1.0))
    side /= np.linalg.norm(side, axis=1)[:, None]
    up = np.cross(side, along / np.linalg.norm(along, axis=1)[:, None])
    v = 2 * math.pi * np.arange(m) / m
    points = line[:, None] + 0.12 * (np.cos(v)[:, None] * side[:, None] + np.sin(v)[:, None] * up[:, None])

    def corner(i: int, j: int) -> int:
        return i % n * m + j % m

    quads = [
        [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)]
        for i in range(n)
        for j in range(m)
    ]
    return _obj(folder, "knot", points.reshape(-1, 3), quads)


def _spikes(folder: Path) -> Path:
    ball = icosphere(20)
    reach = 1.0 + 0.8 * np.maximum(0.0, np.cos(7 * ball.vertices).prod(axis=1))
    return _obj(folder, "spikes", ball.vertices * reach[:, None], ball.faces)


def _textured(folder: Path) -> Path:
    """Write a box with texture coordinates, normals, groups, a material and indices that count backwards."""
    lines = ["mtllib none.mtl", "o box", "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", "vn 0 1 0"]
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    lines += [f"v {x} {y} {z}" for x, y, z in corners]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    for k, side in enumerate(sides):
        lines += [f"g side{k}", "usemtl paint", "s off"]
        lines.append("f " + " ".join(f"{corner - 8}/{n + 1}/1" for n, corner in enumerate(side)))
    path = folder / "textured.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


def _not_finite(folder: Path) -> Path:
    return _obj(
        folder, "not_finite", np.vstack([[[0, 0, math.nan]], box((1, 1, 1), 1.0).vertices]), [[0, 1, 2]]
    )


def _empty(folder: Path) -> Path:
    path = folder / "empty.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    return path


MODELS: dict[str, Callable[[Path], Path]] = {
    "ball": lambda folder: _obj(folder, "ball", icosphere(12).vertices, icosphere(12).faces),
    "pinched": _pinched,
    "third face": _third_face,
    "open shell": _open_shell,
    "five parts": _parts,
    "n-gons": _prism,
    "z up": lambda folder: _obj(folder, "z_up", *_figure()),
    "1e-3 units": lambda folder: _written(folder, "tiny.ply", icosphere(12, 0.0005)),
    "0.15 units": lambda folder: _written(folder, "small.off", icosphere(12, 0.075)),
    "494 units": lambda folder: _written(folder, "wide.obj", icosphere(24, 247.0)),
    "1e4 units": lambda folder: _written(folder, "huge.ply", icosphere(24, 5e3)),
    "1e5 off": lambda folder: _written(folder, "far.obj", _moved(icosphere(12), 1e5, 0, 0)),
    "494, 2e4 off": lambda folder: _written(
        folder, "wide_far.ply", _moved(icosphere(24, 247.0), 1e3, -500, 2e4)
    ),
    "512k faces": lambda folder: _written(folder, "many.ply", icosphere(160)),
    "binary STL": lambda folder: _written(folder, "binary.stl", torus(1.0, 0.4, 0.1)),
    "ASCII STL": _ascii_stl,
    "quads, ASCII PLY": _quads,
    "big-endian PLY": _big_endian,
    "OFF": lambda folder: _written(folder, "box.off", box((2, 1, 1), 0.3)),
    "GLB": lambda folder: _written(folder, "torus.glb", torus(1.0, 0.4, 0.1)),
    "loose triangles": _soup,
    "flipped faces": _flipped,
    "degenerate faces": _degenerate,
    "unused vertices": _unused,
    "Möbius strip": _moebius,
    "thin knot": _knot,
    "thin plate": lambda folder: _written(folder, "plate.obj", box((2.0, 2.0, 1e-3), 0.4)),
    "nested shells": lambda folder: _obj(folder, "nested", *_joined(icosphere(8), icosphere(6, 0.6))),
    "crossing parts": lambda folder: _obj(
        folder, "crossing", *_joined(icosphere(8), _moved(icosphere(8), 0.9, 0.2, 0))
    ),
    "spikes": _spikes,
    "textured OBJ": _textured,
    "not finite": _not_finite,
    "no faces": _empty,
}
"""Writers by what is particular about the model."""

UNUSABLE = ("not finite", "no faces")
"""Models that are refused."""

UNUSUAL = ("ball", "1e-3 units", "0.15 units", "494 units", "1e4 units", "1e5 off", "494, 2e4 off")
"""Models of unusual size or place, and one of the usual."""
