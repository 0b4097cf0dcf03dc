"""Framing: nothing leaves the picture, and the camera is calm."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.production.request.framing import (
    AHEAD,
    BoundingSpheres,
    Framer,
    envelope,
    fitting_distance,
    rotate_y,
    smooth,
)
from flowsculpt.pipeline.shot.camera_path import Lens, View
from flowsculpt.render.base.render_errors import BadInputError

pytestmark = pytest.mark.quick

ASPECT = 16 / 9
VIEW = View(azimuth=0.4, elevation=0.25, field_of_view=np.radians(26), margin=0.08)


def blobs(seed: int, frames: int) -> list[np.ndarray]:
    """A cloud that wanders, breathes and is drawn out, as sculptures are."""
    rng = np.random.default_rng(seed)
    cloud = rng.normal(size=(200, 3))
    drift = np.cumsum(rng.normal(scale=0.3, size=(frames, 3)), axis=0)
    stretch = np.exp(np.cumsum(rng.normal(scale=0.1, size=(frames, 3)), axis=0))
    return [cloud * s + d for s, d in zip(stretch, drift, strict=True)]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(-3, 3), st.floats(0, 0.6), st.integers(1, 40))
def test_every_vertex_of_every_frame_stays_within_the_margins(seed, azimuth, elevation, frames):
    clouds = blobs(seed, frames)
    views = [View(azimuth + 0.02 * i, elevation, np.radians(26), 0.08) for i in range(frames)]
    for framing, cloud in zip(Framer(views, clouds.__getitem__, ASPECT).all(), clouds, strict=True):
        x, y, depth = framing.camera.project(cloud, ASPECT).T
        assert depth.min() > 0
        assert np.abs(x).max() <= 1 - 2 * 0.08 + 1e-9
        assert np.abs(y).max() <= 1 - 2 * 0.08 + 1e-9


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 40))
def test_the_floor_never_cuts_into_the_sculpture(seed, frames):
    clouds = blobs(seed, frames)
    for framing, cloud in zip(Framer([VIEW] * frames, clouds.__getitem__, ASPECT).all(), clouds, strict=True):
        assert framing.placement.origin[1] <= cloud[:, 1].min() + 1e-9


def test_a_subject_in_focus_by_name_is_sharp_at_its_nearest_point():
    back, front = np.array([[0.0, 0.0, -2.0], [0.0, 1.0, -1.0]]), np.array([[1.0, 0.0, 1.0], [0.0, 0.0, 0.5]])
    ball = BoundingSpheres(np.array([[0.5, 0.0, 2.0]]), np.array([0.25]))
    extent = BoundingSpheres.join([back, front, ball], ["back", "front_row", "ball"])
    level = View(azimuth=0.0, elevation=0.0, field_of_view=0.4, margin=0.1)
    for name, nearest in (("back", -1.0), ("front_row", 1.0), ("ball", 2.25), ("front", 2.25)):
        view = level._replace(lens=Lens(85.0, 4.0, None, name))
        camera = Framer([view], lambda _: extent, ASPECT).all()[0].camera
        assert camera.origin[2] - camera.focus_distance == pytest.approx(nearest)
    assert BoundingSpheres.join([back]) is back


def test_focus_front_is_at_the_nearest_point_of_the_sculpture_and_moves_calmly():
    clouds = blobs(3, 40)
    near = VIEW._replace(lens=Lens(85.0, 4.0, None, "front"))
    framings = Framer([near] * 40, clouds.__getitem__, ASPECT).all()
    distances = np.array([framing.camera.focus_distance for framing in framings])
    depths = [f.camera.project(c, ASPECT)[:, 2].min() for f, c in zip(framings, clouds, strict=True)]
    middles = np.array([np.linalg.norm(np.subtract(f.camera.origin, f.camera.target)) for f in framings])
    assert np.median(np.abs(distances - depths)) < 0.2 * np.median(middles - depths)
    cube = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T.astype(float)
    (still,) = Framer([near], lambda i: cube, ASPECT).all()
    assert still.camera.focus_distance == pytest.approx(still.camera.project(cube, ASPECT)[:, 2].min())


def test_a_sculpture_at_rest_stands_on_the_floor_and_fills_the_safe_area():
    cube = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T.astype(float)
    framing = Framer([VIEW] * 30, lambda i: cube, ASPECT).all()[15]
    assert framing.placement.origin[1] == pytest.approx(-1)
    x, y, _ = framing.camera.project(cube, ASPECT).T
    assert max(np.abs(x).max(), np.abs(y).max()) == pytest.approx(1 - 2 * 0.08)


def filled(framings, clouds):
    """The larger of width and height of each sculpture in its picture, as fractions of the picture's."""
    boxes = [
        np.ptp(f.camera.project(c, ASPECT)[:, :2], axis=0) for f, c in zip(framings, clouds, strict=True)
    ]
    return np.max(boxes, axis=1) / 2


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(-3, 3), st.floats(0, 1.2), st.floats(0.1, 1.0))
def test_a_sculpture_at_rest_is_in_the_middle_of_the_picture(seed, azimuth, elevation, field_of_view):
    (cloud,) = blobs(seed, 1)
    (framing,) = Framer([View(azimuth, elevation, field_of_view, 0.1)], lambda i: cloud, ASPECT).all()
    low, high = (edge(framing.camera.project(cloud, ASPECT)[:, :2], axis=0) for edge in (np.min, np.max))
    assert np.abs(low + high).max() < 0.05
    assert filled([framing], [cloud]) == pytest.approx(0.8)


