"""`python -m benchmarks.resampling`: frames against the memory-bound pass and the peers, and films.

Prints two tables and writes `benchmarks/out/resampling.json`. Ratios travel between machines, times do not.
"""

from __future__ import annotations

import json
import math
import time
from pathlib import Path

import numpy as np

from benchmarks import peers, works
from benchmarks.limit import best_of, edge_pass
from pipeline.mesh import TriangleMesh, require
from pipeline.resample import Resampler, Thresholds

OUT = Path(__file__).parent / "out"
REPEATS = 9
PEER_SIZE = "160k"

Row = dict[str, float | str | int]


def main() -> None:
    """Measure everything and keep the numbers."""
    frames = [measure_frame(size) for size in works.FREQUENCIES]
    films = [measure_film(name, film) for name, film in works.films().items()]
    OUT.mkdir(exist_ok=True)
    (OUT / "resampling.json").write_text(json.dumps({"frames": frames, "films": films}, indent=1) + "\n")
    _print("One frame, 5% of its edges out of the bracket", frames)
    _print("Films of 120 frames", films)


def measure_frame(size: str) -> Row:
    """One resampling of a frame, the edge pass in the same run, and at one size the peers."""
    mesh, longest = works.frame(size)
    edges = works.edges_of(mesh)
    ours = min(_resample_once(mesh, longest) for _ in range(REPEATS))
    limit = best_of(lambda: edge_pass(mesh.vertices, edges, longest**2), 5 * REPEATS)
    row: Row = {"work": size, "ms": 1e3 * ours, "edge pass ms": 1e3 * limit, "x pass": ours / limit}
    if size == PEER_SIZE:
        for name, remesh in peers.installed().items():
            row[f"x {name}"] = remesh(mesh, longest) / ours
    return row


def _resample_once(mesh: TriangleMesh, longest: float) -> float:
    resampler = Resampler(mesh, Thresholds(longest))
    start = time.perf_counter()
    resampler.resample()
    return time.perf_counter() - start


def measure_film(name: str, film: works.Film) -> Row:
    """A film with the connectivity kept alive: seconds of resampling, bracket, volume and quality."""
    resampler = Resampler(film.subject, Thresholds(film.max_edge_length))
    seconds, edges, out = 0.0, 0, 0
    for _ in range(works.FRAMES):
        resampler.vertices[:] = works.advance(film, resampler.vertices)
        start = time.perf_counter()
        report = resampler.resample()
        seconds += time.perf_counter() - start
        edges, out = edges + report.edges, out + report.too_short + report.too_long
    mesh = resampler.mesh
    require(mesh, closed=True)
    kept = _volume(mesh) / (_volume(film.subject) * math.exp(film.divergence * film.duration))
    quality = _quality(mesh)
    return {
        "work": name,
        "s": seconds,
        "vertices": report.vertices,
        "% in bracket": 100 * (1 - out / edges),
        "volume drift": kept - 1,
        "quality 1%": float(np.quantile(quality, 0.01)),
        "quality median": float(np.median(quality)),
    }


def _volume(mesh: TriangleMesh) -> float:
    points = mesh.vertices - mesh.vertices.mean(axis=0)
    a, b, c = (points[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def _quality(mesh: TriangleMesh) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Twice the inradius over the circumradius: 1 for an equilateral triangle, 0 for a needle."""
    ends = mesh.vertices[mesh.faces]
    a, b, c = np.linalg.norm(np.roll(ends, 1, axis=1) - ends, axis=2).T
    shape: np.ndarray[tuple[int], np.dtype[np.float64]]
    shape = np.clip((b + c - a) * (c + a - b) * (a + b - c) / np.maximum(a * b * c, 1e-300), 0, 1)
    return shape


def _print(title: str, rows: list[Row]) -> None:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    print(f"\n{title}\n" + "".join(f"{name:>16}" for name in columns))
    for row in rows:
        print("".join(f"{_cell(row.get(name, '')):>16}" for name in columns))


def _cell(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"


if __name__ == "__main__":
    main()
