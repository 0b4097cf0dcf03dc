"""`python -m benchmarks.seams`: shots of painted models with their seams, against the same shots without.

Each shot is read and animated with `paint: on` and `paint: off`, one after the other, in CPU seconds of all
threads: reading, meshing, flow and resampling; the least of several runs. Writes `benchmarks/out/seams.json`.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.shot import read_shot

REPEATS = 3
MOST = 1.3
SHOT = """\
title: Painted
frames: 1-{last}
subject: {{model: model.obj, paint: "{paint}"}}
flows: [{{{flow}}}]
resample: {{max_edge_length: {edge}}}
"""
FLOWS = {
    "twist": "twist: {axis: y, amount: {ease: linear, keys: {1: 0, 12: 240}}}",
    "vortex": "vortex: {axis: y, strength: 9, radius: 0.6}",
    "curl noise": "curl_noise: {size: 1.1, strength: 0.5, seed: 3}",
}


def main() -> list[Target]:
    """Measure all models under all flows; return the targets."""
    rows: list[Row] = []
    for model in MODELS:
        for flow in FLOWS:
            rows.append(measure(model, flow))
            show("Painted models: CPU seconds with seams and without", rows[-1:])
    keep("seams", rows)
    show("Painted models: CPU seconds with seams and without", rows)
    return [
        Target(f"seams:{row['model']}, {row['flow']}", "ratio", float(row["ratio"]), MOST) for row in rows
    ]


def measure(model: str, flow: str) -> Row:
    """Measure a model under a flow."""
    write, edge = MODELS[model]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        (path / "model.obj").write_text(write())
        runs = [(run(path, flow, edge, "on"), run(path, flow, edge, "off")) for _ in range(REPEATS + 1)][1:]
    (seconds, vertices, seams), (without, _, _) = (min(each) for each in zip(*runs, strict=True))
    row = {"model": model, "flow": flow, "vertices": vertices, "seam edges": seams}
    return {**row, "with seams": seconds, "without": without, "ratio": seconds / without}


def run(folder: Path, flow: str, edge: float, paint: str, last: int = 12) -> tuple[float, int, int]:
    """Return the CPU seconds of a shot, and vertices and seam edges of its last frame."""
    (folder / "shot.yaml").write_text(SHOT.format(last=last, paint=paint, flow=FLOWS[flow], edge=edge))
    began = time.process_time()
    *_, frame = animate(read_shot(folder / "shot.yaml"))
    return time.process_time() - began, len(frame.mesh.vertices), len(frame.mesh.seams)


def _box() -> str:
    """Return a cube of six charts."""
    turns = [np.roll(np.eye(3), k, axis=1) * [[1], [1], [sign]] for k in range(3) for sign in (1, -1)]
    return "\n".join(
        _grid(8, 8, lambda u, v, t=turn: (2 * u - 1) * t[0] + (2 * v - 1) * t[1] + t[2], 81 * k)
        for k, turn in enumerate(turns)
    )


def _globe(columns: int = 48, rows: int = 24) -> str:
    """Return a ball whose chart meets itself at a meridian and at the poles."""

    def place(u: float, v: float) -> Points:
        turn, height = 2.0 * np.pi * u, np.pi * (v - 0.5)
        return np.array([np.cos(height) * np.sin(turn), np.sin(height), np.cos(height) * np.cos(turn)])

    return _grid(columns, rows, place)


def _ring(columns: int, rows: int, materials: int = 1) -> str:
    """Return a torus whose chart meets itself both ways round, with materials in sectors."""

    def place(u: float, v: float) -> Points:
        turn, tube = 2.0 * np.pi * u, 2.0 * np.pi * v
        away = 1.0 + 0.4 * np.cos(tube)
        return np.array([away * np.sin(turn), 0.4 * np.sin(tube), away * np.cos(turn)])

    return _grid(columns, rows, place, materials=materials)


def _grid(
    columns: int, rows: int, place: Callable[[float, float], Floats], first: int = 0, materials: int = 1
) -> str:
    """Return the lines of an OBJ file: a grid with a point and texture coordinates at each crossing.

    Sides that meet repeat their points, and squares that have shrunk to a triangle lose a corner.
    """
    lines, points = [], []
    for j in range(rows + 1):
        for i in range(columns + 1):
            u, v = i / columns, j / rows
            points.append(np.round(place(u, v), 9) + 0.0)
            lines += ["v {} {} {}".format(*points[-1]), f"vt {u} {v}"]
    for i in range(columns):
        lines += [f"usemtl m{i * materials // columns}"] * (materials > 1)
        for j in range(rows):
            a = j * (columns + 1) + i
            corners = [a, a + 1, a + columns + 2, a + columns + 1]
            kept = [c for k, c in enumerate(corners) if (points[c] != points[corners[k - 1]]).any()]
            lines.append("f " + " ".join(f"{first + c + 1}/{first + c + 1}" for c in kept))
    return "\n".join(lines)


MODELS: dict[str, tuple[Callable[[], str], float]] = {
    "painted box": (_box, 0.05),
    "globe": (_globe, 0.05),
    "ring of eight materials": (lambda: _ring(48, 20, 8), 0.05),
    "dense ring": (lambda: _ring(240, 100), 0.04),
}
"""Models as texts of OBJ files, and the maximum edge length of their shots."""

if __name__ == "__main__":
    main()