@pytest.mark.parametrize("growth", [0.96, 1.0, 1.04])
def test_a_sculpture_that_grows_or_shrinks_steadily_fills_the_picture_all_along(growth):
    (cloud,) = blobs(1, 1)
    clouds = [cloud * growth**i for i in range(80)]
    views = [View(0.4 + 0.01 * i, 0.25, np.radians(26), 0.1) for i in range(80)]
    shares = filled(Framer(views, clouds.__getitem__, ASPECT).all(), clouds)
    assert shares.min() > 0.7 and shares.max() <= 0.8 + 1e-9


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 1e3), st.floats(0.1, 2.0), st.floats(0, 0.4))
def test_the_fitting_distance_is_the_least(seed, away, field_of_view, margin):
    """Each point by itself: how far away it must be, sideways and upright."""
    rng = np.random.default_rng(seed)
    view = VIEW._replace(field_of_view=field_of_view, margin=margin)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    target = rng.normal(size=3) * away
    cloud, radii = target + rng.normal(size=(50, 3)), rng.uniform(0.0, 0.5, 50)
    wide = np.tan(field_of_view / 2) * (1 - 2 * margin)
    needed = {"points": [], "balls": []}
    for point, radius in zip(cloud, radii, strict=True):
        right, up, back = axes @ (point - target)
        for beside, share in ((right, wide), (up, wide / ASPECT)):
            needed["points"].append(back + abs(beside) / share)
            needed["balls"].append(back + (abs(beside) + radius * np.hypot(1.0, share)) / share)
    for kind, shape in (("points", cloud), ("balls", BoundingSpheres(cloud, radii))):
        found = fitting_distance(shape, target, axes, view, ASPECT)
        assert found == pytest.approx(max(needed[kind]), abs=1e-9)


def test_points_of_single_precision_are_framed_as_exactly_as_others():
    clouds = [cloud.astype(np.float32) for cloud in blobs(11, 8)]
    single = Framer([VIEW] * 8, clouds.__getitem__, ASPECT).all()
    assert single == Framer([VIEW] * 8, lambda i: clouds[i].astype(np.float64), ASPECT).all()


def test_what_has_no_place_has_no_camera():
    cloud = blobs(2, 1)[0]
    cloud[17, 1] = np.nan
    with pytest.raises(BadInputError, match="finite"):
        Framer([VIEW], lambda _: cloud, ASPECT).all()


def test_an_edit_late_in_the_shot_leaves_early_cameras_alone():
    early, late = blobs(3, 90), blobs(3, 90)
    late[80] = late[80] * 3
    views = [VIEW] * 90
    before, after = (Framer(views, clouds.__getitem__, ASPECT).all() for clouds in (early, late))
    assert before[:40] == after[:40]
    assert before[80] != after[80]


def test_a_turntable_holds_its_camera_still():
    cloud = blobs(5, 1)[0]
    angles = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    framings = Framer([VIEW] * 12, lambda i: rotate_y(cloud, angles[i]), ASPECT, follow=0.0).all()
    assert len(set(framings)) == 1


