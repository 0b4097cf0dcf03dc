"""Flows of crossed waves: their own equations, gradients and keys."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.flow import Streamlines
from flowsculpt.pipeline.plugins.waves.wave_flows import Kneading, TaylorGreen

POINTS = np.random.default_rng(3).normal(size=(60, 3))


def test_nothing_crosses_the_walls_between_the_cells_of_taylor_and_green() -> None:
    walls = np.concatenate([POINTS * [0, 1, 1] + [1.5, 0, 0], POINTS * [0, 1, 1] - [3.0, 0, 0]])
    assert np.abs(TaylorGreen(scale=1.5).velocity(walls, 0.0)[:, 0]).max() < 1e-14
    assert np.abs(TaylorGreen().velocity(POINTS, 0.0)[:, 2]).max() == 0.0


def test_a_stroke_of_kneading_moves_the_crests_by_its_amount_and_no_more() -> None:
    kneading = Kneading(scale=4.0, amount=0.8, period=3.0)
    crest = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.3, 0.0, 0.0]])
    moved = Streamlines(kneading, 60).displace(crest, 0.0, 1.0)
    np.testing.assert_allclose(moved - crest, [[0.8, 0, 0], [-0.8, 0, 0], [0, 0, 0]], atol=1e-6)


@pytest.mark.slow
def test_kneading_draws_lines_out_by_half_as_much_again_in_every_period() -> None:
    along = np.linspace(0, 1, 4_000)
    line = np.stack([along, 0.3 + 0 * along, 0.2 + 0 * along], axis=1)
    flow, lengths = Streamlines(Kneading(amount=1.6, period=3.0)), []
    for period in range(5):
        line = flow.displace(line, 3.0 * period, 3.0)
        lengths.append(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    growth = np.array(lengths[1:]) / lengths[:-1]
    assert growth.min() > 1.4


@pytest.mark.parametrize("field", [TaylorGreen(scale=0.7), Kneading(amount=0.8)], ids=lambda f: f.name)
def test_waves_keep_volume_and_their_gradients_stay_below_the_bound(field: Any) -> None:
    h, time = 1e-5, 0.4
    columns = [
        (field.velocity(POINTS + a, time) - field.velocity(POINTS - a, time)) / (2 * h) for a in h * np.eye(3)
    ]
    gradients = np.stack(columns, axis=2)
    assert np.abs(np.trace(gradients, axis1=1, axis2=2)).max() < 1e-8
    assert np.linalg.norm(gradients, ord=2, axis=(1, 2)).max() <= field.gradient_bound(time) * (1 + 1e-6)


def test_waves_that_do_not_change_are_equal_motion_at_every_time() -> None:
    now, later = ([row.as_data() for row in TaylorGreen().program(time)] for time in (0.0, 2.0))
    assert now == later
