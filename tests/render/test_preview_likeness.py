"""Quick previews resemble renders: in every look the subject and its stage are about as bright."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.render.post.colour import to_display
from flowsculpt.render.raster import Shape, StageSetup, preview
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import PLINTH, STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface
from tests.render.conftest import CAMERA, ball

TOLERANCE = 0.1
"""Largest difference of mean display values, 0 … 1, in any channel."""

QUALITY = Quality(96, 54, samples=16, depth=6, auxiliary_samples=4)


@pytest.fixture(scope="module")
def pebble() -> Surface:
    """A ball with hollows and bumps, which stands on the floor."""
    round_one = ball(36, 72)
    x, y, z = round_one.normals.T
    vertices = round_one.vertices * (1.0 + 0.12 * np.sin(4 * x + 1) * np.sin(5 * y) * np.cos(4 * z))[:, None]
    a, b, c = (vertices[round_one.faces[:, k]] for k in range(3))
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, round_one.faces[:, k], np.cross(b - a, c - a))
    normals *= np.sign(np.sum(normals * round_one.normals, axis=1, keepdims=True))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
    vertices[:, 1] -= vertices[:, 1].min()
    return replace(round_one, vertices=vertices, normals=normals.astype(np.float32))


@pytest.mark.parametrize("look", ["clay", "glaze", "chrome", "honey", "glass", "frosted", "smoke"])
def test_a_preview_is_about_as_bright_as_the_render(
    look: str, pebble: Surface, rendered: Callable[..., RenderedFrame]
) -> None:
    layers = rendered(surface=pebble, look=LOOKS[look], quality=QUALITY)
    shape = Shape(pebble.vertices, pebble.normals, pebble.faces, LOOKS[look], closed=True)
    setup = StageSetup(LIGHTS["studio"], STAGES["cyclorama"], StagePlacement())
    drawn = preview(shape, setup, CAMERA, (QUALITY.width, QUALITY.height), "srgb").picture
    light = to_display(layers["beauty"], display="srgb")
    inside = layers["matte"] > 0.5
    for part in (inside, ~inside):
        assert np.abs(drawn[part].mean(axis=0) - light[part].mean(axis=0)).max() < TOLERANCE


def test_a_plinth_is_as_grey_as_in_the_render_whatever_the_colour_of_the_wall(
    pebble: Surface, rendered: Callable[..., RenderedFrame]
) -> None:
    stage = replace(STAGES["plinth"], colour=(0.5, 0.1, 0.05))
    layers = rendered(surface=pebble, look=LOOKS["clay"], quality=QUALITY, stage=stage)
    shape = Shape(pebble.vertices, pebble.normals, pebble.faces, LOOKS["clay"], closed=True)
    setup = StageSetup(LIGHTS["studio"], stage, StagePlacement())
    drawn = preview(shape, setup, CAMERA, (QUALITY.width, QUALITY.height), "srgb").picture
    light = to_display(layers["beauty"], display="srgb")
    plinth = np.all(np.abs(layers["albedo"] - PLINTH) < 1e-2, axis=2) & (layers["matte"] == 0.0)
    assert np.count_nonzero(plinth) > 300
    shown, expected = (picture[plinth].mean(axis=0) for picture in (drawn, light))
    assert np.abs((shown - shown.mean()) - (expected - expected.mean())).max() < TOLERANCE / 2