def test_turning_keeps_the_axis_and_all_distances():
    cloud = blobs(7, 1)[0]
    spun = rotate_y(cloud, 1.1)
    assert np.allclose(spun[:, 1], cloud[:, 1])
    assert np.allclose(
        np.linalg.norm(spun[1:] - spun[:-1], axis=1), np.linalg.norm(cloud[1:] - cloud[:-1], axis=1)
    )
    assert rotate_y(cloud, 0.0) is cloud


@given(st.lists(st.floats(-10, 10), min_size=1, max_size=60), st.integers(0, 12))
def test_the_smoothed_envelope_never_cuts_a_peak(values, radius):
    track = np.array(values)
    assert (smooth(envelope(track, radius, np.max), radius) >= track - 1e-9).all()


def test_smoothing_leaves_a_constant_track_alone():
    assert np.allclose(smooth(np.full(20, 2.5), 6), 2.5)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(-3, 3), st.integers(1, 30))
def test_balls_stay_within_the_margins_and_above_the_floor_all_around(seed, azimuth, frames):
    """No point of a ball's surface leaves the picture: looked at in directions all around."""
    clouds = blobs(seed, frames)
    radii = np.random.default_rng(seed).uniform(0.01, 1.5, len(clouds[0]))
    around = np.random.default_rng(1).normal(size=(60, 3))
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    views = [View(azimuth, 0.3, np.radians(26), 0.08)] * frames
    framings = Framer(views, lambda i: BoundingSpheres(clouds[i], radii), ASPECT).all()
    for framing, cloud in zip(framings, clouds, strict=True):
        skin = (cloud[:, None] + radii[:, None, None] * around).reshape(-1, 3)
        x, y, depth = framing.camera.project(skin, ASPECT).T
        assert depth.min() > 0
        assert max(np.abs(x).max(), np.abs(y).max()) <= 1 - 2 * 0.08 + 1e-9
        assert framing.placement.origin[1] <= skin[:, 1].min() + 1e-9


def test_one_ball_fills_the_safe_area_and_stands_on_the_floor():
    framing = Framer(
        ([VIEW] * 5), lambda i: BoundingSpheres(np.zeros((1, 3)), np.array([2.0])), ASPECT
    ).all()[2]
    assert framing.placement.origin[1] == pytest.approx(-2)
    distance = np.linalg.norm(np.subtract(framing.camera.origin, framing.camera.target))
    high = np.tan(np.radians(13)) / ASPECT * (1 - 2 * 0.08)
    assert 2 / distance == pytest.approx(np.sin(np.arctan(high)))  # the ball touches the plane of the margin


@pytest.mark.slow
@settings(deadline=None)
@given(st.integers(0, 2**16), st.lists(st.integers(1, 25), min_size=1, max_size=12))
def test_cameras_are_settled_while_frames_come_and_are_those_of_the_whole(
    seed: int, steps: list[int]
) -> None:
    frames = sum(steps)
    clouds = blobs(seed, frames)
    whole = Framer([VIEW] * frames, clouds.__getitem__, ASPECT).all()
    seen = 0
    framer = Framer(
        [VIEW] * frames, lambda i: clouds[i] if i < seen else pytest.fail("not there yet"), ASPECT
    )
    found = []
    for step in steps:
        seen += step
        found += framer.framings(seen)
        assert len(found) == (frames if seen == frames else max(0, seen - AHEAD))
    assert found == whole


def test_a_camera_that_stands_waits_for_the_whole_sequence() -> None:
    clouds = blobs(3, 40)
    framer = Framer([VIEW] * 40, clouds.__getitem__, ASPECT, follow=0.5)
    assert framer.framings(39) == []
    assert framer.framings(40) == Framer([VIEW] * 40, clouds.__getitem__, ASPECT, follow=0.5).all()


def test_the_camera_of_a_loop_is_as_calm_at_its_first_frame_as_elsewhere():
    """Wherever a round begins, each of its frames is framed the same."""
    there = blobs(4, 26)
    clouds = there + there[-2:0:-1]
    count = len(clouds)
    framings = Framer([VIEW] * count, clouds.__getitem__, ASPECT, is_round=True).all()
    assert len(framings) == count
    later = Framer([VIEW] * count, lambda i: clouds[(i + 9) % count], ASPECT, is_round=True).all()
    for i, framing in enumerate(later):
        assert np.allclose(framing.camera.origin, framings[(i + 9) % count].camera.origin)
        assert np.allclose(framing.placement.origin, framings[(i + 9) % count].placement.origin)
