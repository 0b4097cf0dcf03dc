"""RenderedFrame say of the subject what its vertices bring along, and how sure the light is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.frame.render_frame import SampleBatches
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.post.image import read_exr, write_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene import MotionSample
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Spheres, Surface

Rendered = Callable[..., RenderedFrame]

CAMERA = Camera((3.2, 2.9, 8.8), (0.0, 0.95, 0.0))
SIZE = (48, 27)


@pytest.fixture(scope="module")
def marked(sphere: Surface) -> Surface:
    """The sphere with a velocity and a place at rest, both linear in where its points are."""
    return replace(
        sphere,
        attributes={"velocity": (300.0 * sphere.vertices - 100.0).astype(np.float32)},
        rest=(0.5 * sphere.vertices - 3.0).astype(np.float32),
    )


def following(surface: Surface, by: tuple[float, float, float], camera: Camera = CAMERA) -> MotionSample:
    moved = replace(surface, vertices=(surface.vertices + np.array(by)).astype(np.float32))
    return MotionSample(moved, StagePlacement(), camera)


def test_layers_show_what_vertices_bring_along_and_nothing_beside_the_subject(
    rendered: Rendered, marked: Surface
) -> None:
    layers = rendered(surface=marked, aovs=("velocity", "rest"))
    inside, outside = layers["matte"] == 1.0, layers["matte"] == 0.0
    there = layers["position"][inside]
    assert layers["velocity"][inside] == pytest.approx(300.0 * there - 100.0, abs=1e-2)
    assert layers["rest"][inside] == pytest.approx(0.5 * there - 3.0, abs=1e-5)
    assert not layers["velocity"][outside].any() and not layers["rest"][outside].any()


def test_layers_that_were_asked_for_leave_the_others_as_they_are(
    rendered: Rendered, marked: Surface, picture: RenderedFrame
) -> None:
    layers = rendered(surface=marked, aovs=("velocity", "rest", "samples"))
    assert set(layers.arrays) == {*picture.arrays, "velocity", "rest", "samples"}
    assert all(np.array_equal(layers[name], picture[name]) for name in picture.arrays)


def test_motion_is_in_pixels_right_and_up(rendered: Rendered, marked: Surface) -> None:
    right, up, _ = CAMERA.axes()
    step = 0.2 * right + 0.1 * up
    layers = rendered(surface=marked, aovs=("motion",), following=following(marked, tuple(step)))
    inside, outside = layers["matte"] == 1.0, layers["matte"] == 0.0
    points = layers["position"][inside]
    aspect, half = SIZE[0] / SIZE[1], np.array(SIZE) / 2.0
    seen = (CAMERA.project(points + step, aspect) - CAMERA.project(points, aspect))[:, :2] * half
    assert layers["motion"][inside] == pytest.approx(seen, abs=0.01)
    assert (layers["motion"][inside] > 0.2).all()
    assert layers["motion"][outside] == pytest.approx(0.0, abs=1e-4)


def test_motion_of_a_camera_that_pans_is_that_of_everything(rendered: Rendered, marked: Surface) -> None:
    right = CAMERA.axes()[0]
    there = replace(CAMERA, target=tuple(CAMERA.target + 0.1 * right))
    layers = rendered(surface=marked, aovs=("motion",), following=following(marked, (0.0, 0.0, 0.0), there))
    pan = np.arctan(0.1 / np.linalg.norm(np.subtract(CAMERA.target, CAMERA.origin)))
    pixels = pan / np.tan(np.radians(13.0)) * 24.0
    assert layers["motion"][..., 0] == pytest.approx(-pixels, rel=0.1)


def test_spheres_of_a_cloud_move_as_their_points(rendered: Rendered) -> None:
    centres = np.array([[-0.8, 1.0, 0.0], [0.8, 1.0, 0.0]], np.float32)
    speeds = np.array([[1.0, 2.0, 3.0], [-4.0, 5.0, 0.5]], np.float32)
    cloud = Spheres(centres, np.array([0.6, 0.6], np.float32), {"velocity": speeds}, centres)
    layers = rendered(surface=cloud, aovs=("velocity", "rest"))
    inside = layers["matte"] == 1.0
    left = layers["position"][..., 0] < 0.0
    for side, point in ((inside & left, 0), (inside & ~left, 1)):
        assert side.sum() > 5
        assert layers["velocity"][side] == pytest.approx(np.tile(speeds[point], (side.sum(), 1)), abs=1e-4)


def test_layers_without_what_they_are_made_from_are_refused(rendered: Rendered, sphere: Surface) -> None:
    for name, missing in (("velocity", "velocities"), ("motion", "next frame"), ("rest", "rest positions")):
        with pytest.raises(BadInputError, match=f"{name}.*{missing}"):
            rendered(surface=sphere, aovs=(name,))
    with pytest.raises(BadInputError, match="needs 2 samples"):
        rendered(quality=Quality(16, 9, samples=1, depth=2, auxiliary_samples=1), aovs=("noise",))


def test_the_noise_layer_foretells_how_pictures_differ(rendered: Rendered) -> None:
    """Over many seeds, the luminance of a softly lit floor scatters by little less than the layer says.

    It scatters less because samples are spread more evenly than by chance.
    """
    luma = np.array([0.2126, 0.7152, 0.0722])
    quality = Quality(48, 27, samples=16, depth=3, auxiliary_samples=1)
    runs = [rendered(quality=quality, aovs=("noise",), seed=seed) for seed in range(12)]
    spread = np.std([run["beauty"] @ luma for run in runs], axis=0, ddof=1)
    told = np.mean([run["noise"] for run in runs], axis=0)
    ratio = np.sqrt((spread**2).mean() / (told**2).mean())
    assert 0.2 < ratio < 1.05
    more = rendered(quality=replace(quality, samples=64), aovs=("noise",), seed=1)
    assert np.median(more["noise"]) == pytest.approx(0.5 * np.median(told), rel=0.15)


def test_samples_are_those_that_were_taken(rendered: Rendered, engine: Engine) -> None:
    """Multijitter, which the plain variant takes, rounds up to a rectangle."""
    for asked, taken in ((4, 4), (5, 6 if engine.variant == "scalar_rgb" else 5), (48, 48)):
        layers = rendered(
            quality=Quality(16, 9, samples=asked, depth=2, auxiliary_samples=1), aovs=("samples",)
        )
        assert (layers["samples"] == taken).all()


def test_each_layer_is_kept_as_exactly_as_asked_for(
    rendered: Rendered, marked: Surface, tmp_path: Path
) -> None:
    layers = rendered(surface=marked, aovs=("velocity", "rest", "noise", "samples"))
    asked = {"velocity": "float", "rest": "half", "beauty": "float"}
    write_exr(tmp_path / "a.exr", layers, {}, asked)
    back, _ = read_exr(tmp_path / "a.exr")
    for name in layers.arrays:
        exact = np.array_equal(back[name], layers[name])
        assert exact == (name not in ("albedo", "normal", "rest", "noise")) or name == "matte", name
        assert back[name] == pytest.approx(layers[name], rel=1e-3, abs=1e-3)
    file: Any = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    names = file.spec().channelnames
    file.close()
    assert {"velocity.X", "velocity.Y", "velocity.Z", "rest.X", "noise.Y", "samples.N"} <= set(names)


def test_a_picture_cannot_be_told_noise_from_nothing() -> None:
    with pytest.raises(BadInputError):
        SampleBatches(Quality(16, 9, samples=1, depth=2), 1, ("noise",), 7)


def test_no_stage_moves_nowhere(rendered: Rendered, marked: Surface) -> None:
    there = replace(CAMERA, target=(0.3, 0.95, 0.0))
    layers = rendered(
        surface=marked, stage=STAGES["none"], aovs=("motion",), following=following(marked, (0, 0, 0), there)
    )
    assert not layers["motion"][layers["matte"] == 0.0].any()
    assert (layers["motion"][layers["matte"] == 1.0][:, 0] < -1.0).all()


@pytest.mark.parametrize("name", ["velocity", "motion", "before", "after"])
def test_a_layer_that_lacks_what_it_is_made_from_says_so(name: str, rendered: Rendered) -> None:
    with pytest.raises(BadInputError, match=f"AOV '{name}' needs .*, which the surface was not given"):
        rendered(aovs=(name,))
