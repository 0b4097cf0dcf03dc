"""Framing of cameras that say more of themselves than from where: lenses, dollies, places, orbits."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.production.request.framing import (
    FOOTING,
    STEADINESS,
    BoundingSpheres,
    Framer,
    Framing,
)
from flowsculpt.pipeline.shot.camera_path import Lens, View
from flowsculpt.render.base.serialise import from_plain, to_plain

pytestmark = pytest.mark.quick

ASPECT = 16 / 9
PLAIN = View(0.4, 0.25, math.radians(26), 0.08)
SEEN_FROM = 3 * STEADINESS
"""Frames before an edit from which on its camera may change: aims, the envelope, its smoothing."""

CUBE = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T.astype(float)

numbers = st.floats(-1.5, 1.5)
lenses = st.none() | st.builds(
    Lens, st.floats(20, 200), st.floats(1, 22), st.none() | st.floats(1, 1000), st.none() | st.floats(1, 9)
)
views = st.builds(
    View,
    numbers,
    numbers,
    st.floats(0.1, 2.0),
    st.floats(0, 0.3),
    roll=numbers,
    orbit=numbers,
    dolly=st.floats(0.2, 2),
    distance=st.none() | st.floats(3, 30),
    target=st.none() | st.tuples(numbers, numbers, numbers),
    position=st.none() | st.tuples(numbers, numbers, st.floats(4, 9)),
    lens=lenses,
)


def cubes(sizes: list[float]) -> list[np.ndarray]:
    return [CUBE * (1 + size) + size for size in sizes]


def framed(view: View, frames: int = 3, follow: float = 1.0) -> Framing:
    return Framer([view] * frames, lambda i: CUBE, ASPECT, follow).all()[0]


def away(framing: Framing) -> float:
    return math.dist(framing.camera.origin, framing.camera.target)


@settings(max_examples=15, deadline=None)
@given(
    views,
    st.lists(st.floats(0, 1), min_size=SEEN_FROM + 3, max_size=SEEN_FROM + 12),
    st.floats(2, 4),
    st.data(),
)
def test_an_edit_leaves_all_cameras_that_are_early_enough_to_the_last_bit(view, sizes, other, data):
    """Whatever the camera is, and whether the sculpture or the view is edited."""
    last = len(sizes) - 1
    edited = data.draw(st.integers(SEEN_FROM + 1, last))
    changed = [other if i >= edited else size for i, size in enumerate(sizes)]
    before, after, seen_otherwise = (
        Framer(looks, lambda i, kept=kept: cubes(kept)[i], ASPECT).all()
        for kept, looks in (
            (sizes, [view] * len(sizes)),
            (changed, [view] * len(sizes)),
            (
                sizes,
                [view if i < edited else view._replace(elevation=0.1, margin=0.3) for i in range(last + 1)],
            ),
        )
    )
    assert before[: edited - SEEN_FROM] == after[: edited - SEEN_FROM]
    assert before[: edited - SEEN_FROM] == seen_otherwise[: edited - SEEN_FROM]
    assert FOOTING < STEADINESS and before[last] != after[last]


@settings(max_examples=40, deadline=None)
@given(views, st.integers(1, 12))
def test_what_a_view_says_itself_is_taken_as_it_is(view, frames):
    framing = framed(view, frames)
    if view.target is not None:
        assert framing.camera.target == view.target
    if view.position is not None:
        assert framing.camera.origin == view.position
    elif view.distance is not None:
        assert away(framing) == pytest.approx(view.distance)
    right, _, forward = framing.camera.axes()
    if view.position is None:
        elevation = math.asin(np.clip(-forward[1], -1, 1))
        assert elevation == pytest.approx(math.asin(math.sin(view.elevation)), abs=1e-6)
    assert right[1] == pytest.approx(-math.sin(view.roll) * math.hypot(forward[0], forward[2]), abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3), st.floats(0, 1))
def test_a_rolled_camera_that_follows_partly_still_loses_nothing(azimuth, elevation, roll, follow):
    sizes = np.linspace(0, 2, 30).tolist()
    looks = [View(azimuth, elevation, 0.5, 0.1, roll=roll)] * 30
    clouds = cubes(sizes)
    for framing, cloud in zip(Framer(looks, clouds.__getitem__, ASPECT, follow).all(), clouds, strict=True):
        x, y, depth = framing.camera.project(cloud, ASPECT).T
        assert depth.min() > 0
        assert max(np.abs(x).max(), np.abs(y).max()) <= 0.8 + 1e-9
        assert framing.placement.origin[1] <= cloud[:, 1].min() + 1e-9


def test_a_camera_may_look_straight_down_and_up():
    for elevation, up in ((math.pi / 2, -1.0), (-math.pi / 2, 1.0)):
        framing = framed(View(0.0, elevation, 0.5, 0.1))
        assert framing.camera.axes()[1] == pytest.approx([0, 0, up])


def test_a_dolly_goes_closer_while_the_set_stays():
    whole, close = framed(PLAIN), framed(PLAIN._replace(dolly=0.5))
    assert away(close) == pytest.approx(away(whole) / 2)
    assert close.placement == whole.placement


def test_an_orbit_leaves_the_set_and_its_lights_where_an_azimuth_turns_them():
    turned, gone = framed(PLAIN._replace(azimuth=1.4)), framed(PLAIN._replace(orbit=1.0))
    assert gone.camera == turned.camera
    assert (turned.placement.turn, gone.placement.turn) == (1.4, 0.4)


def test_the_set_faces_where_a_placed_camera_first_stands():
    looks = [PLAIN._replace(position=(5 * math.sin(a), 1.0, 5 * math.cos(a))) for a in (0.5, 0.7, 0.9)]
    assert [f.placement.turn for f in Framer(looks, lambda i: CUBE, ASPECT).all()] == pytest.approx([0.5] * 3)


def test_aiming_beside_the_sculpture_moves_no_light():
    there = framed(PLAIN._replace(target=(3.0, 0.0, 0.0), distance=8.0))
    assert there.placement.origin == pytest.approx((0.0, -1.0, 0.0))
    assert there.placement.size == pytest.approx(framed(PLAIN).placement.size, rel=0.2)


def test_a_longer_lens_stands_farther_off_and_shows_as_much():
    """A dolly zoom, unless the distance is held."""
    short, long = (framed(PLAIN._replace(field_of_view=angle)) for angle in (1.2, 0.2))
    assert away(long) > 4 * away(short)
    for framing in (short, long):
        x, y, _ = framing.camera.project(CUBE, ASPECT).T
        assert max(np.abs(x).max(), np.abs(y).max()) == pytest.approx(0.84)


def test_a_camera_that_stands_still_zooms_while_the_set_keeps_its_size():
    looks = [PLAIN._replace(field_of_view=angle) for angle in (0.3, 0.4, 0.5)]
    framings = Framer(looks, lambda i: CUBE, ASPECT, follow=0.0).all()
    assert len({framing.camera.origin for framing in framings}) == 1
    assert len({framing.placement for framing in framings}) == 1
    assert len({framing.camera.field_of_view for framing in framings}) == 3


def test_a_sculpture_and_its_enlarged_copy_are_blurred_alike():
    lens = Lens(85.0, 2.8)
    small, large = (
        Framer([PLAIN._replace(lens=lens)], lambda i, k=k: k * CUBE, ASPECT).all()[0] for k in (0.1, 20.0)
    )
    assert large.camera.lens_radius == pytest.approx(200 * small.camera.lens_radius)
    assert large.camera.focus_distance == pytest.approx(200 * small.camera.focus_distance)


def test_an_aperture_is_the_focal_length_over_the_f_number_wide():
    camera = framed(PLAIN._replace(lens=Lens(85.0, 2.5, unit=10.0))).camera
    assert camera.lens_radius == pytest.approx(1.7)  # 34 mm across, at 10 mm a unit
    assert framed(PLAIN).camera.lens_radius == 0.0


def test_the_subject_is_sharp_unless_something_else_is_to_be():
    def sharp(focus):
        return framed(PLAIN._replace(distance=8.0, lens=Lens(50.0, 2.0, None, focus))).camera

    assert sharp(None).focus_distance == pytest.approx(8.0)
    assert sharp(3.0).focus_distance == 3.0
    corner = sharp((1.0, 1.0, 1.0))
    assert corner.focus_distance == pytest.approx(corner.project([[1, 1, 1]], ASPECT)[0, 2])


def test_a_camera_in_the_middle_of_the_sculpture_fails_no_other_frame():
    looks = [PLAIN._replace(position=(0.0, 0.0, float(z))) for z in (4, 2, 0)]
    framings = Framer(looks, lambda i: BoundingSpheres(np.zeros((1, 3)), np.ones(1)), ASPECT).all()
    assert framings[2].camera.origin == (0.0, 0.0, 0.0)
    assert framings[0].camera.origin == (0.0, 0.0, 4.0)


def test_framings_are_the_same_after_a_journey_through_json():
    framing = framed(PLAIN._replace(roll=0.2, lens=Lens(85.0, 2.8)))
    assert from_plain(Framing, to_plain(framing)) == framing
