"""`python -m benchmarks.renewal`: error and time of exact placement by rest interval.

The films of `benchmarks.normals`, with a new rest surface every so many frames. Distances are from the exact
surface at the last frame, in maximum edge lengths; normals are compared with the exact ones there.
"""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.normals import Ball, Row, angles, back, exact_normals, films
from flowsculpt.pipeline.animation import MeshFrame, animate
from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.mesh import split_at_creases
from flowsculpt.pipeline.mesh.normals import unit
from flowsculpt.pipeline.shot import Motion

OUT = Path(__file__).parent / "out"
NEVER = 1000
PERIODS = (NEVER, 60, 30, 15)


def main() -> None:
    """Measure both films with every interval; write the numbers."""
    rows = [measure(name, motion, interval) for name, motion in films().items() for interval in PERIODS]
    OUT.mkdir(exist_ok=True)
    (OUT / "renewal.json").write_text(json.dumps(rows, indent=1) + "\n")
    print("".join(f"{name:>14}" for name in rows[0]))
    for row in rows:
        print("".join(f"{v if isinstance(v, str) else format(v, '.3g'):>14}" for v in row.values()))


def measure(name: str, motion: Motion, interval: int) -> Row:
    """Run one film to its end; return its row."""
    assert motion.resampling is not None
    motion = replace(motion, resampling=replace(motion.resampling, rest_interval=interval))
    start = time.perf_counter()
    *_, last = animate(motion)
    seconds = time.perf_counter() - start
    off = np.abs(distances(motion, last))
    errors = np.degrees(angles(split_at_creases(last.mesh).normals[: len(off)], exact_normals(motion, last)))
    return {
        "film": name,
        "interval": "never" if interval == NEVER else str(interval),
        "s": seconds,
        "off: rms": float(np.sqrt(np.mean(off**2))),
        "off: 99%": float(np.quantile(off, 0.99)),
        "normals: 50%": float(np.median(errors)),
        "95%": float(np.quantile(errors, 0.95)),
    }


def distances(motion: Motion, frame: MeshFrame) -> Floats:
    """Return signed distances (V,) of the vertices from the exact surface, in maximum edge lengths.

    To first order: the height above the ball at rest over its gradient at the vertex.
    """
    assert isinstance(motion.subject, Ball) and motion.resampling is not None
    longest = motion.resampling.thresholds.max_edge_length
    assert isinstance(longest, float)
    ball, points, h = motion.subject, frame.mesh.vertices, 1e-4 * longest
    along = h * unit(exact_normals(motion, frame))
    asked = np.concatenate([points, points + along, points - along])
    heights = np.linalg.norm(back(motion, frame.number, asked) - np.array(ball.centre), axis=1) - ball.radius
    here, above, below = np.split(heights, 3)
    steepness = (above - below) / (2 * h)
    return np.asarray(here / steepness / longest)


if __name__ == "__main__":
    main()
