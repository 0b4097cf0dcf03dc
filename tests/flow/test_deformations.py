"""Barr's deformations: one-parameter maps, applied from frame to frame."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.flow import Flow, Keyframes, Sequence, Streamlines, keyed
from flowsculpt.pipeline.flow.catalogue.basic import Rotation
from flowsculpt.pipeline.flow.catalogue.deformations import Bend, Shear, Stretch, Taper, Twist
from flowsculpt.pipeline.flow.kernels import streamline_kernels as kernels

POINTS = np.random.default_rng(2).uniform(-1, 1, size=(300, 3))
SECONDS = 100 / 24


def over_hundred_frames(flow: Flow) -> Points:
    points = POINTS
    for frame in range(100):
        points = flow.displace(points, frame / 24, (frame + 1) / 24 - frame / 24)
    return points


def test_a_twist_keyed_over_a_hundred_frames_is_the_closed_form() -> None:
    amount = math.radians(200)
    moved = over_hundred_frames(Twist(amount=keyed((0.0, SECONDS), (0.0, amount), "cubic_in_out")))
    angle = amount * POINTS[:, 1]
    x, z = POINTS[:, 0], POINTS[:, 2]
    closed = np.stack(
        [x * np.cos(angle) + z * np.sin(angle), POINTS[:, 1], z * np.cos(angle) - x * np.sin(angle)], axis=1
    )
    np.testing.assert_allclose(moved, closed, atol=1e-12)


def test_a_stretch_keyed_over_a_hundred_frames_is_the_closed_form() -> None:
    moved = over_hundred_frames(Stretch(amount=keyed((0.0, SECONDS), (1.0, 3.0))))
    np.testing.assert_allclose(moved, POINTS * [3**-0.5, 3, 3**-0.5], atol=1e-12)


def test_a_stretch_may_leave_the_width_alone() -> None:
    moved = over_hundred_frames(Stretch(amount=keyed((0.0, SECONDS), (1.0, 3.0)), keep_volume=False))
    np.testing.assert_allclose(moved, POINTS * [1, 3, 1], atol=1e-12)


def test_a_taper_keyed_over_a_hundred_frames_is_the_closed_form() -> None:
    moved = over_hundred_frames(Taper(amount=keyed((0.0, SECONDS), (0.0, -0.7))))
    width = np.exp(-0.7 * POINTS[:, 1])
    np.testing.assert_allclose(moved, POINTS * np.stack([width, 1 + 0 * width, width], axis=1), atol=1e-12)


def test_a_shear_keyed_over_a_hundred_frames_is_the_closed_form() -> None:
    moved = over_hundred_frames(Shear(amount=keyed((0.0, SECONDS), (0.0, 1.5))))
    np.testing.assert_allclose(moved, POINTS + 1.5 * POINTS[:, 1:2] * [1, 0, 0], atol=1e-12)


def test_a_shear_slides_across_its_axis_whatever_the_direction_given() -> None:
    level, tilted = (Shear(direction=d, amount=keyed((0, 1), (0, 1))) for d in ((1, 0, 0), (1, 5, 0)))
    np.testing.assert_allclose(
        tilted.displace(POINTS, 0.0, 1.0), level.displace(POINTS, 0.0, 1.0), atol=1e-14
    )


@pytest.mark.parametrize("kind", [Twist, Stretch, Taper, Shear, Bend])
def test_a_constant_amount_moves_nothing(kind: type[Flow]) -> None:
    np.testing.assert_array_equal(kind().displace(POINTS, 0.3, 0.5), POINTS)


@settings(max_examples=25, deadline=None)
@given(st.floats(-3, 3), st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 1))
def test_deformations_about_a_tilted_line_undo_themselves(a: float, x: float, z: float, ay: float) -> None:
    line = {"axis": (x, ay, z), "centre": (x, 0.0, -z)}
    for flow in (Twist(amount=keyed((0, 1), (0, a)), **line), Taper(amount=keyed((0, 1), (0, a)), **line)):
        there = flow.displace(POINTS, 0.0, 1.0)
        np.testing.assert_allclose(flow.displace(there, 1.0, -1.0), POINTS, atol=1e-9)


def test_what_other_flows_do_in_between_is_kept() -> None:
    """A twist about the axis of a rotation commutes with it: together they do what each does alone."""
    twist = Twist(amount=keyed((0.0, SECONDS), (0.0, 2.0)))
    rotation = Streamlines(Rotation(speed=0.4), 40)
    together = over_hundred_frames(Sequence((twist, rotation)))
    alone = rotation.displace(over_hundred_frames(twist), 0.0, SECONDS)
    np.testing.assert_allclose(together, alone, atol=1e-6)


def bent(curvature: float, half: float) -> Points:
    """Barr's bend of POINTS about z: y becomes an arc that opens towards x, straight on beyond its ends."""
    x, y, z = POINTS.T
    along = np.clip(y, -half, half)
    angle, radius = curvature * along, 1 / curvature - x
    over = y - along
    return np.stack(
        [
            1 / curvature - radius * np.cos(angle) + over * np.sin(angle),
            radius * np.sin(angle) + over * np.cos(angle),
            z,
        ],
        axis=1,
    )


