"""Noise taken out over time: what frames around know of a picture, and what they do not."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.render.post.temporal_denoise import DenoisedFrame, removed_noise, temporal_denoise
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.scene_stage import StagePlacement

WIDTH, HEIGHT = 96, 64
CAMERA = Camera(origin=(0.0, 0.0, 10.0), target=(0.0, 0.0, 0.0), field_of_view=2 * math.atan(0.3))
PIXEL = 6.0 / WIDTH
"""Scene units that a pixel is wide, at the wall z = 0."""

ERROR = 0.02
ARRAYS = ("light", "noise", "position", "normal", "matte", "before", "after")


def painted(points, wave=40):
    """A smooth painting, which moves with what it is on."""
    x, y = points[..., 0], points[..., 1]
    value = 0.4 + 0.2 * np.sin(x / PIXEL * 2 * np.pi / wave) * np.cos(y / PIXEL * 2 * np.pi / wave)
    return np.repeat(value[..., None], 3, axis=2)


def moment(frame, speed=0.0, brightness=1.0, error=ERROR, camera_speed=0.0):
    """A painted wall, and before it a painted board that goes `speed` pixels a frame to the right.

    The denoiser's picture is off by `error`, in blotches of a few pixels that differ from frame to frame.
    Returns the moment and its true light.
    """
    shift = camera_speed * PIXEL * frame
    camera = Camera((shift, 0.0, 10.0), (shift, 0.0, 0.0), field_of_view=CAMERA.field_of_view)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    wall = np.stack(
        [
            (columns + 0.5 - WIDTH / 2) * PIXEL + shift,
            (HEIGHT / 2 - rows - 0.5) * PIXEL,
            np.zeros((HEIGHT, WIDTH)),
        ],
        axis=2,
    )
    moved = speed * PIXEL * frame
    board = np.abs(wall - (moved, 0.0, 0.0)) < (12 * PIXEL, 12 * PIXEL, 1.0)
    matte = board.all(axis=2)
    truth = np.where(matte[..., None], painted(wall - (moved, 0.0, 0.0), wave=12), painted(wall)) * brightness
    blotches = np.random.default_rng(frame + 100).normal(size=(HEIGHT // 4, WIDTH // 4))
    light = truth * (1.0 + error * np.kron(blotches, np.ones((4, 4))))[..., None]
    step = np.where(matte[..., None], (speed * PIXEL, 0.0, 0.0), 0.0)
    single = {"light": light, "noise": np.full((HEIGHT, WIDTH), 0.2), "position": wall}
    single |= {"normal": np.broadcast_to((0.0, 0.0, 1.0), wall.shape), "matte": matte}
    single |= {"before": -step, "after": step}
    arrays = {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in single.items()}
    return DenoisedFrame(**arrays, camera=camera, placement=StagePlacement()), truth


def film(frames, **scene):
    return {frame: moment(frame, **scene)[0] for frame in frames}


def error_of(light, truth, where=slice(None)):
    return float(np.sqrt((((light - truth) / truth) ** 2)[where].mean()))


def test_a_frame_alone_keeps_its_light():
    alone, _ = moment(3)
    np.testing.assert_array_equal(temporal_denoise({3: alone}, 3), alone.light)


def test_five_frames_that_stand_still_have_the_noise_of_five_times_the_samples():
    truth = moment(0)[1]
    assert error_of(temporal_denoise(film(range(-2, 3)), 0), truth) < 1.1 * ERROR / math.sqrt(5)


@pytest.mark.parametrize("speed", [0.3, 1.0, 4.6])
def test_what_moves_is_followed_and_stays_sharp(speed):
    own, truth = moment(0, speed)
    board = own.matte > 0.5
    quiet = error_of(temporal_denoise(film(range(-2, 3), speed=speed), 0), truth, board)
    sharp = error_of(temporal_denoise(film(range(-2, 3), speed=speed, error=0.0), 0), truth, board)
    assert quiet < 0.75 * ERROR
    assert sharp < 0.45 * ERROR, "pictures read between their pixels are softer; by this much and no more"


def test_a_camera_that_moves_is_followed():
    truth = moment(0, camera_speed=1.7)[1]
    assert error_of(temporal_denoise(film(range(-2, 3), camera_speed=1.7), 0), truth) < 0.7 * ERROR


def test_what_was_hidden_a_frame_ago_takes_nothing_from_what_hid_it():
    moments = film((0, 1), speed=9.0, error=0.0)
    truth = moment(1, speed=9.0, error=0.0)[1]
    np.testing.assert_allclose(temporal_denoise(moments, 1), truth, rtol=0.02)


def test_a_light_that_goes_on_is_not_seen_a_frame_early():
    dark, lit = moment(0, error=0.0)[0], moment(1, brightness=2.0, error=0.0)[0]
    np.testing.assert_allclose(temporal_denoise({0: dark, 1: lit}, 0), dark.light, rtol=1e-4)


def test_noise_is_told_where_the_denoiser_changed_the_picture():
    truth = np.full((32, 32, 3), 0.5, np.float32)
    beauty = truth.copy()
    beauty[:, 16:] *= 1.0 + 0.1 * np.random.default_rng(1).choice([-1.0, 1.0], size=(32, 16, 1))
    found = removed_noise(beauty, truth)
    assert found[:, :12].max() == 0.0
    np.testing.assert_allclose(found[:, 20:], 0.1, rtol=1e-3)


@pytest.mark.parametrize("value", [65504.0, np.inf, np.nan])
def test_one_bright_pixel_does_not_make_its_neighbours_noisy(value):
    truth = np.full((32, 32, 3), 0.5, np.float32)
    beauty = truth * (1.0 + 0.1 * np.random.default_rng(1).choice([-1.0, 1.0], size=(32, 32, 1)))
    beauty[16, 16] = value
    np.testing.assert_allclose(removed_noise(beauty.astype(np.float32), truth), 0.1, rtol=0.1)


def test_a_part_of_a_picture_is_followed_as_the_whole_is():
    moments = film(range(-2, 3), speed=1.0)
    rows, columns = slice(20, 52), slice(30, 70)
    parts = {
        frame: replace(whole, **{name: getattr(whole, name)[rows, columns] for name in ARRAYS})
        for frame, whole in moments.items()
    }
    part = temporal_denoise(parts, 0, (WIDTH, HEIGHT), (30, 20))
    inside = slice(4, -4)
    whole = temporal_denoise(moments, 0)
    np.testing.assert_allclose(part[:, inside], whole[rows, columns][:, inside], rtol=1e-5)
