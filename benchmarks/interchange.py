"""`python -m benchmarks.interchange`: writing frames of 100,000 vertices as USD clips, and as PLY.

Four kinds of surface, each with velocities, normals of corners, rest positions and colours: a smooth ball, a
box with creases, a torus whose vertices lie in memory in no order, and a ball drawn out by the Lorenz
attractor. Times are CPU seconds of all threads, medians of REPEATS frames. Prints a table with the worst kind
and the best; writes `benchmarks/out/interchange.json`. It needs usd-core, which `make test` installs.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.flow import Streamlines
from flowsculpt.pipeline.flow.catalogue.lorenz import Lorenz
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, split_at_creases, torus
from flowsculpt.pipeline.plugins.interchange.exported_frame import ExportedFrame
from flowsculpt.pipeline.plugins.interchange.model_export import write_ply
from flowsculpt.pipeline.plugins.interchange.usd_export import sampled_attributes, write_clip
from flowsculpt.pipeline.plugins.interchange.usd_files import require_usd

REPEATS = 9

FREQUENCY = 100
"""Pieces into which each edge of an icosahedron is cut: 100,002 vertices."""


def surfaces() -> dict[str, TriangleMesh]:
    """Return surfaces of about 100,000 vertices by kind."""
    ball = icosphere(FREQUENCY)
    lorenz = Streamlines(Lorenz(scale=16.0, time_scale=0.6))
    return {
        "smooth ball": ball,
        "box with creases": box(2.0, 2.0 / 129),
        "torus in no order": _shuffled(torus(1.0, 0.4, 0.0137)),
        "ball drawn out": ball.with_vertices(lorenz.displace(ball.vertices, 0.0, 0.5)),
    }


def _shuffled(mesh: TriangleMesh) -> TriangleMesh:
    """Return a mesh with its vertices and faces in random order."""
    random = np.random.default_rng(1)
    order = random.permutation(len(mesh.vertices))
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order), dtype=np.int32)
    return TriangleMesh(mesh.vertices[order], random.permutation(place[mesh.faces]))


def exported(mesh: TriangleMesh) -> ExportedFrame:
    """Return a frame of a mesh, with what a flow and a look of many colours give it."""
    split, points = split_at_creases(mesh), mesh.vertices
    turning = np.cross((0.0, 1.0, 0.3), points)
    return ExportedFrame(
        points=points,
        faces=mesh.faces,
        normals=split.normals,
        corner_normals=split.faces,
        velocities=turning,
        rest=points / (1.0 + np.linalg.norm(points, axis=1, keepdims=True)),
        creases=mesh.creases,
        colours=0.5 + 0.5 * np.sin(3.0 * points),
    )


def main() -> list[Target]:
    """Measure all kinds; return the target. Raises MachineError where usd-core is not installed."""
    require_usd()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for kind, mesh in surfaces().items():
            rows.append(measure(kind, exported(mesh), mesh, Path(folder)))
    keep("interchange", rows)
    show("Writing a frame of 100,000 vertices", rows)
    rates = [float(row["clips a second"]) for row in rows]
    print(f"\nworst {min(rates):.1f}, best {max(rates):.1f} clips a CPU second")
    return [Target("four kinds of mesh", "USD clips a CPU second, worst", min(rates), least=7.0)]


def measure(kind: str, frame: ExportedFrame, mesh: TriangleMesh, folder: Path) -> Row:
    """Return the CPU seconds of writing a frame, and of finding its normals, and the sizes of its files."""
    clip, ply, attributes = folder / "a.usdc", folder / "a.ply", sampled_attributes(False, True, False)
    clip_seconds = _cpu_seconds(lambda: write_clip(clip, "/a/sculpture", 1, frame, attributes))
    ply_seconds = _cpu_seconds(lambda: write_ply(ply, frame))
    return {
        "kind": kind,
        "vertices": len(frame.points),
        "clips a second": 1.0 / clip_seconds,
        "clip, MB": clip.stat().st_size / 1e6,
        "PLYs a second": 1.0 / ply_seconds,
        "PLY, MB": ply.stat().st_size / 1e6,
        "normals, s": _cpu_seconds(lambda: split_at_creases(mesh)),
    }


def _cpu_seconds(work: Callable[[], object]) -> float:
    """Return the CPU seconds of all threads of a piece of work: the median of REPEATS runs."""
    work()
    seconds = []
    for _ in range(REPEATS):
        started = time.process_time()
        work()
        seconds.append(time.process_time() - started)
    return float(np.median(seconds))


if __name__ == "__main__":
    main()
