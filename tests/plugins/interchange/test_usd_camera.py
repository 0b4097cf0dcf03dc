"""Cameras in USD: the longer side of the aperture is the sensor, and the lens keeps its focal length."""

from __future__ import annotations

import math

import pytest

from flowsculpt.pipeline.plugins.interchange.usd_prims import CameraSettings, add_camera
from flowsculpt.render.scene.render_camera import Camera

pytestmark = pytest.mark.quick
UsdGeom = pytest.importorskip("pxr.UsdGeom")


@pytest.mark.parametrize(
    ("aspect", "sides"), [(16 / 9, (0.36, 0.2025)), (9 / 16, (0.2025, 0.36)), (1.0, (0.36, 0.36))]
)
def test_an_upright_picture_is_of_the_same_lens_before_the_sensor_on_its_side(aspect, sides) -> None:
    from pxr import Usd

    stage = Usd.Stage.CreateInMemory()
    angle = 2.0 * math.atan(math.tan(math.radians(20.0)) * min(1.0, aspect))
    camera = Camera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), field_of_view=angle)
    add_camera(stage, "/camera", {1: camera}, {1: None}, CameraSettings(aspect, 36.0, 1.0, 0.0))
    seen = UsdGeom.Camera.Get(stage, "/camera")
    apertures = seen.GetHorizontalApertureAttr().Get(), seen.GetVerticalApertureAttr().Get()
    assert apertures == pytest.approx(sides)
    assert seen.GetFocalLengthAttr().Get() == pytest.approx(0.18 / math.tan(math.radians(20.0)))