@pytest.mark.parametrize("length", [1.2, 3.0])
def test_a_bend_keyed_over_a_hundred_frames_is_the_closed_form(length: float) -> None:
    moved = over_hundred_frames(Bend(amount=keyed((0.0, SECONDS), (0.0, 0.8)), length=length))
    np.testing.assert_allclose(moved, bent(0.8, length / 2), atol=1e-12)
    back = over_hundred_frames(Bend(amount=keyed((0.0, SECONDS), (0.0, -0.8)), length=length))
    mirrored = Bend(amount=keyed((0, 1), (0, 0.8)), length=length).displace(POINTS * [-1, 1, 1], 0.0, 1.0)
    np.testing.assert_allclose(back * [-1, 1, 1], mirrored, atol=1e-12)


def test_a_rod_bent_all_the_way_round_is_a_ring() -> None:
    heights = np.linspace(-1.0, 1.0, 101)
    rod = np.stack([0 * heights, heights, 0 * heights], axis=1)
    ring = Bend(amount=keyed((0, 1), (0, math.pi)), length=2.0).displace(rod, 0.0, 1.0)
    np.testing.assert_allclose(ring[0], ring[-1], atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(ring - [1 / math.pi, 0, 0], axis=1), 1 / math.pi, atol=1e-14)
    steps = np.linalg.norm(np.diff(ring, axis=0), axis=1)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(0.5, 4.0))
def test_a_bend_about_a_tilted_line_undoes_itself(before: float, after: float, length: float) -> None:
    line = {"axis": (0.3, 1.0, -0.4), "direction": (1.0, 1.0, 0.0), "centre": (0.1, 0.2, -0.1)}
    flow = Bend(amount=keyed((0, 1), (before, after)), length=length, **line)
    start = Bend(amount=keyed((0, 1), (0.0, before)), length=length, **line).displace(POINTS, 0.0, 1.0)
    there = flow.displace(start, 0.0, 1.0)
    np.testing.assert_allclose(flow.displace(there, 1.0, -1.0), start, atol=1e-9)


def test_a_bend_of_more_than_a_whole_turn_is_refused() -> None:
    with pytest.raises(FrameError, match=r"turns a length of 2 by 458\.366 degrees; 360 are the most"):
        Bend(amount=keyed((0, 1), (0, 4.0))).displace(POINTS, 0.0, 1.0)


def test_a_stretch_to_nothing_is_refused() -> None:
    with pytest.raises(FrameError, match="stretch amount 0 is not above 0"):
        Stretch(amount=keyed((0, 1), (1, 0))).displace(POINTS, 0.0, 1.0)


def test_no_amount_and_no_kind_of_array_compiles_anything() -> None:
    frozen = POINTS.copy()
    frozen.flags.writeable = False
    keys = Keyframes((0, 1), ((1,), (2,)), ("linear", "linear"))
    for flow in (
        Twist(amount=keys),
        Taper(amount=keys),
        Stretch(amount=keys),
        Shear(amount=keys),
        Bend(amount=keys),
    ):
        for array in (POINTS, frozen, np.asfortranarray(POINTS)):
            flow.displace(array, 0, 1)
    assert len(kernels.advect.signatures) == 1
