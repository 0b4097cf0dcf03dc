"""Clouds of points: as round as the picture shows, in every layer."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.surface import MAX_FACES, TOLERANCE, Spheres

CAMERA = Camera((0.0, 0.0, 10.0), (0.0, 0.0, 0.0))
PIXELS_A_UNIT = 1920 / 2 / math.tan(CAMERA.field_of_view / 2) / 10


def spheres(centres: object, radii: object, **attributes: object) -> Spheres:
    named = {name: np.asarray(values, np.float32) for name, values in attributes.items()}
    return Spheres(np.asarray(centres, np.float32).reshape(-1, 3), np.asarray(radii, np.float32), named)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.001, 2.0))
def test_an_outline_lies_as_near_to_a_circle_as_the_picture_shows(radius: float) -> None:
    surface = spheres([[0, 0, 0]], [radius]).surface(CAMERA, 1920)
    surface.check()
    corners = surface.vertices[surface.faces].astype(np.float64)
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    for points in (corners, middles):
        away = np.abs(np.linalg.norm(points, axis=2) - radius)
        assert away.max() * PIXELS_A_UNIT < max(2 * TOLERANCE, 0.2 * radius * PIXELS_A_UNIT)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.002, 1.0))
def test_a_sphere_hides_as_much_as_it_should_from_all_sides(radius: float) -> None:
    surface = spheres([[0, 0, 0]], [radius]).surface(CAMERA, 1920)
    a, b, c = surface.vertices[surface.faces].astype(np.float64).transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(4 * math.pi * radius**2, rel=1e-5)


def test_spheres_are_closed_face_outwards_and_have_their_normals() -> None:
    surface = spheres([[1, 2, 3], [-1, 0, 0]], [0.5, 0.02]).surface(CAMERA, 480)
    edges = np.stack([surface.faces, np.roll(surface.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    assert {(a, b) for a, b in edges.tolist()} == {(b, a) for a, b in edges.tolist()}
    corners = surface.vertices[surface.faces]
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((outwards * surface.normals[surface.faces[:, 0]]).sum(axis=1) > 0).all()
    assert np.linalg.norm(surface.normals, axis=1) == pytest.approx(1, abs=1e-6)


def test_near_and_large_spheres_are_finer_than_far_and_small_ones() -> None:
    def faces(z: float, radius: float) -> int:
        return len(spheres([[0, 0, z]], [radius]).surface(CAMERA, 1920).faces)

    assert faces(0, 0.001) == 20
    assert faces(5, 0.1) > faces(0, 0.1) > faces(-30, 0.1)
    assert faces(0, 0.4) > faces(0, 0.1)


@pytest.mark.slow
def test_too_many_spheres_become_coarser_rather_than_too_large() -> None:
    many = 30_000
    centres = np.random.default_rng(0).normal(size=(many, 3))
    surface = spheres(centres, np.full(many, 0.1)).surface(CAMERA, 1920)
    assert many * 20 < len(surface.faces) <= MAX_FACES


def test_every_vertex_has_the_attributes_of_its_point() -> None:
    centres = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    cloud = spheres(centres, [0.01, 0.3, 0.01], tint=centres)
    surface = cloud.surface(CAMERA, 1920)
    nearest = np.linalg.norm(surface.vertices[:, None] - centres, axis=2).argmin(axis=1)
    assert np.array_equal(surface.attributes["tint"], centres[nearest].astype(np.float32))


@pytest.mark.parametrize(
    ("centres", "radii", "message"),
    [
        (np.empty((0, 3)), [], "the cloud is empty"),
        ([[0, 0, np.nan]], [1], "point 0 of the cloud and 0 others are not finite"),
        ([[0, 0, 0], [0, 0, 1]], [1, 0], "point 1 of the cloud"),
        ([[0, 0, 0]], [1, 1], "not .N, 3. and .N,."),
    ],
)
def test_clouds_that_cannot_be_rendered_are_refused(centres: object, radii: object, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        spheres(centres, radii).surface(CAMERA, 480)


def test_a_cloud_is_seen_in_every_layer_where_the_camera_projects_it(
    rendered: Callable[..., RenderedFrame], picture: RenderedFrame
) -> None:
    """One sphere as a cloud is the picture of the sphere as a surface, but for its facets."""
    cloud = rendered(surface=spheres([[0, 1, 0]], [1]))
    assert cloud["matte"].sum() == pytest.approx(picture["matte"].sum(), rel=0.02)
    inside = (cloud["matte"] == 1) & (picture["matte"] == 1)
    for name, most in (("albedo", 1e-3), ("depth", 0.1), ("position", 0.12), ("normal", 0.15)):
        assert np.abs(cloud[name][inside] - picture[name][inside]).max() < most
    assert np.median(np.abs(cloud["beauty"] - picture["beauty"])) < 0.02


def test_a_cloud_gives_the_same_bits_again(rendered: Callable[..., RenderedFrame]) -> None:
    cloud = spheres(np.random.default_rng(2).normal(size=(50, 3)), np.full(50, 0.1))
    one, other = (rendered(surface=cloud)["beauty"] for _ in range(2))
    assert np.array_equal(one, other)
