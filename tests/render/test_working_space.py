"""Light may be computed in ACEScg: greys stay, pure colours come back, and displays show the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.post.colour import to_display
from flowsculpt.render.post.image import read_exr, write_exr
from flowsculpt.render.post.view import ACES
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS, Diffuse, Material, MitsubaMaterial
from flowsculpt.render.scene.materials.mitsuba_bsdf import Bsdf
from flowsculpt.render.scene.measured_colours import Measure
from flowsculpt.render.scene.patterns import Pigment
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.rgb_spaces import ACESCG, REC709, WorkingSpace
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig, Sky, Softbox
from flowsculpt.render.scene.scene_stage import Stage, StagePlacement
from flowsculpt.render.scene.surface import Surface, Wireframe
from tests.render.conftest import CAMERA

GREY = LightRig(
    (Softbox((-4.4, 5.4, 4.0), 1.9, 1.9, (140.0,) * 3, name="key"),),
    sky=Sky((0.1,) * 3, (0.1,) * 3, (0.1,) * 3),
)
SMALL = Quality(32, 18, samples=4, depth=2, auxiliary_samples=1)
RED_AND_BLUE = ((0.8, 0.05, 0.02), (0.02, 0.05, 0.8))

Render = Callable[..., RenderedFrame]


@pytest.fixture(scope="module")
def rendered_in(sphere: Surface, engine: Engine) -> Render:
    """The sphere in a working space, by default under grey light."""
    subject = replace(sphere, rest=sphere.vertices)

    def render(
        space: WorkingSpace, look: Material, stage: Stage, depth: int = 2, lights: LightRig = GREY
    ) -> RenderedFrame:
        scene = Scene(subject, look, lights, stage, StagePlacement(), CAMERA, space)
        return render_frame(scene, replace(SMALL, depth=depth), 1, engine)

    return render


@given(st.tuples(*[st.floats(0.0, 1.0)] * 3))
def test_reflectances_stay_reflectances_and_come_back(colour: tuple[float, float, float]) -> None:
    converted = ACESCG.from_rec709(np.array(colour))
    assert converted.min() >= -1e-15 and converted.max() <= 1.0 + 1e-15
    np.testing.assert_allclose(ACESCG.to_rec709(converted), colour, atol=1e-12)


def test_primaries_are_those_of_opencolorio() -> None:
    primaries = np.eye(3, dtype=np.float32)[None]
    converted = oiio.ImageBufAlgo.colorconvert(
        oiio.ImageBuf(primaries), REC709.interop_id, ACESCG.interop_id, colorconfig=ACES.config
    )
    expected = np.asarray(converted.get_pixels(oiio.FLOAT), dtype=np.float64)
    np.testing.assert_allclose(ACESCG.from_rec709(primaries), expected, atol=1e-6)


def test_a_grey_scene_is_the_same_in_both_spaces(rendered_in: Render) -> None:
    look, stage = Diffuse((0.5,) * 3), Stage(colour=(0.36,) * 3)
    one, other = (rendered_in(space, look, stage, depth=6) for space in (REC709, ACESCG))
    for name in one.arrays:
        np.testing.assert_allclose(other[name], one[name], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("look", "stage"),
    [
        (Diffuse(RED_AND_BLUE[0], wireframe=Wireframe(RED_AND_BLUE[1])), Stage("turntable")),
        (
            Diffuse((0.5,) * 3, pigment=Pigment("layers", RED_AND_BLUE)),
            Stage("plinth", colour=(0.7, 0.1, 0.1)),
        ),
        (Diffuse((0.5,) * 3, measure=Measure("stretch", "turbo", 0.5, 2.0)), Stage()),
        (MitsubaMaterial.of(Bsdf('{"type": "diffuse", "reflectance": [0.1, 0.7, 0.1]}')), Stage()),
        (LOOKS["symbolics_1990"], Stage("none")),
    ],
    ids=["chart", "pigment", "measure", "bsdf", "1990"],
)
def test_direct_grey_light_shows_the_same_colours(rendered_in: Render, look: Material, stage: Stage) -> None:
    """One reflection of grey light is linear in the colour; further ones differ between the spaces."""
    one, other = (rendered_in(space, look, stage) for space in (REC709, ACESCG))
    np.testing.assert_allclose(ACESCG.to_rec709(other["beauty"]), one["beauty"], rtol=2e-3, atol=2e-3)
    assert np.abs(other["beauty"] - one["beauty"]).max() > 0.02


def test_daylight_is_as_bright_as_a_map(rendered_in: Render) -> None:
    """Mitsuba's sun and sky know no other space, and are made a map."""
    one, other = (
        rendered_in(space, Diffuse((0.5,) * 3), Stage(colour=(0.36,) * 3), lights=LIGHTS["daylight"])
        for space in (REC709, ACESCG)
    )
    ratio = ACESCG.to_rec709(other["beauty"]).mean(axis=(0, 1)) / one["beauty"].mean(axis=(0, 1))
    np.testing.assert_allclose(ratio, 1.0, atol=0.02)


def test_colours_that_reflect_each_other_differ_a_little(rendered_in: Render) -> None:
    look, stage = Diffuse((0.8, 0.05, 0.02)), Stage(colour=(0.8, 0.05, 0.02))
    one, other = (rendered_in(space, look, stage, depth=6)["beauty"] for space in (REC709, ACESCG))
    difference = ACESCG.to_rec709(other).mean(axis=(0, 1)) / one.mean(axis=(0, 1)) - 1.0
    assert 0.001 < np.abs(difference).max() < 0.2


def test_a_display_shows_the_same_of_both_spaces() -> None:
    light = (0.05 + 0.9 * np.random.default_rng(3).random((16, 16, 3)) ** 2).astype(np.float32)
    converted = ACESCG.from_rec709(light).astype(np.float32)
    shown = to_display(converted, view=replace(ACES, working_space="acescg"))
    assert np.abs(shown - to_display(light)).max() < 3.0 / 255.0


def test_a_picture_file_says_its_space(tmp_path: Path, rendered_in: Render) -> None:
    for space in (REC709, ACESCG):
        frame = rendered_in(space, LOOKS["clay"], Stage())
        write_exr(tmp_path / "a.exr", frame, {})
        file: Any = oiio.ImageInput.open(str(tmp_path / "a.exr"))
        np.testing.assert_allclose(
            file.spec().getattribute("chromaticities"), space.chromaticities, rtol=1e-6
        )
        assert file.spec().getattribute("oiio:ColorSpace") == space.interop_id
        file.close()
        assert read_exr(tmp_path / "a.exr")[1]["working_space"] == space.name
