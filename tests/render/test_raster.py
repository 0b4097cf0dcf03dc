"""The quick preview: what is in front is seen, lit from the right side, and lines know what hides them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flowsculpt.render.raster import Preview, Shape, StageSetup, prepare, preview, with_lines
from flowsculpt.render.raster.raster_shapes import LARGE, SMALL, ScreenProjection, VisibleFaces
from flowsculpt.render.raster.shadows import block_maxima, light_visibility
from flowsculpt.render.raster.triangles import LargeTriangles, Subsamples, draw_triangles
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.patterns import Pigment
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface

CAMERA = Camera((0.0, 0.0, 6.0), (0.0, 0.0, 0.0), field_of_view=math.radians(30))
SIZE = (64, 36)
SEEN = 0.065
"""A difference of display values that stands out, if one pixel alone has it."""

BARE = StageSetup(LIGHTS["studio"], STAGES["none"], StagePlacement((0.0, -1.0, 0.0)))


def square(z, half=0.5, look="clay", normal=(0.0, 0.0, 1.0)):
    corners = [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    faces = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
    return Shape(np.array(corners, float), np.array([normal] * 4, float), faces, LOOKS[look])


def joined(*shapes):
    starts = np.cumsum([0, *[len(shape.vertices) for shape in shapes]])
    faces = np.concatenate([shape.faces + start for shape, start in zip(shapes, starts, strict=False)])
    return Shape(
        np.concatenate([shape.vertices for shape in shapes]),
        np.concatenate([shape.normals for shape in shapes]),
        faces.astype(np.int32),
        shapes[0].material,
    )


def test_the_nearest_surface_is_seen_at_its_depth_in_either_order():
    near, far = square(1.0), square(-1.0, 1.02)
    for shape in (joined(near, far), joined(far, near)):
        depth = preview(shape, BARE, CAMERA, SIZE, "srgb").depth
        assert depth.shape == (36, 64)
        assert depth[18, 32] == pytest.approx(5.0) and depth[18, 48] == pytest.approx(7.0)
        assert np.isinf(depth[0, 0])


def test_a_surface_covers_the_pixels_that_the_camera_says():
    depth = preview(square(0.0), BARE, CAMERA, (256, 144), "srgb").depth
    half = 0.5 / 6.0 / math.tan(math.radians(15)) / 2 * 256
    assert np.isfinite(depth).sum() == pytest.approx((2 * half) ** 2, rel=0.03)


def test_what_goes_on_behind_the_camera_is_cut_there():
    floor = Shape(
        np.array([(-50, -1, 50), (50, -1, 50), (0, -1, -50)], float),
        np.array([(0, 1, 0)] * 3, float),
        np.array([(0, 1, 2)], np.int32),
        LOOKS["clay"],
    )
    depth = preview(floor, BARE, CAMERA, SIZE, "srgb").depth
    assert np.isfinite(depth[-1]).all() and np.isinf(depth[0]).all()
    down = math.tan(math.radians(15)) * 36 / 64
    assert depth[-1, 32] == pytest.approx(1.0 / down, rel=0.05)


def test_a_shadow_falls_away_from_the_key_light():
    """The light stands in the upper left front: the ground behind on the right is darker than on the left."""
    ball = joined(*[square(z, 0.4) for z in (-0.4, 0.0, 0.4)])
    around = StageSetup(LIGHTS["studio"], STAGES["cyclorama"], StagePlacement((0.0, -0.5, 0.0), 0.5))
    high = Camera((0.0, 5.0, 4.0), (0.0, -0.5, 0.0), field_of_view=math.radians(40))
    picture = preview(ball, around, high, SIZE, "srgb").picture
    assert picture.shape == (36, 64, 3) and (picture >= 0).all() and (picture <= 1).all()
    lit, shaded = picture[10:26, 10:24].mean(), picture[10:26, 36:46].min()
    assert shaded < 0.8 * lit


def test_lines_are_seen_before_a_surface_and_hardly_behind():
    grey = Preview(np.full((36, 64, 3), 0.5, np.float32), np.full((36, 64), 1.0 / 6.0, np.float32))
    x = np.linspace(-0.8, 0.8, 9)
    for z, least, most in ((1.0, 0.4, 0.5), (-1.0, 0.02, 0.06)):
        line = np.stack([x, 0 * x, z + 0 * x], axis=1)[None]
        colours = np.ones((1, 9, 3)) * [1.0, 0.0, 0.0]
        drawn = with_lines(grey, line, colours, np.ones((1, 9)), CAMERA, 2.0)
        change = drawn[..., 0] - 0.5
        assert least < change.max() <= most + 1e-6
        assert (np.abs(drawn - 0.5).max(axis=2) > 0).any(axis=1).sum() <= 4, "as wide as it is to be"
    assert (grey.picture == 0.5).all()


def test_a_pigment_colours_the_surface_where_its_points_came_from():
    pigment = Pigment("layers", ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), scale=1.0)
    look = replace(LOOKS["clay"], pigment=pigment)
    plain = square(0.0)
    material = np.float32([(0, 0.5, 0), (0, 0.5, 0), (0, 1.5, 0), (0, 1.5, 0)])
    surface = Surface(plain.vertices, plain.normals, plain.faces, rest=material)
    found = look.vertex_colours(surface)
    np.testing.assert_allclose(found, np.float64([(1, 0, 0), (1, 0, 0), (0, 0, 1), (0, 0, 1)]), atol=1e-3)
    assert LOOKS["clay"].vertex_colours(surface) is None
    shape = plain._replace(material=look, colours=found)
    picture = preview(shape, BARE, CAMERA, SIZE, "srgb").picture
    low, high = picture[23, 32], picture[13, 32]
    assert low[0] > low[2] + 0.1 and high[2] > high[0] + 0.1


@pytest.mark.parametrize(("pattern", "look"), [("layers", "clay"), ("chips", "cream"), ("spots", "chrome")])
def test_a_pigment_is_seen_between_vertices_as_in_renders(pattern, look):
    """Two triangles show a pattern finer than they are, in perspective, each pixel where it lies at rest."""
    ground, chip = (0.05, 0.05, 0.9), (0.9, 0.05, 0.05)
    pigment = Pigment(pattern, (ground, chip), scale=0.3, softness=0.0, share=0.7, turbulence=0.3, seed=2)
    corners = np.float64([(-1, -1, 1.5), (1, -1, 1.5), (1, 1, -1.5), (-1, 1, -1.5)])  # leans back
    up = np.tile([0.0, 0.8, 0.6], (4, 1))
    plate = Shape(corners, up, np.int32([(0, 1, 2), (0, 2, 3)]), replace(LOOKS[look], pigment=pigment))
    drawn = preview(plate._replace(rest=corners.astype(np.float32)), BARE, CAMERA, (256, 144), "srgb")
    rows, columns = np.nonzero(np.isfinite(drawn.depth))
    right, up, forward = CAMERA.axes()
    half = math.tan(CAMERA.field_of_view / 2.0)
    x, y = (columns + 0.5) / 128.0 - 1.0, 1.0 - (rows + 0.5) / 72.0
    rays = forward + half * (x[:, None] * right + y[:, None] * up * 144 / 256)
    points = np.array(CAMERA.origin) + rays * drawn.depth[rows, columns][:, None]
    shown, told = drawn.picture[rows, columns], pigment.colours_at(points)
    agree = (shown[:, 0] > shown[:, 2]) == (told[:, 0] > told[:, 2])
    assert len(rows) > 3000 and 0.1 < (told[:, 0] > told[:, 2]).mean() < 0.9
    assert agree.mean() > 0.95  # the others are on borders, where depth is that next to the middle


@pytest.mark.slow
@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("rig", LIGHTS)
def test_every_look_can_be_shown_in_every_light(look, rig):
    around = StageSetup(LIGHTS[rig], STAGES["cyclorama"], StagePlacement((0.0, -0.5, 0.0), 0.5))
    picture = preview(square(0.0, look=look), around, CAMERA, SIZE, "rec709").picture
    assert np.isfinite(picture).all() and 0.02 < picture[14:22, 26:38].mean() < 0.98


def cube(half=0.6):
    corners = np.array([(x, y, z) for x in (-half, half) for y in (-half, half) for z in (-half, half)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([f for a, b, c, d in sides for f in ((a, b, c), (a, c, d))], np.int32)
    return Shape(corners, corners / np.linalg.norm(corners, axis=1, keepdims=True), faces, LOOKS["clay"])


def cut(shape):
    """Every triangle in four."""
    vertices, normals, faces = shape.vertices, shape.normals, shape.faces
    middles = [(a + np.roll(a, -1, axis=1)) / 2 for a in (vertices[faces], normals[faces])]
    several = np.concatenate([vertices, middles[0].reshape(-1, 3)])
    turned = np.concatenate([normals, middles[1].reshape(-1, 3)])
    new = len(vertices) + np.arange(faces.size).reshape(-1, 3)
    (a, b, c), (ab, bc, ca) = faces.T, new.T
    pieces = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return shape._replace(vertices=several, normals=turned, faces=pieces.astype(np.int32))


@pytest.mark.parametrize("side", [1, -1], ids=["outwards", "inside out"])
@pytest.mark.parametrize("pieces", [0, 6], ids=["large", "small"])
def test_of_a_closed_surface_the_outer_side_is_seen_however_its_faces_run(side, pieces):
    shape = cube()
    for _ in range(pieces):
        shape = cut(shape)
    seen = preview(shape, BARE, CAMERA, SIZE, "srgb")
    shape = shape._replace(closed=True, faces=shape.faces[:, ::side].copy(), normals=side * shape.normals)
    culled = preview(shape, BARE, CAMERA, SIZE, "srgb")
    np.testing.assert_allclose(culled.nearness, seen.nearness, rtol=1e-5)
    assert np.abs(culled.picture - seen.picture).max() < 0.02


def ball(pieces):
    """A closed one of half-size 1, from a cube."""
    shape = cube(1.0)
    for _ in range(pieces):
        shape = cut(shape)
    points = shape.vertices / np.linalg.norm(shape.vertices, axis=1, keepdims=True)
    return shape._replace(vertices=points, normals=points, closed=True)


def around_each(mask, picture, least, reach=6):
    """The least, or the greatest, of the pixels of a mask up to `reach` away from each."""
    none = np.inf if least else -np.inf
    held, found = np.where(mask[..., None], picture, none), np.full_like(picture, none)
    shifts = range(-reach, reach + 1)
    for shift in ((y, x) for y in shifts for x in shifts):
        found = (np.minimum if least else np.maximum)(found, np.roll(held, shift, (0, 1)))
    return found


@pytest.mark.parametrize("pieces", [2, 3, 4])
def test_outlines_have_no_dots(pieces):
    """Pixels just behind an outline show their neighbours or the sky, never the inner side."""
    around = replace(BARE, lights=LIGHTS["daylight"])
    high = Camera((0.0, 3.0, 6.0), (0.0, 0.0, 0.0), field_of_view=math.radians(30))
    seen = preview(ball(pieces), around, high, (384, 216), "srgb")
    sky, inside = seen.picture[0, 0], seen.nearness > 0
    core = np.logical_and.reduce([np.roll(inside, (y, x), (0, 1)) for y in (-2, 0, 2) for x in (-2, 0, 2)])
    rim = around_each(core, seen.picture, least=True)[..., 0] < np.inf
    low = np.minimum(around_each(core, seen.picture, least=True), sky) - SEEN
    high = np.maximum(around_each(core, seen.picture, least=False), sky) + SEEN
    assert ((seen.picture >= low) & (seen.picture <= high))[rim].all()


def test_a_floor_lights_what_looks_down():
    lower = []
    for kind in ("none", "cyclorama"):
        around = StageSetup(LIGHTS["three_point"], STAGES[kind], StagePlacement((0.0, -1.0, 0.0)))
        lower.append(preview(ball(5), around, CAMERA, (192, 108), "srgb").picture[80:86, 86:106].mean())
    assert lower[1] > lower[0] + 0.05


def test_surfaces_look_the_same_in_large_and_in_small_triangles():
    """LargeTriangles ones are lit in each pixel, small ones at their corners; shadows fall alike on both."""
    around = StageSetup(LIGHTS["studio"], STAGES["none"], StagePlacement((0.0, -0.5, 0.0), 0.5))
    large = joined(square(-0.4, 0.9), square(0.3, 0.3))
    small = large
    for _ in range(6):
        small = cut(small)
    coarse, fine = (preview(shape, around, CAMERA, SIZE, "srgb").picture for shape in (large, small))
    shaded = preview(square(-0.4, 0.9), around, CAMERA, SIZE, "srgb").picture - coarse
    assert (shaded > 0.05).sum() > 30, "one square shades the other"
    assert np.abs(fine - coarse).mean() < 0.01 and np.quantile(np.abs(fine - coarse), 0.95) < 0.04


def covered(corners, rows, columns):
    """(H, W, 3): shares of the corners over the depth at each pixel, by solving for them (a slow twin)."""
    y, x = np.mgrid[0:rows, 0:columns]
    places = np.stack(
        [2 * (x + 0.5) / columns - 1, 1 - 2 * (y + 0.5) / rows, np.ones_like(x, float)], axis=-1
    )
    return places @ np.linalg.inv(corners)


@settings(deadline=None)  # the first example compiles
@given(
    st.lists(
        st.tuples(*[st.integers(-12, 12).map(lambda i: i / 4)] * 2, st.integers(-4, 12)),
        min_size=3,
        max_size=3,
    )
)
def test_a_triangle_anywhere_covers_the_pixels_that_see_it_and_no_others(points):
    """Behind the lens, along its axes, beside the picture, large and small."""
    corners = np.array([(x * max(abs(z), 1), y * max(abs(z), 1), z) for x, y, z in points], float)
    assume(abs(np.linalg.det(corners)) > 1e-6)
    rows, columns, closest = 30, 48, 0.01
    lens = ScreenProjection(np.zeros(3), np.eye(3), closest)
    faces = np.array([[0, 1, 2]], np.int32)
    shape = Shape(corners, np.tile([0.0, 0.0, -1.0], (3, 1)), faces, LOOKS["clay"]).for_kernels()
    seen = VisibleFaces.of(shape, lens, (rows, columns))
    near, colour = np.zeros((rows, columns), np.float32), np.zeros((rows, columns), np.uint32)
    name, grey = np.full((rows, columns), -1, np.int32), np.float32([[g] * 12 for g in (0.25, 0.5, 0.75)])
    room = np.empty((4, rows * columns), np.int32), np.empty((15, rows * columns), np.float32)
    none = np.zeros((0, 0), np.float32)
    large = LargeTriangles(shape.vertices, *lens, grey, none, none, none, 1.0, 1.0, *room)
    for order in seen.orders:
        draw_triangles(
            order, faces, 7, seen.screen, grey[:, :3].copy(), large, Subsamples(near, colour, name)
        )
    shares = covered(corners, rows, columns)
    total = shares.sum(axis=2)
    inside = (shares > 1e-4 * abs(shares).max()).all(axis=2) & (total < 1.0 / closest - 1e-6)
    outside = (shares < -1e-4 * abs(shares).max()).any(axis=2)
    assert (name[inside] == 7).all() and (name[outside] == -1).all()
    shown = np.array([colour[name == 7] >> shift & 1023 for shift in (20, 10, 0)]) / 1023
    assert ((shown > 0.248) & (shown < 0.752)).all(), "nowhere brighter or darker than its corners"
    assert (colour[name < 0] == 0).all()
    np.testing.assert_allclose(near[inside], total[inside], rtol=1e-3)
    if (name == 7).any():
        assert sorted(len(seen.corners_of(kind)) for kind in (SMALL, LARGE)) == [0, 3]


@pytest.mark.parametrize("slope", [0.0, 0.07, 0.2, 0.45])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_border_of_a_shadow_is_straight(axis: int, slope: float) -> None:
    rows, columns = np.mgrid[:128, :128] + 0.5
    nearness = (2.0 * (rows < 64.0 + slope * (columns - 64.0))).astype(np.float32)
    along = np.linspace(-0.5, 0.5, 200)
    places = np.ones((3, 200), np.float32)
    places[0], places[1] = along, -slope * along
    if axis:
        nearness = np.ascontiguousarray(nearness.T)
        places[:2] = -places[1::-1]
    blocks, fraction = np.empty((16, 16), np.float32), np.empty(200, np.float32)
    block_maxima(nearness, blocks)
    light_visibility(places, nearness, blocks, 1.0, fraction)
    assert np.ptp(fraction) < 0.1, "every second row and column alone would give 0.22"


def test_shadows_of_vertices_and_of_pixels_share_one_kernel() -> None:
    prepare()
    assert len(light_visibility.signatures) == 1


@pytest.mark.parametrize("axis", [0, 1])
def test_the_border_of_a_shadow_has_no_steps(axis: int) -> None:
    nearness = np.zeros((64, 64), np.float32)
    nearness[:, :32] = 2.0
    places = np.zeros((3, 400), np.float32)
    places[axis], places[2] = np.linspace(-0.25, 0.25, 400), 1.0
    if axis:
        nearness = np.ascontiguousarray(nearness.T[::-1])  # rows go downwards
    blocks, fraction = np.empty((8, 8), np.float32), np.empty(400, np.float32)
    block_maxima(nearness, blocks)
    light_visibility(places, nearness, blocks, 1.0, fraction)
    assert fraction[0] == 0.0 and fraction[-1] == 1.0
    assert np.abs(np.diff(fraction)).max() < 0.08  # a filter of five equal pixels has a fifth
