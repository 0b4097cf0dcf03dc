"""Clear subjects in quick previews: their thickness is exact, and the stage is seen through them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.mesh import box, icosphere, vertex_normals
from flowsculpt.render.raster import Shape, StageSetup, preview
from flowsculpt.render.raster.raster_shapes import ScreenProjection
from flowsculpt.render.raster.see_through import add_thickness
from flowsculpt.render.raster.shadows import CELL, CELLS, ContactShadow
from flowsculpt.render.raster.triangles import SUPERSAMPLING
from flowsculpt.render.scene.materials import LOOKS, Diffuse, Smoke
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, Stage, StagePlacement

SIZE = (96, 54)
CAMERA = Camera((0.0, 0.4, 6.0), (0.0, 0.0, 0.0), field_of_view=math.radians(30))
SETUP = StageSetup(LIGHTS["studio"], STAGES["cyclorama"], StagePlacement((0.0, -1.0, 0.0)))


def ball(material, centre=(0.0, 0.0, 0.0), radius=1.0):
    mesh = icosphere(12)
    return Shape(mesh.vertices * radius + centre, mesh.vertices, mesh.faces, material, closed=True)


def thickness_of(shape, camera, outwards=1):
    projection = ScreenProjection.of(camera, SIZE[0] / SIZE[1])
    screen = projection.project(
        shape.for_kernels().vertices, SIZE[1] * SUPERSAMPLING, SIZE[0] * SUPERSAMPLING
    )
    thickness = np.zeros((SIZE[1], SIZE[0]), np.float32)
    layers = np.zeros((SIZE[1], SIZE[0], 2), np.int32)
    add_thickness(shape.for_kernels().faces, screen, outwards, thickness, layers)
    return thickness, layers


@pytest.mark.slow
@settings(deadline=None, max_examples=30)
@given(st.floats(-3.0, 3.0), st.floats(-1.4, 1.4), st.floats(3.0, 9.0))
def test_a_ball_is_as_thick_as_its_chords_from_wherever_it_is_seen(azimuth, elevation, distance):
    level = distance * math.cos(elevation)
    place = level * math.sin(azimuth), distance * math.sin(elevation), level * math.cos(azimuth)
    thickness, layers = thickness_of(ball(LOOKS["glass"]), Camera(place, (0.0, 0.0, 0.0)))
    assert (layers[..., 0] == layers[..., 1]).all() and layers.max() == 1, (
        "no pixel is missed or counted twice"
    )
    assert thickness.max() == pytest.approx(2.0, abs=0.03) and thickness.min() > -1e-3
    assert (thickness[layers[..., 0] == 0] == 0.0).all()


def test_two_balls_in_a_row_are_as_thick_as_both():
    near, far = ball(LOOKS["glass"]), ball(LOOKS["glass"], (0.0, 0.0, -3.0), 0.5)
    both = near._replace(
        vertices=np.concatenate([near.vertices, far.vertices]),
        faces=np.concatenate([near.faces, far.faces + np.int32(len(near.vertices))]),
    )
    camera = Camera((0.0, 0.0, 6.0), (0.0, 0.0, 0.0))
    thickness, layers = thickness_of(both, camera)
    assert layers[SIZE[1] // 2, SIZE[0] // 2].tolist() == [2, 2]
    assert thickness.max() == pytest.approx(3.0, abs=0.05)


def test_what_is_inside_out_is_as_thick():
    shape = ball(LOOKS["glass"])
    turned = shape._replace(faces=shape.faces[:, ::-1])
    np.testing.assert_array_equal(thickness_of(shape, CAMERA)[0], thickness_of(turned, CAMERA, -1)[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    "look", [LOOKS["glass"], LOOKS["frosted"], LOOKS["honey"], Smoke((0.2, 0.2, 0.2), density=0.3)]
)
def test_the_stage_is_seen_through_what_is_clear(look):
    """A bright stage makes a clear subject brighter than a dark stage does; a grey one hardly changes."""
    bright, dark = (
        StageSetup(LIGHTS["studio"], Stage(colour=(c, c, c)), SETUP.placement) for c in (0.7, 0.03)
    )
    middle = np.s_[20:34, 40:56]
    seen = [
        np.subtract(
            *(preview(ball(m), s, CAMERA, SIZE, "srgb").picture[middle].mean() for s in (bright, dark))
        )
        for m in (look, Diffuse((0.2, 0.2, 0.2)))
    ]
    assert seen[0] > 2.0 * seen[1]


def test_denser_smoke_hides_more():
    stage = StageSetup(LIGHTS["studio"], STAGES["cyclorama"], SETUP.placement)
    empty = preview(ball(LOOKS["smoke"], (90.0, 0.0, 0.0)), stage, CAMERA, SIZE, "srgb").picture
    hidden = [
        np.abs(preview(ball(Smoke((0.1, 0.1, 0.1), density=d)), stage, CAMERA, SIZE, "srgb").picture - empty)
        for d in (0.1, 0.5, 2.5)
    ]
    change = [part[20:34, 40:56].mean() for part in hidden]
    assert change[0] < change[1] < change[2]


def test_the_floor_is_dark_where_a_ball_touches_it():
    standing, raised = (
        ContactShadow.of(
            ball(LOOKS["clay"], (0.0, y, 0.0)).for_kernels().vertices, StagePlacement(), True
        ).open
        for y in (1.0, 1.6)
    )
    middle, away = CELLS // 2, CELLS // 2 + round(1.6 / CELL)
    assert standing[middle, middle] < 0.25 < raised[middle, middle] < 0.8
    assert standing[middle, away] > 0.7 and raised[middle, away] > 0.7
    assert (standing <= 1.0).all() and (standing > 0.0).all()


def test_a_contact_shadow_is_no_dark_ring_where_the_key_light_falls():
    """On the side of the key light the floor beside a block is almost as bright as far from it."""
    block = box((1.0, 2.0, 1.0), 0.1)
    vertices = block.vertices - [0.0, block.vertices[:, 1].min(), 0.0]
    shape = Shape(vertices, vertex_normals(block), block.faces, LOOKS["clay"], closed=True)
    setup = StageSetup(LIGHTS["studio"], STAGES["cyclorama"], StagePlacement())
    camera = Camera((0.0, 12.0, 0.1), (0.0, 0.0, 0.0))
    floor = preview(shape, setup, camera, SIZE, "srgb").picture.mean(axis=2)

    def value(x, z):
        column, row = camera.project(np.array([[x, 0.0, z]]), SIZE[0] / SIZE[1])[0, :2]
        return floor[int((1.0 - row) / 2.0 * SIZE[1]), int((column + 1.0) / 2.0 * SIZE[0])]

    towards_key, behind = value(-0.7, 0.7), value(0.7, -0.7)
    assert 0.85 * value(-1.3, 1.3) < towards_key and behind < 0.8 * towards_key
