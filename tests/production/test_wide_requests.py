"""Requests of shots whose pictures are spherical, dome or VR180: framing, sizes, and what they refuse."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.framing import Framer, Framing
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.base.serialise import from_plain, to_plain
from flowsculpt.render.scene.render_camera import Projection, WideCamera

SHOT = "title: A\nframes: 1-2\nsubject: {solid: icosphere}\nresample: {max_edge_length: 0.5}\n"


def framed(camera: str) -> Framing:
    """Return the framing of a ball of radius 1 at the origin."""
    view = read_shot("a.yaml", SHOT + f"camera: {camera}\n").picture.camera.at(0.0)
    return Framer([view], lambda _: icosphere(4).vertices, 2.0).all()[0]


@pytest.mark.parametrize("kind", ["spherical", "vr180"])
def test_the_sculpture_is_in_the_middle_and_fills_the_angle_within_the_margins(kind: str) -> None:
    camera = framed(f"{{projection: {kind}}}").camera
    assert isinstance(camera, WideCamera) and camera.target == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    wanted = 2.0 * math.atan(0.8 * math.tan(math.radians(75.0) / 2.0))
    seen = 2.0 * math.asin(1.0 / math.dist(camera.origin, camera.target))
    assert math.degrees(seen) == pytest.approx(math.degrees(wanted), abs=1.0)
    assert camera.origin[1] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    ("written", "elevation"), [("", 35.0), (", dome_elevation: 20", 20.0), (", elevation: -20", 35.0)]
)
def test_in_a_dome_the_sculpture_is_in_front_of_the_audience_above_the_springline(
    written: str, elevation: float
) -> None:
    camera = framed(f"{{projection: dome{written}}}").camera
    x, y, _ = camera.project([[0.0, 0.0, 0.0]], 1.0)[0]
    assert x == pytest.approx(0.0, abs=0.01) and y == pytest.approx(-(90.0 - elevation) / 90.0, abs=0.01)
    _, above, _ = camera.project([[0.0, 0.3, 0.0]], 1.0)[0]
    assert above > y


def test_a_dome_may_have_the_sculpture_at_its_zenith() -> None:
    camera = framed("{projection: dome, dome_elevation: 90}").camera
    assert camera.target == pytest.approx((0.0, 0.0, 0.0), abs=0.01)


def test_eyes_are_as_far_apart_as_the_unit_says_and_by_default_before_a_statue() -> None:
    measured = framed("{projection: vr180, eye_distance: 60, unit: 500}").camera
    assert isinstance(measured, WideCamera) and measured.eye_distance == pytest.approx(0.12)
    usual = framed("{projection: vr180}")
    assert isinstance(usual.camera, WideCamera)
    assert usual.camera.eye_distance == pytest.approx(0.064 * usual.placement.size)


def test_a_wide_camera_survives_its_file() -> None:
    framing = framed("{projection: dome, dome_angle: 210}")
    assert from_plain(Framing, to_plain(framing)) == framing
    flat = framed("{}")
    assert from_plain(Framing, to_plain(flat)) == flat and not isinstance(flat.camera, WideCamera)
    assert "wide" not in to_plain(flat.camera)


def test_a_request_knows_its_projection_and_has_no_crop(tmp_path: Path) -> None:
    shot = tmp_path / "a.yaml"
    shot.write_text(SHOT + "camera: {projection: spherical}\n")
    project = Project(tmp_path, 1, "llvm_ad_rgb")
    request = project.request(shot, "draft")
    assert request.pictures.projection == Projection("spherical") and request.pictures.aspect == 2.0
    assert (request.pictures.quality.width, request.pictures.quality.height) == (640, 320)
    with pytest.raises(UsageError, match="projection spherical has no crop"):
        assert project.request(shot, "draft.crop0-0-64-64").pictures.quality
