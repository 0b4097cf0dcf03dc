"""A card stands straight ahead of whoever looks around in a wide picture, upright and undistorted."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.graphics.cards import ANGLE, Screen
from flowsculpt.render.scene.render_camera import PERSPECTIVE, Projection

SIZES = {"spherical": (256, 128), "vr180": (256, 128), "dome": (128, 128)}
WIDE = pytest.mark.parametrize("kind", SIZES)


def ramps(size: tuple[int, int]) -> np.ndarray:
    """A card whose red is its place across, 0 … 1, its green that downwards, and its blue 1."""
    across, down = np.meshgrid(*((np.arange(side) + 0.5) / side for side in size))
    return np.stack([across, down, np.ones_like(across)], axis=-1).astype(np.float32)


@cache
def picture_of(kind: str) -> np.ndarray:
    screen = Screen(Projection(kind), SIZES[kind])
    return screen.show(ramps(screen.size))


def test_a_card_fills_a_perspective_picture() -> None:
    screen = Screen(PERSPECTIVE, (48, 27))
    card = ramps(screen.size)
    assert screen.size == (48, 27)
    assert screen.show(card) is card


@WIDE
@given(right=st.floats(-0.99, 0.99), up=st.floats(-0.99, 0.99))
def test_straight_lines_of_a_card_look_straight(kind: str, right: float, up: float) -> None:
    """Each place of the card is seen where a flat screen before the viewer has it."""
    projection, size = Projection(kind), SIZES[kind]
    width, height = Screen(projection, size).size
    shown = picture_of(kind)
    half = np.tan(ANGLE / 2.0)
    direction = [right * half, up * half * height / width, 1.0]
    for eye in (-1, 1):
        x, y = projection.places(direction, eye)
        column, row = (int(part) for part in ((x + 1.0) / 2.0 * size[0], (1.0 - y) / 2.0 * size[1]))
        red, green, blue = shown[row, column]
        if blue > 0.0:  # the pixel of an edge may lie beside the card
            assert abs(red - (right + 1.0) / 2.0) < 1.5 / width
            assert abs(green - (1.0 - up) / 2.0) < 1.5 / height
        else:
            assert max(abs(right), abs(up)) > 1.0 - 2.5 / min(width, height)


@WIDE
def test_all_around_a_card_is_black(kind: str) -> None:
    seen = picture_of(kind)[..., 2]
    assert set(np.unique(seen.round(4))) == {0.0, 1.0}
    width, height = Screen(Projection(kind), SIZES[kind]).size
    per_eye = seen.sum() / (2.0 if kind == "vr180" else 1.0)
    assert 0.7 < per_eye / (width * height) < 1.1, "and it is drawn about as fine as it is shown"


def test_both_eyes_see_the_same_card() -> None:
    left, right = np.hsplit(picture_of("vr180"), 2)
    assert left.any()
    assert (left == right).all()
