"""Fog: air that scatters the light of a beam towards the lens."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.raster import Preview, Shape, StageSetup, preview
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.fog import density, passed
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_lights import groups_in
from flowsculpt.render.scene.scene_stage import STAGES, Stage, StagePlacement
from tests.render.conftest import CAMERA, ball

pytestmark = pytest.mark.quick

_SHOT = "title: A\nframes: 1-2\nsubject: {solid: box}\nresample: {max_edge_length: 0.5}\nset: fog\n"
LIT = read_shot("a.yaml", _SHOT).picture.lights
QUALITY = Quality(48, 27, samples=16, depth=4, auxiliary_samples=4)


@given(st.floats(0.0, 0.99), st.floats(-1.0, 1.0))
def test_air_that_a_ray_has_passed_is_the_sum_of_its_density(closest: float, end: float) -> None:
    along = np.linspace(0.0, end, 2001)
    expected = np.trapezoid(density(closest, along), along)
    assert passed(closest, end) == pytest.approx(expected, abs=1e-5)


def drawn(look: str) -> Preview:
    ball_shape = ball(24, 48)
    shape = Shape(ball_shape.vertices, ball_shape.normals, ball_shape.faces, LOOKS[look], closed=True)
    setup = StageSetup(LIT, STAGES["fog"], StagePlacement((0.0, -1.0, 0.0)))
    return preview(shape, setup, CAMERA, (QUALITY.width, QUALITY.height), "srgb")


@pytest.mark.parametrize("look", ["clay", "glass"])
def test_a_preview_shows_the_beam_beside_a_subject_and_darkness_outside_of_it(look: str) -> None:
    shown = drawn(look)
    light = np.where(shown.nearness == shown.nearness.max(), np.nan, shown.picture.mean(axis=2))
    assert np.nanmax(light[:9]) > 0.3 and np.nanmin(light[:9]) < 0.15


def test_lights_that_are_told_apart_add_up_in_fog(rendered: Callable[..., RenderedFrame]) -> None:
    layers = rendered(lights=LIT.grouped({}), stage=STAGES["fog"], quality=QUALITY)
    groups = groups_in(layers.arrays)
    assert groups["key"][:9].max() > 0.1
    assert sum(groups.values()) == pytest.approx(layers["beauty"], rel=0.01, abs=1e-3)


def test_fog_with_smoke_is_refused_with_a_remedy(rendered: Callable[..., RenderedFrame]) -> None:
    with pytest.raises(BadInputError, match=r"the air of the stage fog needs .* a shot without smoke"):
        rendered(look=LOOKS["smoke"], stage=STAGES["fog"], quality=QUALITY)


def test_fog_catches_no_shadows() -> None:
    with pytest.raises(BadInputError, match="stage fog has light in its air"):
        Stage("fog", shadow_catcher=True)
