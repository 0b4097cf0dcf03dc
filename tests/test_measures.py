"""Measures that benchmarks of pictures use."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.cycles import Truth
from benchmarks.equal_quality import Best
from benchmarks.errors import psnr, shown
from flowsculpt.render.scene.surface import Surface


def test_the_time_to_an_error_lies_on_the_line_of_logarithms() -> None:
    best = Best([16, 32, 64], [1.0, 2.0, 4.0], [np.array(1 / n**0.5) for n in (1, 2, 4)])
    assert best.until(float, 3**-0.5) == pytest.approx(3.0)
    assert best.until(float, 0.25) == pytest.approx(16.0), "it goes on beyond the last picture"


def test_the_noise_of_a_truth_is_no_error_of_the_picture() -> None:
    drawn = np.random.default_rng(3)
    right = np.full((120, 160, 3), 0.2)

    def noisy(strength: float) -> np.ndarray:
        return right + strength * drawn.normal(size=right.shape)

    truth = Truth(noisy(0.02), noisy(0.02))
    true = 255.0 * float(np.sqrt(((shown(picture := noisy(0.01)) - shown(right)) ** 2).mean()))
    assert truth.error(picture) == pytest.approx(true, rel=0.1)


def test_ten_times_the_difference_on_a_display_is_20_decibels_less() -> None:
    right = np.full((8, 8, 3), 0.2)
    near, far = psnr(right * 1.0002, right), psnr(right * 1.002, right)
    assert near - far == pytest.approx(20.0, abs=0.3)


def test_bounds_of_a_surface_are_its_least_and_greatest_coordinates() -> None:
    points = np.random.default_rng(4).normal(size=(50, 3)).astype(np.float32)
    low, high = Surface(points, points, np.zeros((1, 3), np.int32)).bounds
    assert np.array_equal(low, points.min(axis=0)) and np.array_equal(high, points.max(axis=0))
