"""Barr's deformations: one-parameter maps, applied from frame to frame."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.arrays import Points
from pipeline.errors import FrameError
from pipeline.flow import Flow, Keyframes, Sequence, Streamlines, keyed
from pipeline.flow import _kernels_deform as kernels
from pipeline.flow.catalogue import Rotation, Shear, Stretch, Taper, Twist

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


@pytest.mark.parametrize("kind", [Twist, Stretch, Taper, Shear])
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


def test_a_stretch_to_nothing_is_refused() -> None:
    with pytest.raises(FrameError, match="stretch amount 0 is not above 0"):
        Stretch(amount=keyed((0, 1), (1, 0))).displace(POINTS, 0.0, 1.0)


def test_no_amount_and_no_kind_of_array_compiles_anything() -> None:
    frozen = POINTS.copy()
    frozen.flags.writeable = False
    keys = Keyframes((0, 1), ((1,), (2,)), ("linear", "linear"))
    for flow in (Twist(amount=keys), Taper(amount=keys), Stretch(amount=keys), Shear(amount=keys)):
        for array in (POINTS, frozen, np.asfortranarray(POINTS)):
            flow.displace(array, 0, 1)
    used = (kernels.twist, kernels.taper, kernels.stretch, kernels.shear)
    assert [len(kernel.signatures) for kernel in used] == [1, 1, 1, 1]
