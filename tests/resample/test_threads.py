"""Surfaces of several threads: each has the bits that it has alone, and no process ends."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.kernels import BlockKernel
from flowsculpt.pipeline.mesh import icosphere, vertex_normals
from flowsculpt.pipeline.resample import Chord, Curved, Exact, Resampler, Thresholds
from flowsculpt.pipeline.resample.placement import Placement


def _twisted(points: Points) -> Points:
    angle, grown = 0.15 * points[:, 1], points * [1.06, 1.02, 0.95]
    x, y, z = grown.T
    return np.column_stack([x * np.cos(angle) - z * np.sin(angle), y, x * np.sin(angle) + z * np.cos(angle)])


def _film_of(placement: Callable[[list[int]], Placement], size: int, frames: int = 10) -> str:
    """Return the digest of the last frame of a sphere that is twisted."""
    now, sphere = [0], icosphere(size)
    mesh = sphere.with_attributes(normal=vertex_normals(sphere))
    resampler = Resampler(mesh, Thresholds(max_edge_length=0.09), placement(now))
    for frame in range(1, frames):
        now[0] = frame
        resampler.vertices[:] = _twisted(resampler.vertices)
        resampler.resample()
    last = resampler.mesh
    return hashlib.sha256(last.vertices.tobytes() + last.faces.tobytes()).hexdigest()


PLACEMENTS = {
    "chord": lambda now: Chord(),
    "curved": lambda now: Curved(),
    "exact": lambda now: Exact(lambda rest: _carried(rest, now[0])),
}


def _carried(rest: Points, frames: int) -> Points:
    for _ in range(frames):
        rest = _twisted(rest)
    return rest


@pytest.mark.parametrize("placement", PLACEMENTS)
def test_films_of_four_threads_have_the_bits_of_films_one_after_the_other(placement: str) -> None:
    sizes = [12, 13, 14, 15]
    alone = [_film_of(PLACEMENTS[placement], size) for size in sizes]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(3):
            together = pool.map(lambda size: _film_of(PLACEMENTS[placement], size), sizes)
            assert list(together) == alone


STATISTICS = """
from concurrent.futures import ThreadPoolExecutor
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.statistics import mesh_statistics

with ThreadPoolExecutor(4) as pool:
    print(len(set(pool.map(mesh_statistics, 40 * [icosphere(12)]))))
"""


@pytest.mark.slow
@pytest.mark.parametrize("layer", ["workqueue", "tbb", "best"])
def test_kernels_that_start_threads_run_in_several_threads_under_any_layer(layer: str) -> None:
    environment = {**os.environ, "NUMBA_THREADING_LAYER": layer}
    done = subprocess.run(
        [sys.executable, "-c", STATISTICS], env=environment, capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "1\n", "")


def test_threads_share_the_function_that_was_compiled_first() -> None:
    def add_one(numbers, count, x, y, z, t, u, v, w):
        for i in range(count):
            u[i] += 1.0

    block = BlockKernel(add_one)
    with ThreadPoolExecutor(4) as pool:
        assert len(set(pool.map(lambda _: block.address, range(4)))) == 1
