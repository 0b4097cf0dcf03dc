"""Every vertex of every frame knows where it was in the undeformed subject, however the surface is kept."""

from __future__ import annotations

import numpy as np
import pytest

from flowsculpt.pipeline.animation import MeshFrame, animate, material_of
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh.normals import split_at_creases, spread, spread_curved, tessellate
from flowsculpt.pipeline.mesh.solids import box, icosphere
from flowsculpt.pipeline.shot import Shot, read_shot
from tests.needed_plugins import needs_plugins

SHEAR = """
title: T
frames: 1-13
subject: {solid: icosphere, radius: 1}
resample: %s
flows: [{shear: {axis: y, direction: x, amount: {ease: linear, keys: {1: 0, 13: 1.5}}}}]
"""


def shot_of(resample: str) -> Shot:
    return read_shot("a.yaml", SHEAR % resample)


def undone(points: np.ndarray, frame: int) -> np.ndarray:
    """Return the rest positions of points of a frame: the shear is linear, so its inverse is known."""
    amount = 1.5 * (frame - 1) / 12
    return points - amount * points[:, 1:2] * np.array([1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    "resample",
    [
        "off",
        "{max_edge_length: 0.35}",
        "{max_edge_length: 0.35, rest_interval: 4}",
        "{max_edge_length: 0.35, placement: chord}",
        "{max_edge_length: 0.35, placement: curved}",
        pytest.param("{max_edge_length: 0.5, method: polyhedra}", marks=needs_plugins("polyhedra")),
    ],
)
def test_vertices_know_where_they_were(resample: str) -> None:
    frames = list(animate(shot_of(resample)))
    assert resample == "off" or len(frames[-1].mesh.vertices) > len(frames[0].mesh.vertices)
    for frame in frames:
        away = material_of(frame.mesh) - undone(frame.mesh.vertices, frame.number)
        assert np.linalg.norm(away, axis=1).max() < 0.1  # a third of an edge, of the curve over an edge
        if resample in ("off", "{max_edge_length: 0.35}", "{max_edge_length: 0.35, placement: chord}"):
            assert np.abs(away).max() < 1e-9


def test_a_run_that_goes_on_after_a_renewal_knows_the_same() -> None:
    shot = shot_of("{max_edge_length: 0.35, rest_interval: 4}")
    frames = list(animate(shot))
    kept = MeshFrame.from_arrays(frames[6].to_arrays(), frames[6].number)
    again = list(animate(shot, resume=kept))[-1]
    assert np.array_equal(material_of(again.mesh), material_of(frames[-1].mesh))


def test_what_vertices_have_is_spread_linearly_over_the_pieces_of_their_faces() -> None:
    for mesh in (box(2.0, 1.0), icosphere(3)):
        values = mesh.vertices @ np.array([[1.0, 2.0], [0.5, -1.0], [3.0, 0.0]])
        shaded = split_at_creases(mesh)
        for pieces in (1, 2, 3, 5):
            fine = tessellate(shaded, pieces)
            found = spread(values, shaded, fine)
            assert found[: len(shaded.vertices)] == pytest.approx(values[shaded.source_vertex])
            if mesh.creases is not None and len(mesh.vertices) == 26:  # flat sides stay flat
                assert found == pytest.approx(fine.vertices @ [[1.0, 2.0], [0.5, -1.0], [3.0, 0.0]])
            corners = found[fine.faces].reshape(len(shaded.faces), -1, 2)
            middles = values[shaded.source_vertex[shaded.faces]].mean(axis=1)
            assert corners.mean(axis=1) == pytest.approx(middles)


def wound(points: np.ndarray) -> np.ndarray:
    """Return the places on a sphere before a twist of 3 radians a unit: a known smooth map."""
    points = points / np.linalg.norm(points, axis=1, keepdims=True)
    sine, cosine = np.sin(3.0 * points[:, 1]), np.cos(3.0 * points[:, 1])
    x, y, z = points.T
    return np.stack([x * cosine - z * sine, y, x * sine + z * cosine], axis=1)


def test_smooth_values_follow_curves_between_vertices_eight_times_as_close() -> None:
    mesh = icosphere(6)
    shaded = split_at_creases(mesh)
    at_vertices = wound(shaded.vertices)
    for pieces in (1, 2, 5):
        fine = tessellate(shaded, pieces)
        straight = spread(at_vertices, shaded._replace(source_vertex=np.arange(len(at_vertices))), fine)
        curved = spread_curved(at_vertices, shaded, fine)
        assert curved[: len(at_vertices)] == pytest.approx(at_vertices, abs=1e-12)
        off, before = (np.abs(found - wound(fine.vertices)).mean() for found in (curved, straight))
        assert pieces == 1 or off < before / 7.0


def test_values_that_are_linear_on_flat_sides_stay_so_on_curves() -> None:
    shaded = split_at_creases(box(2.0, 0.5))
    linear = np.array([[1.0, 2.0, 0.0], [0.5, -1.0, 1.0], [3.0, 0.0, 1.0]])
    fine = tessellate(shaded, 3)
    assert spread_curved(shaded.vertices @ linear, shaded, fine) == pytest.approx(
        fine.vertices @ linear, abs=1e-9
    )


def test_a_mesh_from_elsewhere_is_told() -> None:
    with pytest.raises(UsageError, match="not from a frame of a shot"):
        material_of(icosphere(2))
