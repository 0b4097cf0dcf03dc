"""`python -m benchmarks.polyhedra`: the paper's first version, its options side by side, and the second.

A cube of six quads is twisted and waved for 60 frames, once with each way of cutting and of collapsing, and
once as triangles by the second version; then with ten times the faces, for the speed. And one long face is
cut by hundreds of planes, in CPU time. Prints three tables.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import product
from typing import Literal, cast

import numpy as np
from rich.console import Console
from rich.table import Table

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh
from flowsculpt.pipeline.plugins.polyhedra.polyhedral_resampler import PolyhedralResampler
from flowsculpt.pipeline.resample import Report, Resampler, Thresholds

FRAMES, COARSE, FINE = 60, 0.2, 0.11
SHOWN = (0, 10, 20, 40, 60)

CUBE = PolygonMesh(
    [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)],
    [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)],
)


def flow(points: Points) -> Points:
    """Return the flow of a 24th of a second: a twist around y and two waves."""
    x, y, z = points.T
    turn = 0.05 * y * np.exp(-(x * x + z * z))
    return np.column_stack(
        [
            x * np.cos(turn) - z * np.sin(turn) + 0.0125 * np.sin(2 * y),
            y + np.sin(3 * x) / 48,
            x * np.sin(turn) + z * np.cos(turn),
        ]
    )


def film(resampler: Resampler | PolyhedralResampler) -> Iterator[tuple[Report, float]]:
    """Yield the report of each frame and the seconds of its resampling; the first is the subject at rest."""
    for frame in range(FRAMES + 1):
        if frame:
            resampler.vertices[:] = flow(resampler.vertices)
        start = time.perf_counter()
        report = resampler.resample()
        yield report, time.perf_counter() - start


def quality(mesh: TriangleMesh) -> float:
    """Return the first percentile of 2r/R over all triangles: 1 is equilateral."""
    corners = mesh.vertices[mesh.faces]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    half = sides.sum(axis=1) / 2
    square = half * (half[:, None] - sides).prod(axis=1)
    return float(np.percentile(8 * square / (half * sides.prod(axis=1)), 1))


def row(name: str, resampler: Resampler | PolyhedralResampler) -> list[str]:
    """Return the row of one film."""
    frames = list(film(resampler))
    reports = [report for report, _ in frames]
    mesh = resampler.mesh
    triangles = mesh.triangulated() if isinstance(mesh, PolygonMesh) else mesh
    last, moving = reports[-1], reports[1:]
    sides = " ".join(f"{getattr(reports[n], 'average_sides', 3.0):.2f}" for n in SHOWN)
    work = " ".join(
        f"{np.mean([getattr(report, what, 0) for report in moving]):.0f}"
        for what in ("splits", "cuts", "collapses")
    )
    return [
        name,
        f"{reports[0].faces} in {reports[0].passes}",
        f"{last.vertices} {last.faces}",
        sides,
        work,
        f"{last.within_limits:.1%}",
        f"{quality(triangles):.2f}",
        f"{np.mean([seconds for _, seconds in frames[1:]]) * 1000:.0f}",
    ]


def table(longest: float, ways: list[tuple[str, str]]) -> Table:
    """Return the rows of all options at one maximum edge length."""
    shown = Table(title=f"max_edge_length {longest}")
    heads = [
        "way",
        "first frame: faces, passes",
        "last: vertices, faces",
        f"sides a face, frames {SHOWN}",
        "splits, cuts, collapses a frame",
        "within limits",
        "1% quality",
        "ms a frame",
    ]
    for head in heads:
        shown.add_column(head)
    for cutting, collapse in ways:
        resampler = PolyhedralResampler(
            CUBE,
            Thresholds(longest),
            cast(Literal["slice", "recurse"], cutting),
            cast(Literal["edges", "areas"], collapse),
        )
        shown.add_row(*row(f"{cutting}, {collapse}", resampler))
    shown.add_row(*row("version 2", Resampler(CUBE.triangulated(), Thresholds(longest))))
    return shown


def ribbons() -> Table:
    """Return the CPU time of cutting one long face, straight or wavy, into more and more slices."""
    shown = Table(title="one face, sliced")
    for head in ("outline", "sides", "slices", "ms", "ms a slice"):
        shown.add_column(head)
    for name, slices in product(("straight", "wavy"), (250, 1000, 4000)):
        x = np.linspace(0.0, slices, slices + 1 if name == "wavy" else 2)
        low = np.column_stack([x, 0.2 * np.sin(x) if name == "wavy" else 0 * x, 0 * x])
        outline = np.concatenate([low, low[::-1] + np.array([0.0, 0.9, 0.0])])
        resampler = PolyhedralResampler(PolygonMesh(outline, [range(len(outline))]), Thresholds(1.0001, 0.1))
        start = time.process_time()
        report = resampler.resample()
        spent = 1000 * (time.process_time() - start)
        shown.add_row(
            name, str(len(outline)), str(report.faces), f"{spent:.0f}", f"{spent / report.faces:.3f}"
        )
    return shown


def main() -> None:
    """Print all tables."""
    console = Console(width=160)
    console.print(ribbons())
    console.print(table(COARSE, list(product(("slice", "recurse"), ("edges", "areas")))))
    console.print(table(FINE, [("slice", "edges")]))


if __name__ == "__main__":
    main()
