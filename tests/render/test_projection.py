"""Wide pictures: every place shows one direction, and that direction has that place."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.scene.render_camera import LEFT, RIGHT, Projection, pixel_places

SPHERICAL, DOME, VR180 = Projection("spherical"), Projection("dome"), Projection("vr180")
DOMES = st.builds(Projection, st.just("dome"), st.floats(0.1, 2.0 * math.pi))
WIDE = st.sampled_from([SPHERICAL, VR180]) | DOMES
INSIDE = st.floats(-0.999, 0.999)

FORWARD, BEHIND, LEFTWARDS, UPWARDS = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


@given(projection=WIDE, x=INSIDE, y=INSIDE)
def test_each_place_that_shows_something_is_found_again(projection: Projection, x: float, y: float) -> None:
    if projection.kind == "dome" and math.hypot(x, y) > 0.999:
        x, y = 0.7 * x, 0.7 * y
    direction = projection.directions((x, y))
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    assert projection.shows(direction) or projection.is_stereo  # the edge between both eyes' halves
    places = projection.places(3.0 * direction, projection.eyes(x))
    assert places == pytest.approx(np.array([x, y]), abs=1e-6)


@given(
    projection=WIDE,
    longitude=st.floats(-math.pi, math.pi),
    latitude=st.floats(-1.5, 1.5),
    eye=st.sampled_from([LEFT, RIGHT]),
)
def test_each_direction_that_is_shown_has_a_place(
    projection: Projection, longitude: float, latitude: float, eye: int
) -> None:
    level = math.cos(latitude)
    direction = np.array([level * math.sin(longitude), math.sin(latitude), level * math.cos(longitude)])
    if projection.shows(direction):
        place = projection.places(direction, eye)
        assert (np.abs(place) <= 1.0 + 1e-12).all()
        assert projection.directions(0.999999 * place) == pytest.approx(direction, abs=1e-4)


def test_a_spherical_picture_shows_all_around_with_forward_in_its_middle() -> None:
    places = SPHERICAL.places([FORWARD, LEFTWARDS, UPWARDS])
    assert places == pytest.approx(np.array([[0.0, 0.0], [-0.5, 0.0], [0.0, 1.0]]))
    assert abs(SPHERICAL.places(BEHIND)[0]) == pytest.approx(1.0)
    assert SPHERICAL.shows([FORWARD, BEHIND, LEFTWARDS, UPWARDS]).all()


def test_in_a_dome_the_angle_grows_evenly_from_the_middle_to_the_edge_of_the_circle() -> None:
    assert DOME.places([FORWARD, LEFTWARDS, UPWARDS]) == pytest.approx(
        np.array([[0.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])
    )
    halfway = DOME.places((0.0, 1.0, 1.0))
    assert halfway == pytest.approx(np.array([0.0, 0.5]))
    assert not DOME.shows(BEHIND)
    assert Projection("dome", 2.0 * math.pi).shows(BEHIND)


def test_beside_the_circle_of_a_dome_there_is_nothing() -> None:
    directions = DOME.directions(pixel_places(64, 64))
    assert np.isnan(directions).any(axis=2).mean() == pytest.approx(1.0 - math.pi / 4.0, abs=0.01)


def test_each_eye_has_half_of_a_vr180_picture_with_forward_in_its_middle() -> None:
    assert VR180.places(FORWARD, LEFT) == pytest.approx(np.array([-0.5, 0.0]))
    assert VR180.places(FORWARD, RIGHT) == pytest.approx(np.array([0.5, 0.0]))
    assert VR180.places(LEFTWARDS, RIGHT) == pytest.approx(np.array([0.0, 0.0]))
    assert not VR180.shows(BEHIND)
    assert (VR180.eyes(pixel_places(8, 4)[..., 0]) == [[LEFT] * 4 + [RIGHT] * 4] * 4).all()


def test_pictures_have_the_shape_of_their_projection() -> None:
    assert [p.aspect for p in (Projection(), SPHERICAL, DOME, VR180)] == [None, 2.0, 1.0, 2.0]


def test_pixels_are_placed_by_their_middles_from_the_upper_left() -> None:
    assert pixel_places(4, 2)[0, 0] == pytest.approx(np.array([-0.75, 0.5]))
    assert pixel_places(4, 2).shape == (2, 4, 2)


def test_an_unknown_projection_and_an_impossible_dome_are_refused() -> None:
    with pytest.raises(BadInputError, match="'cubic'; it can be perspective, spherical, dome, vr180"):
        Projection("cubic")
    with pytest.raises(BadInputError, match="angle must be above 0° and at most 360°"):
        Projection("dome", 7.0)
