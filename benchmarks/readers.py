"""`python -m benchmarks.readers [--before DIR] [--faces 500000] [--file NAME]`: reading large models.

Formats are OBJ, PLY, STL and OFF, PLY and STL also as text, and GLB. Four kinds of surface: a smooth ball; a
torus of triangles and quadrangles; the torus with normals, texture coordinates and colours; and many small
balls, each a part of its own. STL and GLB have their triangles. This code, the code of another checkout, DIR,
and trimesh read each in turns, every reader in a process of its own. Times are CPU seconds, also of the
processes that a reader starts, medians; nan of what a reader refuses. Prints a table with the worst kind of
each format and the best; writes `benchmarks/out/readers.json`.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from argparse import ArgumentParser
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.arrays import AnyArray, Points
from flowsculpt.pipeline.mesh import icosphere

REPEATS, MORE_REPEATS, SHORT = 3, 21, 0.2
"""Times that a file is read; more often where that takes less than SHORT seconds."""

PARTS = 250
"""Balls of the kind with many parts."""

_READ = """
import resource, sys, warnings
sys.path.insert(0, sys.argv[1])
warnings.simplefilter("ignore")
from pathlib import Path
if sys.argv[2] == "trimesh":
    import trimesh
    read = lambda path: trimesh.load(path, process=False)
else:
    from flowsculpt.pipeline.mesh.read import _READERS
    read = lambda path: _READERS[path.suffix[1:]](path)
def cpu():
    used = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(u.ru_utime + u.ru_stime for u in used)
for line in sys.stdin:
    before = cpu()
    try:
        read(Path(line.strip()))
        print(cpu() - before, flush=True)
    except Exception:
        print("nan", flush=True)
