"""`python -m benchmarks.vertex_order`: a ball sheared for 60 frames, its vertices sorted or as born.

Both run side by side in one process. Times are CPU time of resampling alone.
"""

from __future__ import annotations

import math
import time

import numpy as np

from benchmarks.measures import edges_of, lengths_of
from benchmarks.play import warm
from benchmarks.report import Row, keep, show
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.resample import Resampler, Thresholds, resampler

FREQUENCY = 126
"""Frequency of the geodesic sphere: 10 n² + 2 vertices, 158,762."""

FRAMES, SHEAR, LAST = 60, 0.1, 10
SHARES = {"as born": math.inf, "sorted": resampler._NEW_SHARE}


def main() -> None:
    """Print the CPU time of a frame: mean, median and worst of all frames and of the last ones."""
    warm()
    ball = icosphere(FREQUENCY)
    longest = float(lengths_of(ball.vertices, edges_of(ball.faces)).mean()) / math.sqrt(0.4)
    surfaces = {name: Resampler(ball, Thresholds(longest)) for name in SHARES}
    spent: dict[str, list[float]] = {name: [] for name in SHARES}
    for _ in range(FRAMES):
        for name, surface in surfaces.items():
            resampler._NEW_SHARE = SHARES[name]
            surface.vertices[:, 0] += SHEAR * surface.vertices[:, 2]
            started = time.process_time()
            surface.resample()
            spent[name].append(1e3 * (time.process_time() - started))
    rows: list[Row] = [
        {
            "vertices": name,
            "at the end": float(len(surfaces[name].vertices)),
            "mean, ms": float(np.mean(spent[name])),
            f"mean of the last {LAST}": float(np.mean(spent[name][-LAST:])),
            "their median": float(np.median(spent[name][-LAST:])),
            "worst": max(spent[name]),
        }
        for name in SHARES
    ]
    keep("vertex_order", rows)
    show("A ball sheared for 60 frames", rows)


if __name__ == "__main__":
    main()
