"""`python -m benchmarks.moving_frames`: a frame of a million triangles of another program, to its normals.

A rippled torus of 500,000 vertices, binary PLY with velocities, is the second file of a shot; its frame is
made and shaded as `flowsculpt simulate` and a render do it, in a process that has done so with a small torus.
Its vertices are in the order of its rings, then in random order. CPU seconds and the peak of memory; writes
`benchmarks/out/moving_frames.json`.
"""

from __future__ import annotations

import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.report import Target, keep, show
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.production.request.shading import Shading
from flowsculpt.pipeline.shot import read_shot

SHOT = "title: T\nframes: 1-2\nsubject: {sequence: torus_####.ply}\n"


def torus(around: int, across: int, is_shuffled: bool) -> tuple[Points, Floats]:
    """Return vertices (V, 3) of a rippled torus and its faces (F, 3)."""
    u = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)[:, None]
    v = np.linspace(0.0, 2.0 * np.pi, across, endpoint=False)[None, :]
    ring = 2.0 + 0.7 * np.cos(v)
    points = np.stack([ring * np.cos(u), 0.7 * np.sin(v) + 0.05 * np.sin(9 * u), ring * np.sin(u)], axis=2)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = i * across + j, (i + 1) % around * across + j
    c, d = (i + 1) % around * across + (j + 1) % across, i * across + (j + 1) % across
    faces = np.concatenate([np.stack([a, c, b], axis=2), np.stack([a, d, c], axis=2)]).reshape(-1, 3)
    order = np.arange(around * across)
    if is_shuffled:
        np.random.default_rng(0).shuffle(order)
    return points.reshape(-1, 3)[np.argsort(order)], order[faces]


def write(path: Path, points: Points, faces: Floats) -> None:
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "vx", "vy", "vz")]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    rows = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    body = np.hstack([points, np.tile([0.0, 0.24, 0.0], (len(points), 1))]).astype("<f4").tobytes()
    path.write_bytes("\n".join(header).encode() + body + rows.tobytes())


def measured(around: int, across: int, is_shuffled: bool) -> tuple[float, float]:
    """Return the CPU seconds of the second frame and its normals, and the peak of memory so far, GB."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        points, faces = torus(around, across, is_shuffled)
        for number in (1, 2):
            write(folder / f"torus_{number:04d}.ply", points + np.array([0.0, 0.01 * number, 0.0]), faces)
        (folder / "shot.yaml").write_text(SHOT.replace("####.ply", "####.ply, faces: changing"))
        shot = read_shot(folder / "shot.yaml")
        frames = animate(shot)
        next(frames)
        begun = time.process_time()
        frame = next(frames)
        shading = Shading.of(frame, shot.motion.thresholds_at(2), 1)
        seconds = time.process_time() - begun
        assert len(frame.mesh.faces) == len(faces) and shading is not None
    return seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def main() -> None:
    measured(20, 10, False)
    targets = []
    for order in ("in order", "shuffled"):
        seconds, peak = measured(1000, 500, order == "shuffled")
        targets.append(Target(f"a million triangles, {order}", "CPU seconds", seconds, most=1.0))
        targets.append(Target(f"a million triangles, {order}", "peak, GB", peak, most=1.2))
    rows = [target.row for target in targets]
    show("A frame of another program", rows)
    keep("moving_frames", rows)


if __name__ == "__main__":
    main()