"""


@dataclass(frozen=True)
class Model:
    """A surface to be written.

    faces           arrays of faces with three corners, or four; in OBJ and GLB each array is a part
    has_attributes  whether it has normals, texture coordinates and colours
    """

    points: Points
    faces: list[AnyArray]
    has_attributes: bool = False

    @property
    def triangles(self) -> list[AnyArray]:
        return [f if f.shape[1] == 3 else f[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3) for f in self.faces]


def models(faces: int) -> dict[str, Model]:
    """Return models of about so many triangles, by kind."""
    ball, part = (icosphere(round((count / 20) ** 0.5)) for count in (faces, faces / PARTS))
    points, quads = _torus(round((faces / 2) ** 0.5))
    halved = quads[::2]
    mixed = [halved[:, [0, 1, 2]], halved[:, [0, 2, 3]], quads[1::2]]
    centres = 3.0 * np.arange(PARTS)[:, None, None] * (1.0, 0.0, 0.0)
    numbers = len(part.vertices) * np.arange(PARTS)[:, None, None]
    return {
        "ball": Model(ball.vertices, [ball.faces]),
        "triangles and quadrangles": Model(points, mixed),
        "with attributes": Model(points, [quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)], has_attributes=True),
        "many parts": Model((part.vertices + centres).reshape(-1, 3), [*(part.faces + numbers)]),
    }


def _torus(count: int) -> tuple[Points, AnyArray]:
    """Return the points and quadrangles of a torus of count × count points."""
    u, v = np.meshgrid(*2 * [np.arange(count)], indexing="ij")
    corners = [(u + i) % count * count + (v + j) % count for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    a, b = 2.0 * np.pi * u / count, 2.0 * np.pi * v / count
    points = [(2.0 + np.cos(b)) * np.cos(a), (2.0 + np.cos(b)) * np.sin(a), np.sin(b)]
    return np.stack(points, -1).reshape(-1, 3), np.stack(corners, -1).reshape(-1, 4)


def write(path: Path, model: Model) -> None:
    """Write a model; the name of the file says its format, and whether it is text."""
    form = path.suffix[1:]
    if form == "obj":
        path.write_text(_obj(model))
    elif form == "off":
        counts = f"{len(model.points)} {sum(map(len, model.faces))} 0"
        path.write_text(f"OFF\n{counts}\n{_lines(model.points)}{_counted(model)}")
    elif form == "ply":
        path.write_bytes(_ply(model, is_text=path.stem == "text"))
    else:
        parts = [trimesh.Trimesh(model.points, part, process=False) for part in model.triangles]
        for part in parts:
            part.remove_unreferenced_vertices()
        if model.has_attributes:
            parts[0].visual.vertex_colors = _colours(model)
        scene = trimesh.Scene(parts) if form == "glb" else trimesh.util.concatenate(parts)
        content = scene.export(file_type="stl_ascii" if path.stem == "text" else form)
        path.write_bytes(content.encode() if isinstance(content, str) else content)


def _lines(table: AnyArray, head: str = "", form: str = "%.6f") -> str:
    """Return a line for each row; `form` is that of one number, or of several that belong together."""
    line = head + " ".join([form] * (table.shape[1] // form.count("%"))) + "\n"
    return "".join(line % tuple(row) for row in table.tolist())


def _counted(model: Model) -> str:
    return "".join(_lines(part, f"{part.shape[1]} ", "%d") for part in model.faces)


def _colours(model: Model) -> AnyArray:
    return (100.0 + 30.0 * model.points).astype(np.uint8)


def _obj(model: Model) -> str:
    text = [_lines(model.points, "v ")]
    if model.has_attributes:
        text += [_lines(model.points, "vn "), _lines(model.points[:, :2], "vt ")]
    for number, part in enumerate(model.faces):
        form = "%d/%d/%d" if model.has_attributes else "%d"
        text += [f"g part{number}\n", _lines(np.repeat(part + 1, form.count("%"), axis=1), "f ", form)]
    return "".join(text)


def _ply(model: Model, is_text: bool) -> bytes:
    names = ["x", "y", "z", *(("nx", "ny", "nz") if model.has_attributes else ())]
    properties = [f"property float {name}" for name in names]
    properties += [f"property uchar {name}" for name in ("red", "green", "blue") if model.has_attributes]
    counts = len(model.points), sum(map(len, model.faces))
    head = [
        "ply",
        f"format {'ascii' if is_text else 'binary_little_endian'} 1.0",
        f"element vertex {counts[0]}",
    ]
    head += [
        *properties,
        f"element face {counts[1]}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    numbers = np.concatenate([model.points] * (len(names) // 3), axis=1)
    if is_text:
        rows = np.concatenate([numbers, _colours(model)], axis=1) if model.has_attributes else numbers
        return ("\n".join(head) + _lines(rows, form="%g") + _counted(model)).encode()
    vertex = np.dtype([("p", "<f4", len(names)), ("c", "u1", 3 * model.has_attributes)])
    table = np.zeros(len(numbers), vertex)
    table["p"] = numbers
    body = [table.tobytes()]
    for part in model.faces:
        face = np.zeros(len(part), [("n", "u1"), ("v", "<i4", part.shape[1])])
        face["n"], face["v"] = part.shape[1], part
        body.append(face.tobytes())
    return "\n".join(head).encode() + b"".join(body)


class Reader:
    """A process that reads the files whose paths it is sent, and answers with the CPU seconds of each."""

    def __init__(self, root: Path, name: str = "") -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _READ, str(root), name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def seconds(self, path: Path) -> float:
        assert self._process.stdin is not None and self._process.stdout is not None
        print(path, file=self._process.stdin, flush=True)
        return float(self._process.stdout.readline())

    def close(self) -> None:
        self._process.communicate()


FILES = ("a.obj", "a.ply", "text.ply", "a.stl", "text.stl", "a.off", "a.glb")
"""One of each format; text where it has both."""


def main(arguments: list[str] | None = None) -> list[Target]:
    """Measure all kinds; return the targets."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=Path, help="a checkout whose readers are measured too")
    parser.add_argument("--faces", type=int, default=500_000)
    parser.add_argument("--file", action="append", choices=FILES, help="formats, in place of all")
    chosen = parser.parse_args(arguments)
    home = Path(__file__).parents[1]
    readers = {"now": Reader(home), "trimesh": Reader(home, "trimesh")}
    if chosen.before:
        readers["before"] = Reader(chosen.before)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for kind, model in models(chosen.faces).items():
            for name in chosen.file or FILES:
                path = Path(folder) / name
                write(path, model)
                rows.append({"file": _format(path), "kind": kind, **measure(path, readers)})
                show("", rows[-1:])
    for reader in readers.values():
        reader.close()
    keep("readers", rows)
    show(f"Reading {chosen.faces} faces, CPU seconds", rows)
    worst = [
        _worst_and_best(rows, form, other) for other in readers if other != "now" for form in _formats(rows)
    ]
    show("Of the time of others, kinds", worst)
    return [
        Target(
            "reading models",
            f"times {other}, worst",
            max(float(row["worst"]) for row in worst if row["over"] == other),
            most=most,
        )
        for other, most in (("before", 1.05), ("trimesh", None))
        if other in readers
    ]


def _format(path: Path) -> str:
    return f"{path.suffix[1:].upper()}{' text' if path.stem == 'text' else ''}"


def _formats(rows: list[Row]) -> list[str]:
    return list(dict.fromkeys(str(row["file"]) for row in rows))


def measure(path: Path, readers: dict[str, Reader]) -> Row:
    """Return the CPU seconds of each reader, which take turns, and the ratios to this code's."""
    taken: dict[str, list[float]] = {name: [] for name in readers}
    is_short = max(reader.seconds(path) for reader in readers.values()) < SHORT
    for _ in range(MORE_REPEATS if is_short else REPEATS):
        for name, reader in readers.items():
            taken[name].append(reader.seconds(path))
    seconds = {name: float(np.median(times)) for name, times in taken.items()}
    ratios = {f"over {name}": seconds["now"] / seconds[name] for name in readers if name != "now"}
    return {"MB": path.stat().st_size / 1e6, **seconds, **ratios}


def _worst_and_best(rows: list[Row], form: str, other: str) -> Row:
    over = f"over {other}"
    read = (row for row in rows if row["file"] == form and not math.isnan(float(row[over])))
    mine = sorted(read, key=lambda row: float(row[over]))
    best, worst = mine[0], mine[-1]
    return {
        "over": other,
        "file": form,
        "worst": worst[over],
        "its kind": worst["kind"],
        "best": best[over],
        "kind of it": best["kind"],
    }


if __name__ == "__main__":
    main()
