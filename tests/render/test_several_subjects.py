"""Scenes of several subjects: each with its own material, name and coverage."""

from dataclasses import replace

import numpy as np
import pytest

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.scene.materials import LOOKS, Diffuse, Glass, Subsurface
from flowsculpt.render.scene.scene import Scene, SceneSubject
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Spheres, Surface, Wireframe
from tests.render.conftest import CAMERA, TINY

LEFT, RIGHT = (np.array([x, 0.0, 0.0], np.float32) for x in (-1.1, 1.1))


@pytest.fixture
def balls(sphere):
    """Two spheres that stand side by side."""
    return tuple(
        replace(sphere, vertices=sphere.vertices + side, rest=sphere.vertices) for side in (LEFT, RIGHT)
    )


@pytest.fixture
def of_two(balls, engine):
    def rendered(left="clay", right="chrome", stage="cyclorama", **changes):
        left, right = (LOOKS[look] if isinstance(look, str) else look for look in (left, right))
        others = (SceneSubject("heron", changes.pop("second", balls[1]), right),)
        first = changes.pop("first", balls[0])
        placed = STAGES[stage], StagePlacement(), CAMERA
        scene = Scene(first, left, LIGHTS["studio"], *placed, others=others, name="crane")
        return render_frame(scene, TINY, 3, engine, **changes)

    return rendered


def test_two_subjects_of_one_material_look_as_one_surface_of_both(balls, of_two, engine):
    a, b = balls
    both = Surface(
        np.concatenate([a.vertices, b.vertices]),
        np.concatenate([a.normals, b.normals]),
        np.concatenate([a.faces, b.faces + len(a.vertices)]).astype(np.int32),
    )
    scene = Scene(both, LOOKS["clay"], LIGHTS["studio"], STAGES["cyclorama"], StagePlacement(), CAMERA)
    joined, apart = render_frame(scene, TINY, 3, engine), of_two("clay", "clay")
    for name in ("beauty", "albedo", "depth", "matte", "alpha"):
        assert np.abs(joined[name] - apart[name]).mean() < 1e-5 * max(1.0, joined[name].mean()), name


def test_each_subject_has_its_own_material_and_coverage(of_two, engine):
    layers = of_two("coffee", "cream")
    assert layers.facts["surface_vertices"] == 2 * 312
    if engine.variant != "scalar_rgb":
        crane, heron = layers["coverage.crane"], layers["coverage.heron"]
        assert "coverage.subject" not in layers.arrays
        assert crane.max() == heron.max() == 1.0 and ((crane == 1.0) & (heron == 1.0)).sum() == 0
        assert np.abs(crane + heron - layers["matte"]).mean() < 0.02
        dark, pale = (layers["albedo"][mask == 1.0].mean() for mask in (crane, heron))
        assert dark < 0.1 < 0.5 < pale


def test_vertex_aovs_show_the_values_of_each_subject(balls, of_two):
    first, second = (
        replace(ball, attributes={"velocity": np.full_like(ball.vertices, speed)})
        for ball, speed in zip(balls, (1.0, -2.0), strict=True)
    )
    velocity = of_two(first=first, second=second, aovs=("velocity",))["velocity"]
    assert velocity.max() == pytest.approx(1.0, abs=1e-5) and velocity.min() == pytest.approx(-2.0, abs=1e-5)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (
            Diffuse((0.7, 0.6, 0.5), subsurface=Subsurface((0.2, 0.1, 0.05))),
            Glass((1.0, 1.0, 1.0), subsurface=Subsurface((0.3, 0.3, 0.3))),
        ),
        ("glass", "smoke"),
        ("brushed", Diffuse((0.5, 0.5, 0.5), wireframe=Wireframe())),
    ],
    ids=["two that scatter light inside", "two that light passes through", "scratches beside lines"],
)
def test_materials_of_different_kinds_stand_in_one_scene(left, right, of_two):
    layers = of_two(left, right)
    assert np.isfinite(layers["beauty"]).all() and layers["beauty"].mean() > 0.05


def test_points_stand_beside_a_surface(of_two):
    cloud = Spheres(RIGHT[None] + np.array([[0.0, 1.0, 0.0]], np.float32), np.array([0.8], np.float32))
    assert of_two(second=cloud)["matte"].mean() > 0.1


def test_a_look_without_lights_stands_alone(of_two):
    with pytest.raises(BadInputError, match="shows one subject, and the scene has several"):
        of_two("symbolics_1990", "clay")
