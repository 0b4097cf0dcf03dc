"""Surfaces of several threads: each has the bits that it has alone, and no process ends."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.flow.catalogue.sampled_field import Sampled, Samples
from flowsculpt.pipeline.flow.regions import ClosedSurface
from flowsculpt.pipeline.kernels import BlockKernel
from flowsculpt.pipeline.mesh import box
from flowsculpt.pipeline.plugins.fields.attraction import Target, Wind
from flowsculpt.pipeline.plugins.fields.formula_field import FormulaField
from tests.needed_plugins import needs_plugins
from tests.resample.films import FILMS


def _differing(rounds: int) -> list[str]:
    """Return the films whose bits differ from those of the same film alone, of twelve in four threads."""
    alone = {name: film() for name, film in FILMS.items()}
    with ThreadPoolExecutor(4) as pool:
        made = list(pool.map(lambda name: (name, FILMS[name]()), rounds * list(FILMS)))
    return [name for name, digest in made if digest != alone[name]]


@needs_plugins("interchange", "polyhedra")
@pytest.mark.slow
def test_twelve_films_in_four_threads_have_the_bits_that_they_have_alone() -> None:
    assert len({film() for film in FILMS.values()}) == len(FILMS) == 12
    assert _differing(rounds=2) == []


@needs_plugins("interchange", "polyhedra")
@pytest.mark.soak
def test_four_hundred_films_in_four_threads_have_the_bits_that_they_have_alone() -> None:
    assert _differing(rounds=34) == []


GRID = Samples.of_arrays(
    (np.arange(2.0), np.arange(2.0), np.arange(2.0)), np.zeros(1), np.zeros((1, 2, 2, 2, 3)), ()
)


@pytest.mark.parametrize(
    ("value", "name"),
    [
        (Target.points(np.eye(3)), "tree"),
        (Wind(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))), "_curve"),
        (FormulaField(("y", "x", "1")), "block"),
        (Sampled(GRID), "_memory"),
        (ClosedSurface.of(box()), "lookup"),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_threads_that_first_use_a_flow_at_once_share_the_memory_whose_address_kernels_take(
    value: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed = vars(type(value))[name]
    original, both = computed.func, threading.Barrier(2)

    def slow(owner: Any) -> Any:
        with suppress(threading.BrokenBarrierError):  # where a lock lets one thread through only
            both.wait(0.5)
        return original(owner)

    monkeypatch.setattr(computed, "func", slow)
    with ThreadPoolExecutor(2) as pool:
        one, other = pool.map(lambda _: getattr(value, name), range(2))
    assert one is other is getattr(value, name)


STATISTICS = """
from concurrent.futures import ThreadPoolExecutor
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.statistics import mesh_statistics
from tests.needed_plugins import needs_plugins

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
