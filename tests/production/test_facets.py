"""Outlines show no corners: surfaces are cut as finely as their pictures need, and no finer."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.mesh import box, icosphere
from flowsculpt.pipeline.mesh.normals import split_at_creases
from flowsculpt.pipeline.production.request.framing import Framer
from flowsculpt.pipeline.production.request.shading import LEAST, dice, pieces_without_facets
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.camera_path import View
from flowsculpt.render.scene.render_quality import QUALITIES

pytestmark = pytest.mark.quick

VIEW = View(0.4, 0.25, math.radians(26), 0.1)


def arrays_of(mesh):
    split = split_at_creases(mesh, math.radians(40))
    return {**split._asdict(), "material": split.vertices.astype(np.float32)}


def camera_at(arrays):
    return Framer([VIEW], lambda _: arrays["vertices"], 16 / 9).all()[0].camera


def pieces(arrays, quality="draft"):
    return pieces_without_facets(arrays, camera_at(arrays), QUALITIES[quality], 0.0)


@settings(deadline=None, max_examples=15)
@given(st.integers(5, 24), st.sampled_from(["draft", "daily", "final"]))
def test_the_outline_of_a_ball_is_round_to_a_fraction_of_a_pixel(segments, quality):
    arrays = arrays_of(icosphere(segments))
    count = pieces(arrays, quality)
    fine = dice(arrays, count)
    middles = fine["vertices"][fine["faces"]][:, :2].mean(axis=1)
    camera, size = camera_at(arrays), QUALITIES[quality].width
    distance = math.dist(camera.origin, (0.0, 0.0, 0.0))
    pixels = size / 2 / math.tan(camera.field_of_view / 2) / distance
    if count < 8:
        assert np.quantile(1.0 - np.linalg.norm(middles, axis=1), 0.95) * pixels < 2.0 * LEAST


def test_flat_sides_and_fine_meshes_are_left_alone():
    assert pieces(arrays_of(box((2, 2, 2)))) == 1
    fine = arrays_of(icosphere(40))
    assert pieces(fine) == 1
    assert dice(fine, 1) == fine


def test_a_larger_picture_shows_more_and_a_farther_camera_less():
    arrays = arrays_of(icosphere(8))
    assert pieces(arrays, "draft") < pieces(arrays, "final")
    camera = camera_at(arrays)
    farther = replace(camera, origin=tuple(20.0 * x for x in camera.origin))
    assert pieces_without_facets(arrays, farther, QUALITIES["draft"], 0.0) == 1


def test_materials_lie_where_the_patches_are():
    arrays = arrays_of(icosphere(3))
    fine = dice(arrays, 4)
    assert len(fine["faces"]) == 16 * len(arrays["faces"])
    np.testing.assert_allclose(fine["material"], fine["vertices"], atol=0.05)


SHOT = (
    "title: A ball\nframes: 1-2\nsubject: {solid: icosphere}\nresample: {max_edge_length: 0.1}\nlook: clay\n"
)


@pytest.mark.parametrize(
    ("edit", "hides"),
    [("", True), ("smooth: {tessellate: 1}", False), ("smooth: {dicing: 3px}", False)],
)
def test_what_a_shot_says_of_smoothing_is_done_instead(edit, hides):
    assert read_shot("ball.yaml", SHOT + edit).picture.hide_facets is hides
    assert not read_shot("ball.yaml", SHOT.replace("clay", "symbolics_1990")).picture.hide_facets
