"""Nets of a sheet, a tube and a torus: sound, of the size that they say, and facing outwards."""

from __future__ import annotations

import numpy as np
import pytest

from flowsculpt.pipeline.mesh import TriangleMesh, validate
from flowsculpt.pipeline.mesh.control_net import bspline_surface
from flowsculpt.pipeline.plugins.points.nets import Net, sheet_net, torus_net, tube_net


@pytest.mark.parametrize(
    ("net", "euler", "open_edges"),
    [
        (sheet_net((2.0, 3.0), 6, 5), 1, True),
        (tube_net(3.0, 0.5, 6, 8), 0, True),
        (torus_net(1.0, 0.4, 8, 12), 0, False),
    ],
)
def test_nets_and_their_surfaces_are_sound_and_close_where_they_say_so(
    net: Net, euler: int, open_edges: bool
) -> None:
    points, lattice = net
    surface = bspline_surface(points, lattice, 4)
    for mesh in (TriangleMesh(points, lattice.faces()), TriangleMesh(surface.vertices, surface.faces)):
        found = validate(mesh)
        assert found.problem is None
        assert found.euler == euler
        assert (found.boundary_edges > 0) == open_edges


def test_the_net_of_a_sheet_is_the_sheet_and_faces_up() -> None:
    surface = bspline_surface(*sheet_net((2.0, 3.0), 6, 5), 4)
    assert np.abs(surface.vertices[:, 1]).max() == 0
    assert np.ptp(surface.vertices, axis=0) == pytest.approx([2, 0, 3])
    assert surface.normals == pytest.approx(np.tile((0.0, 1.0, 0.0), (len(surface.normals), 1)))


def test_the_net_of_a_tube_has_its_radius_and_faces_outwards() -> None:
    surface = bspline_surface(*tube_net(3.0, 0.5, 8, 12), 4)
    away = np.hypot(surface.vertices[:, 0], surface.vertices[:, 2])
    assert away == pytest.approx(0.5, rel=2e-3)
    assert np.ptp(surface.vertices[:, 1]) == pytest.approx(3)
    outwards = (surface.vertices * (1, 0, 1) * surface.normals).sum(axis=1)
    assert outwards.min() > 0.49


def test_the_net_of_a_torus_has_its_radii_and_faces_outwards() -> None:
    surface = bspline_surface(*torus_net(1.0, 0.4, 12, 24), 4)
    across = surface.vertices * (1, 0, 1)
    middle = across / np.linalg.norm(across, axis=1, keepdims=True)
    away = surface.vertices - middle
    assert np.linalg.norm(away, axis=1) == pytest.approx(0.4, rel=5e-3)
    assert (away * surface.normals).sum(axis=1).min() > 0.39
