"""Every beginning of the sequence is spread evenly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.integrator.sampler import COORDINATES, LENGTH, LOBE, OwenSampler, points
from flowsculpt.render.mitsuba.engine import Engine


def places(first: int, count: int) -> np.ndarray:
    """(COORDINATES, count), 0 … 1"""
    digits = points(first, count)[..., None] >> np.arange(10) & 1
    return np.asarray(digits @ 0.5 ** np.arange(1, 11))


@given(log=st.integers(0, 10), block=st.integers(0, 3), pair=st.integers(0, COORDINATES // 2 - 1))
def test_as_many_points_as_rectangles_leave_none_empty(log: int, block: int, pair: int) -> None:
    count = 1 << log
    across, up = places(block * count, count)[2 * pair : 2 * pair + 2]
    for columns in (1 << n for n in range(log + 1)):
        rows = count // columns
        cells = np.floor(across * columns) * rows + np.floor(up * rows)
        assert len(np.unique(cells)) == count


@pytest.mark.parametrize(("count", "least"), [(16, 0.74), (64, 0.66)])
def test_points_are_even_by_coordinates_of_different_pairs_too(count: int, least: float) -> None:
    """In a square of as many cells most have a point, where chance would leave 37% empty."""
    side = int(count**0.5)
    cells = np.floor(places(0, count) * side)
    filled = [
        len(np.unique(side * cells[one] + cells[other])) / count
        for one in range(COORDINATES)
        for other in range(one)
    ]
    assert np.mean(filled) > least


def test_the_sequence_goes_on_where_it_was_left_and_begins_again_at_its_end() -> None:
    whole = points(0, 64)
    assert np.array_equal(np.concatenate([points(16 * i, 16) for i in range(4)], axis=1), whole)
    assert np.array_equal(points(LENGTH, 64), whole)
    assert len(np.unique(points(0, LENGTH)[5])) == LENGTH


def path_numbers(engine: Engine, vertex: int, coordinate: int, samples: int, first: int = 0) -> np.ndarray:
    """Random numbers (samples, pixels) of one vertex of a path."""
    if engine.variant == "scalar_rgb":
        pytest.skip("Mitsuba's own samplers serve the scalar variant")
    import mitsuba as mi

    sampler = OwenSampler(mi.UInt32(np.arange(4096, dtype=np.uint32)), first, samples, 3)
    numbers = []
    for sample in range(samples):
        sampler.sample = mi.UInt32(sample)
        numbers.append(np.array(sampler.vertex_1d(mi.UInt32(vertex), coordinate)))
    return np.array(numbers)


@pytest.mark.parametrize("vertex", [0, 1, 3, 7])
@pytest.mark.parametrize("first", [0, 48])
def test_each_vertex_has_one_number_in_each_interval(engine: Engine, vertex: int, first: int) -> None:
    numbers = path_numbers(engine, vertex, LOBE, 16, first)
    assert (np.sort(np.floor(numbers * 16), axis=0) == np.arange(16)[:, None]).all()
    assert numbers.mean() == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize(("one", "other"), [(0, 1), (0, 3), (1, 4), (3, 6)])
def test_products_of_two_vertices_vary_about_as_those_of_random_numbers(
    engine: Engine, one: int, other: int
) -> None:
    """Vertex 3 has the points of vertex 0: in the same order, the variance would be nine times as much. Pairs
    of points stay together when they are shuffled, which makes it 1.5 times.
    """
    first, second = (path_numbers(engine, vertex, LOBE, 16) - 0.5 for vertex in (one, other))
    assert (first * second).mean(axis=0).var() < 1.6 / 12.0**2 / 16.0
