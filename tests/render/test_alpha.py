"""Alpha, and the coverage of objects, that are measured with the rays of the light."""

from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.scene.aovs import COVERAGE
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig, Sky
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from tests.render.conftest import CAMERA, TINY

LIGHT = 0.7


@pytest.fixture
def rendered_under(sphere, engine):
    def rendered(visible, stage="none"):
        sky = Sky((LIGHT,) * 3, (LIGHT,) * 3, (LIGHT,) * 3, visible=visible)
        scene = Scene(sphere, LOOKS["clay"], LightRig(sky=sky), STAGES[stage], StagePlacement(), CAMERA)
        return render_frame(scene, TINY, 3, engine)

    return rendered


def test_alpha_over_a_background_is_the_picture_with_that_background(rendered_under, engine):
    cut_out, whole = rendered_under(visible=False), rendered_under(visible=True)
    over = cut_out["beauty"] + (1.0 - cut_out["alpha"])[..., None] * LIGHT
    tolerance = 1e-6 if engine.variant != "scalar_rgb" else 0.2
    inner = cut_out["alpha"] > 0.0
    assert 0.1 < inner.mean() < 0.9 and ((cut_out["alpha"] > 0.0) & (cut_out["alpha"] < 1.0)).any()
    assert np.abs(over - whole["beauty"]).max() < tolerance
    assert (whole["alpha"] == 1.0).all(), "a visible sky is opaque"


def test_alpha_is_whole_where_the_stage_is_seen_and_the_objects_share_it(rendered_under, engine):
    layers = rendered_under(visible=False, stage="plinth")
    assert (layers["alpha"] == 1.0).all()
    parts = {name: plane for name, plane in layers.arrays.items() if name.startswith(COVERAGE)}
    if engine.variant != "scalar_rgb":
        assert parts.keys() == {f"{COVERAGE}{name}" for name in ("subject", "stage", "plinth")}
        assert all(plane.max() == 1.0 for plane in parts.values())
        assert np.array_equal(sum(parts.values()), layers["alpha"])
        assert np.abs(parts[f"{COVERAGE}subject"] - layers["matte"]).mean() < 0.02


def test_a_shadow_catcher_is_not_seen_but_darkens_what_lies_below(sphere, engine):
    if engine.variant == "scalar_rgb":
        pytest.skip("a shadow catcher needs a compiled variant")

    def rendered(stage):
        scene = Scene(sphere, LOOKS["clay"], LIGHTS["studio"], stage, StagePlacement(), CAMERA)
        return render_frame(scene, replace(TINY, fireflies="keep"), 3, engine)

    seen, caught = rendered(STAGES["ground"]), rendered(replace(STAGES["ground"], shadow_catcher=True))
    floor = seen["coverage.stage"] == 1.0
    assert (caught["beauty"][floor] == 0.0).all() and (caught["alpha"][floor] == 0.0).all()
    assert np.array_equal(caught["beauty"][seen["matte"] == 1.0], seen["beauty"][seen["matte"] == 1.0])
    assert caught["shadow"].min() >= 0.0 and (caught["shadow"] <= caught["coverage.stage"] + 1e-6).all()
    assert caught["shadow"].max() > 0.5, "below the sphere"
    assert np.median(caught["shadow"][floor]) < 0.2 and (caught["shadow"][floor] < 1e-6).any()


def test_a_shadow_catcher_asks_for_a_path_tracer(sphere, engine):
    stage = replace(STAGES["ground"], shadow_catcher=True)
    scene = Scene(sphere, LOOKS["smoke"], LIGHTS["studio"], stage, StagePlacement(), CAMERA)
    with pytest.raises(BadInputError, match="shadow catcher needs a compiled variant"):
        render_frame(scene, TINY, 3, engine)


def test_without_a_floor_no_shadow_can_be_caught():
    with pytest.raises(BadInputError, match="use ground or cyclorama"):
        replace(STAGES["none"], shadow_catcher=True)
