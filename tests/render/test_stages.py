"""Stages: seamless, in their place, and never in front of the subject."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.production.request.framing import Framer
from flowsculpt.pipeline.shot.camera_path import View
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.raster import Shape, StageSetup, preview
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.reference_objects import CHROME, GREY, ball, chart, chart_colours, positions
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.room_shapes import WINDOWS, window_frame
from flowsculpt.render.scene.scene_lights import LightRig, Sky, Softbox
from flowsculpt.render.scene.scene_stage import STAGES, Stage, StagePlacement

Rendered = Callable[..., RenderedFrame]
ASPECT = 16 / 9
FRONT = Camera((0.0, 2.4, 7.6), (0.0, 0.7, 0.0))


GLOSSY = Stage(roughness=0.2)
GRADED = replace(GLOSSY, wall_colour=(0.1, 0.1, 0.3))


@pytest.mark.parametrize("stage", [*STAGES.values(), Stage("plinth", round=True), GLOSSY, GRADED])
def test_every_stage_renders_and_is_no_part_of_the_matte(
    stage: Stage, rendered: Rendered, picture: RenderedFrame
) -> None:
    layers = rendered(stage=stage)
    assert np.isfinite(layers["beauty"]).all()
    assert np.array_equal(layers["matte"], picture["matte"])
    assert layers["beauty"][layers["matte"] == 1.0].mean() > 0.1


@pytest.mark.parametrize(
    "stage",
    [
        *(Stage(kind) for kind in ("ground", "plinth", "corner", "window", "fog", "shelf", "stair", "table")),
        Stage("plinth", round=True),
        Stage("plinth", width=0.3),
    ],
    ids=lambda stage: stage.kind,
)
def test_normals_agree_with_the_faces(stage: Stage) -> None:
    frame = window_frame(WINDOWS[stage.kind]) if stage.kind in WINDOWS else None
    for vertices, normals, faces in filter(None, (stage.backdrop(), stage.plinth(), frame)):
        assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-5)
        corners = vertices[faces].astype(np.float64)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(across, axis=1, keepdims=True)
        assert area.min() > 0.0
        assert np.einsum("ijk,ik->ij", normals[faces], across / area).min() > math.cos(math.radians(46.0))


def test_a_graded_wall_changes_from_the_colour_of_the_floor_to_its_own_with_a_halo_behind_the_subject() -> (
    None
):
    stage = Stage("plinth", colour=(0.1, 0.1, 0.1), wall_colour=(0.5, 0.0, 0.0), halo_colour=(0.0, 0.0, 1.0))
    stage = replace(stage, halo_distance=9.0)
    vertices, colours = stage.backdrop()[0], stage.reflectances()
    radius = np.hypot(vertices[:, 0], vertices[:, 2])
    before_the_camera = (vertices[:, 2] > 10.0) & (radius > 0.999 * radius.max())
    assert np.abs(colours[before_the_camera] - [0.5, 0.0, 0.0]).max() < 0.01
    assert np.abs(colours[radius == 0.0] - 0.1).max() < 0.12
    bluest = vertices[np.argmax(colours[:, 2])]
    assert bluest[2] == pytest.approx(-9.0, abs=0.3) and abs(bluest[0]) < 0.1
    assert len(Stage().reflectances()) < len(colours), "a wall of one colour needs few vertices"


def test_a_halo_lights_the_wall_behind_the_subject(rendered: Rendered) -> None:
    stage = Stage(colour=(0.02, 0.02, 0.02), halo_colour=(0.9, 0.3, 0.1), halo_size=6.0)
    plain, lit = (rendered(stage=each)["beauty"] for each in (replace(stage, halo_colour=None), stage))
    gain = (lit - plain)[:4].mean(axis=(0, 1))
    assert gain[0] > 2.0 * gain[2] > 0.0


def test_a_plinth_carries_the_subject_and_stands_on_the_floor() -> None:
    for is_round in (False, True):
        stage = Stage("plinth", width=1.2, height=0.9, round=is_round)
        vertices, _, faces = stage.plinth()
        assert vertices[:, 1].max() == 0.0
        assert vertices[:, 1].min() == pytest.approx(-0.9)
        assert stage.backdrop()[0][:, 1].min() == pytest.approx(-0.9)
        assert np.ptp(vertices[:, 0]) == pytest.approx(1.2, abs=1e-5)
        area = 1.2**2 * (math.pi / 4 if is_round else 1.0)
        corners = vertices[faces].astype(np.float64)
        volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
        foot = area * 0.9 / 3.0  # the open foot, seen from the origin
        assert volume + foot == pytest.approx(area * 0.9, rel=0.02)
        assert len(stage.mesh()[0]) == len(vertices) + len(stage.backdrop()[0])


def test_the_ground_is_level_near_the_subject_and_reaches_the_height_of_the_eye() -> None:
    vertices, _, _ = Stage("ground").backdrop()
    radius = np.hypot(vertices[:, 0], vertices[:, 2])
    assert np.abs(vertices[radius < 41.0, 1]).max() < 1e-6
    assert vertices[radius > 399.0, 1] == pytest.approx(4.0)


HAZE = Stage("ground", horizon_fade=math.radians(6.0))
LOW = Camera((0.0, 1.0, 7.0), (0.0, 1.6, 0.0), field_of_view=math.radians(40.0))
SKY = LightRig((), sky=Sky((0.1, 0.2, 0.9), (0.1, 0.1, 0.5), (0.1, 0.1, 0.5), visible=True))


def test_ground_that_fades_is_whole_near_the_subject_and_gone_at_its_rim() -> None:
    vertices, _, _ = HAZE.backdrop()
    radius, there = np.hypot(vertices[:, 0], vertices[:, 2]), HAZE.opacity_at(vertices)
    assert (there[radius <= 40.0] == 1.0).all() and (there[radius > 399.0] == 0.0).all()
    assert (np.diff(there[np.argsort(radius)]) <= 1e-6).all()
    rim = vertices[radius.argmax()]
    assert math.degrees(math.atan2(rim[1] - 4.0, np.hypot(*rim[[0, 2]]))) == pytest.approx(6.0, abs=0.05)


def steepest(column: np.ndarray) -> float:
    """Return the largest change from one row to the next, over the whole change."""
    return float(np.abs(np.diff(column)).max() / np.ptp(column))


def test_a_hazy_horizon_has_no_line(rendered: Rendered, engine: Engine) -> None:
    """At the left edge ground becomes sky: all at once, or over the six degrees of the haze."""
    if engine.variant == "scalar_rgb":
        pytest.skip("a hazy horizon needs a compiled variant")
    quality = Quality(64, 36, 64, depth=3)
    hard, soft = (
        rendered(stage=stage, camera=LOW, lights=SKY, quality=quality)["beauty"][:, :6, 0].mean(axis=1)
        for stage in (replace(HAZE, horizon_fade=0.0), HAZE)
    )
    assert steepest(hard) > 0.75 and steepest(soft) < 0.45
    assert hard[[0, -1]] == pytest.approx(soft[[0, -1]], rel=0.1)


def test_a_preview_has_the_haze_too() -> None:
    ball = icosphere(3)
    shape = Shape(ball.vertices + np.array([0.0, 1.0, 0.0]), ball.vertices, ball.faces, LOOKS["clay"])
    hard, soft = (
        preview(shape, StageSetup(SKY, stage, StagePlacement()), LOW, (256, 144), "srgb")
        .picture[:, 4]
        .astype(float)
        .sum(axis=1)
        for stage in (replace(HAZE, horizon_fade=0.0), HAZE)
    )
    assert steepest(hard) > 0.75 and steepest(soft) < 0.25


views = st.tuples(
    st.floats(-3.0, 3.0),
    st.floats(-0.3, 1.2),
    st.floats(math.radians(10.0), math.radians(70.0)),
    st.floats(0.05, 0.2),
).map(lambda values: View(*values))
sizes = st.tuples(*[st.floats(0.2, 4.0)] * 3)
aspects = st.sampled_from([ASPECT, 9 / 16, 1.0, 2.39])


@settings(max_examples=30, deadline=None)
@given(views, sizes, aspects)
def test_pieces_stand_in_the_lower_corners_below_the_subject(
    view: View, size: tuple[float, ...], aspect: float
) -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size
    (framing,) = Framer([view], lambda _: corners, aspect).all()
    plain = framing.camera.project(corners, aspect)
    framing = framing.with_stage_in_view(STAGES["turntable"], aspect)
    camera = framing.camera
    lowest = camera.project(corners, aspect)[:, 1].min()
    grey, chrome, board = positions(camera, framing.placement, aspect)
    seen = [
        camera.project(shape.vertices, aspect) for shape in (ball(grey), ball(chrome), chart(board, camera))
    ]
    for each in seen:
        assert np.abs(each[:, :2]).max() < 1.0
        assert each[:, 2].min() > 0.0
        if view.margin >= 0.1 and view.field_of_view < math.radians(40.0):
            assert each[:, 1].max() < lowest + 0.01
    assert seen[0][:, 0].max() < seen[1][:, 0].min() < 0.0 < seen[2][:, 0].min()
    assert np.abs(plain[:, :2]).max() < 1.0


@settings(max_examples=30, deadline=None)
@given(views, sizes, aspects)
def test_a_plinth_leaves_the_subject_in_the_picture(
    view: View, size: tuple[float, ...], aspect: float
) -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size
    (framing,) = Framer([view], lambda _: corners, aspect).all()
    seen = framing.with_stage_in_view(STAGES["plinth"], aspect).camera.project(corners, aspect)
    assert np.abs(seen[:, :2]).max() < 1.0
    assert framing.with_stage_in_view(STAGES["cyclorama"], aspect) == framing


def test_the_chart_has_the_published_colours() -> None:
    colours = chart_colours()
    assert colours.shape == (4, 6, 3)
    # ISO 17321's neutrals: reflectances 0.90, 0.59, 0.36, 0.20, 0.09, 0.03
    assert colours[3, :, 1] == pytest.approx([0.9, 0.58, 0.35, 0.195, 0.09, 0.034], abs=0.012)
    assert colours[2, 2].argmax() == 0 and colours[2, 1].argmax() == 1 and colours[2, 0].argmax() == 2


def test_albedos_of_the_pieces_are_what_they_reflect(rendered: Rendered) -> None:
    quality = Quality(480, 270, samples=1, depth=2, auxiliary_samples=4)
    layers = rendered(stage=STAGES["turntable"], camera=FRONT, quality=quality)
    grey, chrome, board = positions(FRONT, StagePlacement(), ASPECT)

    def there(points: np.ndarray) -> np.ndarray:
        x, y, _ = FRONT.project(points, ASPECT).T
        return layers["albedo"][((1.0 - y) / 2.0 * 270).astype(int), ((x + 1.0) / 2.0 * 480).astype(int)]

    assert there(grey.middle[None])[0] == pytest.approx([GREY] * 3, abs=1e-3)
    assert there(chrome.middle[None])[0] == pytest.approx([CHROME] * 3, abs=1e-3)
    patches = chart(board, FRONT)
    middles = patches.vertices.reshape(-1, 4, 3)[1:].mean(axis=1).astype(np.float64)
    assert there(middles) == pytest.approx(chart_colours().reshape(-1, 3), abs=2e-3)


def test_a_chrome_ball_mirrors_what_a_grey_one_scatters(rendered: Rendered) -> None:
    quality = Quality(480, 270, samples=4, depth=3, auxiliary_samples=1)
    beauty = rendered(stage=STAGES["turntable"], camera=FRONT, quality=quality)["beauty"].mean(axis=2)
    grey, chrome, _ = positions(FRONT, StagePlacement(), ASPECT)
    bright = []
    for spot in (grey, chrome):
        x, y, _ = FRONT.project(spot.middle[None], ASPECT)[0]
        row, column = int((1.0 - y) * 135), int((x + 1.0) * 240)
        bright.append(np.percentile(beauty[row - 10 : row + 10, column - 10 : column + 10], [50, 99]))
    assert bright[1][1] > 2.0 * bright[0][1]


@pytest.mark.parametrize(
    "make",
    [
        lambda: Stage("plynth"),
        lambda: Stage(width=0.0),
        lambda: Stage(height=0.1),
        lambda: Stage(roughness=2),
        lambda: Stage("cyclorama", horizon_fade=0.1),
        lambda: Stage("ground", horizon_fade=1.0),
    ],
)
def test_a_stage_that_cannot_be_is_refused(make: Callable[[], Stage]) -> None:
    with pytest.raises(BadInputError):
        make()


def test_a_coat_on_the_floor_mirrors_a_lamp_behind(rendered: Rendered) -> None:
    black = Stage(colour=(0.0, 0.0, 0.0))
    lamp = LightRig((Softbox((0.0, 2.4, -6.0), 9.0, 3.0, (50.0, 50.0, 50.0)),))
    matt, coated = (
        rendered(stage=stage, camera=FRONT, lights=lamp) for stage in (black, replace(black, roughness=0.05))
    )
    floor = (slice(24, 27), slice(2, 8))
    assert matt["beauty"][floor].max() == 0.0
    assert coated["beauty"][floor].mean() > 1.0
