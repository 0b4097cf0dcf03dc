"""Velocity programs: brackets, regions, frames and functions from elsewhere."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.flow import Streamlines, Sum, VelocityField
from flowsculpt.pipeline.flow.catalogue.basic import Rotation, Strain
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.flow.kernels import instructions as op
from flowsculpt.pipeline.flow.kernels.field_kernels import level_count, velocities
from flowsculpt.pipeline.flow.kernels.region_kernels import weights
from flowsculpt.pipeline.flow.velocity import Instruction, Program, grouped, opcodes_of, scaled, transformed
from flowsculpt.pipeline.kernels import BLOCK_SIGNATURE

POINTS = np.random.default_rng(5).normal(size=(700, 3))
VORTEX, STRAIN = Vortex(radius=0.7, strength=3.0), Strain(axis=(1.0, 2.0, 0.3), rate=0.8)
BALL = Instruction(op.CLOSE_BALL, (0.3, 0.0, 0.0, 0.8, 0.0, 0.0, 0.5, 1.0, 0.0))
BOX = Instruction(op.CLOSE_BOX, (0.3, 0.0, 0.0, 0.8, 0.4, 0.2, 0.5, 1.0, 0.0))
HALF_SPACE = Instruction(op.CLOSE_HALF_SPACE, (0.3, 0.0, 0.0, 0.6, 0.8, 0.0, 0.5, 1.0, 0.0))
REGIONS = (BALL, BOX, HALF_SPACE)


@dataclass(frozen=True)
class Programmed(VelocityField):
    """Any program as a field."""

    rows: Program

    def program(self, time: float) -> Program:
        return self.rows

    def gradient_bound(self, time: float) -> float:
        return 5.0

    def length_scale(self, time: float) -> float:
        return math.inf


def velocity(rows: Program, points: Points = POINTS) -> Points:
    return Programmed(rows).velocity(points, 0.0)


def weight(closing: Instruction, points: Points = POINTS) -> Floats:
    out = np.empty(len(points))
    row = np.zeros(op.COLUMNS)
    row[: len(closing.numbers)] = closing.numbers
    weights(points, closing.opcode, row, out)
    return out


def test_a_group_is_added_with_its_factor() -> None:
    one, two = VORTEX.program(0.0), STRAIN.program(0.0)
    expected = VORTEX.velocity(POINTS, 0.0) + 0.25 * STRAIN.velocity(POINTS, 0.0)
    np.testing.assert_allclose(velocity(one + scaled(two, 0.25)), expected, atol=1e-14)


@pytest.mark.parametrize("closing", REGIONS, ids=["ball", "box", "half-space"])
def test_a_group_acts_in_its_region_alone(closing: Instruction) -> None:
    found = velocity(grouped(VORTEX.program(0.0), closing))
    share = weight(closing)
    np.testing.assert_allclose(found, share[:, None] * VORTEX.velocity(POINTS, 0.0), atol=1e-14)
    assert (share == 1).sum() > 20 and (share == 0).sum() > 20 and ((share > 0) & (share < 1)).sum() > 20


@pytest.mark.parametrize("closing", REGIONS, ids=["ball", "box", "half-space"])
def test_what_acts_inside_and_what_acts_outside_are_the_whole(closing: Instruction) -> None:
    outside = closing._replace(numbers=(*closing.numbers[:7], 0.0, 1.0))
    inner = VORTEX.program(0.0)
    both = velocity(grouped(inner, closing) + grouped(inner, outside))
    np.testing.assert_allclose(both, VORTEX.velocity(POINTS, 0.0), atol=1e-14)


def test_a_region_is_as_large_as_it_says_and_falls_smoothly() -> None:
    heights = np.linspace(-0.2, 1.2, 281)
    along = np.stack([0 * heights + 0.3, 0.4 + 0.5 * heights, 0 * heights], axis=1)
    t = np.clip(heights, 0, 1)
    smooth = 1 - t**3 * (10 - 15 * t + 6 * t * t)
    np.testing.assert_allclose(weight(BOX, along), smooth, atol=1e-13)
    np.testing.assert_allclose(weight(BALL, along + np.array([0.0, 0.4, 0.0])), smooth, atol=1e-13)
    steepest = np.abs(np.diff(weight(BOX, along)) / (0.5 * np.diff(heights))).max()
    assert steepest <= 1.875 / 0.5


def test_without_a_falloff_a_region_ends_at_once() -> None:
    sharp = BALL._replace(numbers=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0))
    inside = np.linalg.norm(POINTS, axis=1) <= 1.0
    np.testing.assert_array_equal(weight(sharp), inside.astype(float))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_a_placed_field_is_the_field_seen_from_its_frame(seed: int) -> None:
    """v(x) = M f(M⁻¹ (x − c)): turned, scaled, mirrored or slanted, as M is."""
    rng = np.random.default_rng(seed)
    matrix, centre = np.eye(3) + 0.4 * rng.normal(size=(3, 3)), rng.normal(size=3)
    inside = np.linalg.solve(matrix, (POINTS - centre).T).T
    expected = STRAIN.velocity(inside, 0.0) + VORTEX.velocity(inside, 0.0)
    found = velocity(transformed(STRAIN.program(0.0) + VORTEX.program(0.0), tuple(centre), matrix))
    np.testing.assert_allclose(found, expected @ matrix.T, rtol=1e-6, atol=1e-9)


def test_brackets_nest() -> None:
    inner = scaled(grouped(VORTEX.program(0.0), BALL) + STRAIN.program(0.0), 0.5)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rows = STRAIN.program(0.0) + transformed(inner, (0.1, 0.2, 0.3), turn)
    here = (POINTS - [0.1, 0.2, 0.3]) @ turn
    nested = 0.5 * (weight(BALL, here)[:, None] * VORTEX.velocity(here, 0.0) + STRAIN.velocity(here, 0.0))
    np.testing.assert_allclose(velocity(rows), STRAIN.velocity(POINTS, 0.0) + nested @ turn.T, atol=1e-13)
    assert level_count(opcodes_of(rows)) == 4 and level_count(opcodes_of(VORTEX.program(0.0))) == 1


def test_a_composition_moves_points_as_it_does_evaluated_apart() -> None:
    """A rigid turn within a ball: inside, the exact rotation, since circles stay there; outside, nothing."""
    ball = BALL._replace(numbers=(0.0, 0.0, 0.0, 1.5, 0.0, 0.0, 0.0, 1.0, 0.0))
    field = Programmed(grouped(Rotation(axis=(0.0, 0.0, 1.0)).program(0.0), ball))
    moved = Streamlines(field, 20).displace(POINTS, 0.0, 1.0)
    c, s = math.cos(1.0), math.sin(1.0)
    turned = POINTS @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T
    near = np.linalg.norm(POINTS, axis=1)
    np.testing.assert_allclose(moved[near < 1.4], turned[near < 1.4], atol=1e-6)
    np.testing.assert_array_equal(moved[near > 1.6], POINTS[near > 1.6])


def test_a_points_bits_do_not_depend_on_its_neighbours() -> None:
    rows = scaled(grouped(VORTEX.program(0.0), BALL) + STRAIN.program(0.0), 0.5) + VORTEX.program(0.0)
    flow = Streamlines(Programmed(rows), 3)
    whole = flow.displace(POINTS, 0.0, 0.2)
    for first, last in ((0, 1), (13, 14), (250, 262), (255, 699), (699, 700)):
        part = flow.displace(POINTS[first:last], 0.0, 0.2)
        assert part.tobytes() == whole[first:last].tobytes()


@pytest.fixture(scope="module")
def saddle() -> Any:
    """A function of the form that programs call: numbers[0] · (x + t, −y, 0)."""

    @numba.cfunc(BLOCK_SIGNATURE)
    def function(numbers: Any, n: int, x: Any, y: Any, z: Any, t: float, u: Any, v: Any, w: Any) -> None:
        for i in range(n):
            u[i] += numbers[0] * (x[i] + t)
            v[i] -= numbers[0] * y[i]

    return function


def test_a_function_from_elsewhere_is_a_leaf_like_any_other(saddle: Any) -> None:
    row = Instruction(op.EXTERNAL, (float(saddle.address), 0.5, 3.0), {"saddle": 3.0})
    found = velocity(VORTEX.program(0.0) + scaled((row,), 2.0))
    own = 6.0 * np.stack([POINTS[:, 0] + 0.5, -POINTS[:, 1], 0 * POINTS[:, 2]], axis=1)
    np.testing.assert_allclose(found, VORTEX.velocity(POINTS, 0.0) + own, atol=1e-13)


def test_keys_never_hold_an_address(saddle: Any) -> None:
    row = Instruction(op.EXTERNAL, (float(saddle.address), 0.5, 3.0), {"saddle": 3.0})
    data = Streamlines(Sum((VORTEX, Programmed((row,))))).cache_data(0.0, 0.1)
    assert json.loads(json.dumps(data)) == data
    assert str(saddle.address) not in json.dumps(data) and '"saddle"' in json.dumps(data)


def test_no_composition_compiles_anything() -> None:
    for rows in (scaled(VORTEX.program(0.0), 2.0), grouped(STRAIN.program(0.0), BALL), ()):
        velocity(rows)
        Streamlines(Programmed(rows), 2).displace(POINTS, 0.0, 0.1)
    assert len(velocities.signatures) == 1
