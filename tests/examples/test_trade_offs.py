"""The numbers behind the paper's trade-offs: small versions of what the pictures show."""

from __future__ import annotations

import math

import numpy as np
import pytest

from examples import density, hysteresis, low_pass, mesh_likeness, placements, splitting, tendril
from examples.film import RATE, edge_lengths
from flowsculpt.pipeline.resample import Thresholds

BRACKET = (density.RATIOS[1:] > 0.4) & (density.RATIOS[:-1] < 1.0)


@pytest.mark.slow
def test_a_resampled_surface_stays_mesh_like_and_another_does_not() -> None:
    static, adaptive = mesh_likeness.with_and_without(frames=180)
    assert adaptive[-1, 0] < 1.05 * adaptive[0, 0] and static[-1, 0] > 1.15 * static[0, 0]
    assert adaptive[-1, 1] > static[-1, 1] + 1.5


def test_edge_lengths_stay_within_limits_for_as_long_as_the_film_runs() -> None:
    static, adaptive, counts = density.histograms(frames=160)
    assert adaptive[:, BRACKET].sum(axis=1).min() > 0.97
    assert adaptive[:, density.RATIOS[:-1] >= 1.0].sum() == 0
    assert static[-1, BRACKET].sum() < 0.85
    assert counts[-1] > 1.05 * counts[0]


def test_wide_thresholds_do_less_and_let_lengths_spread() -> None:
    wide, usual, close = (hysteresis.film(ratio, frames=120) for ratio in (0.2, 0.4, 0.49))
    assert wide.operations < usual.operations < close.operations / 1.5
    assert wide.spread > usual.spread > close.spread


def test_without_hard_edges_a_cube_becomes_rounder_and_with_them_it_stays_a_cube() -> None:
    ball, soft = low_pass.twist_cube(math.pi, rounds=3)
    _, hard = low_pass.twist_cube(math.radians(40), rounds=3)
    assert (np.diff(soft) > 0.01).all()
    assert edge_lengths(ball).min() > 0.4 * low_pass.LONGEST, "no spike keeps the short edges of its base"
    assert abs(hard[-1] - hard[0]) < 0.01


def test_exact_placement_is_nearer_to_the_surface_than_curved_and_that_than_the_chord() -> None:
    chord, curved, exact = (placements.film(name, frames=20, every=20)[-1] for name in placements.NAMES)
    assert exact[0] < 1e-6 < curved[0] < chord[0] / 3
    assert exact[1] < 1.05 * curved[1] and curved[1] < chord[1]


def test_the_distance_from_the_exact_surface_is_measured_right() -> None:
    shell = 1.001 * placements.onto_ball(np.random.default_rng(1).normal(size=(50, 3)))
    assert np.allclose(placements.distances(shell, 0), 0.001, rtol=1e-3)


def test_faces_in_four_leave_lengths_more_uneven_than_edges_in_two() -> None:
    (*_, last), edges = splitting.split("edges", frames=120)
    _, faces = splitting.split("faces", frames=120)
    assert last.too_long == 0 and max(edges.max(), faces.max()) <= density.LONGEST
    assert faces.std() / faces.mean() > edges.std() / edges.mean()


def test_density_by_curvature_is_nearer_with_fewer_vertices() -> None:
    many, uniform = splitting.size_and_error(Thresholds(0.2), frames=20)
    few, curved = splitting.size_and_error(splitting.by_curvature(0.01), frames=20)
    assert few < 0.9 * many and curved < 0.9 * uniform


def test_a_tendril_thinner_than_the_minimum_keeps_its_length_and_withers_only_without_hard_edges() -> None:
    hard, soft = (tendril.pull_rod(angle) for angle in (tendril.HARD, tendril.NONE))
    thickness = 2 * tendril.RADIUS * math.exp(-tendril.PULL * tendril.FRAMES / (2 * RATE))
    assert thickness < 0.4 * tendril.LONGEST
    assert min(hard.lengths) > 0.99
    assert hard.volumes[-1] > 0.6 and soft.volumes[-1] < 0.4
