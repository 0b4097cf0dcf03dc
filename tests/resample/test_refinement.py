"""A surface that is refined for many frames: splits alone, which can be replayed."""

from __future__ import annotations

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.errors import FrameError, VertexBudgetError
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere
from flowsculpt.pipeline.resample import Thresholds
from flowsculpt.pipeline.resample.refinement import RefinableSurface

LONGEST = 0.3


def stretched(points: Points) -> Points:
    return points * (3.0, 1.0, 1.0)


def refined(thresholds: Thresholds | None) -> tuple[RefinableSurface, Points, Points]:
    surface = RefinableSurface(icosphere(4))
    surface.points[:] = stretched(surface.points)
    births = surface.split(thresholds, stretched, None)
    return surface, births.parents, births.rest


def test_edges_that_the_flow_stretches_are_split_and_no_vertex_is_lost() -> None:
    surface, parents, _ = refined(Thresholds(LONGEST, 0.0))
    mesh = surface.mesh()
    corners = mesh.vertices[mesh.faces]
    assert np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max() <= LONGEST
    assert len(mesh.vertices) == 162 + len(parents) and (parents < len(mesh.vertices)).all()


def test_births_replayed_at_rest_give_the_same_triangles() -> None:
    surface, parents, rest = refined(Thresholds(LONGEST, 0.0))
    again = RefinableSurface(icosphere(4))
    opposite = again.replay(parents, rest)
    assert np.array_equal(again.mesh().faces, surface.mesh().faces) and (opposite >= 0).all()
    assert np.allclose(stretched(again.points), surface.points, atol=1e-12)


@pytest.mark.parametrize("parents", [(0, 1), (1, 0)])
def test_an_edge_of_the_boundary_is_split_whichever_of_its_ends_comes_first(parents: tuple[int, int]) -> None:
    surface = RefinableSurface(TriangleMesh(np.eye(3), np.array([[0, 1, 2]], np.int32)))
    opposite = surface.replay(np.array([parents], np.int32), np.full((1, 6), 0.5))
    left, right = (2, -1) if parents == (0, 1) else (-1, 2)
    assert opposite.tolist() == [[left, right]] and len(surface.mesh().faces) == 2


def test_nothing_is_split_without_thresholds() -> None:
    surface, parents, rest = refined(None)
    assert (len(parents), len(rest), len(surface.points)) == (0, 0, 162)


def test_parents_that_share_no_edge_are_refused() -> None:
    surface = RefinableSurface(icosphere(2))
    opposite = int(np.argmin(surface.points @ surface.points[0]))
    with pytest.raises(FrameError, match=f"birth 0 splits 0-{opposite}, but .* has no such edge"):
        surface.replay(np.array([[0, opposite]], np.int32), np.zeros((1, 6)))


def test_a_torn_surface_is_told_from_one_that_needs_many_vertices() -> None:
    def torn(points: Points) -> Points:
        return points + np.where(points[:, :1] > 0.0, 10.0, 0.0)

    surface = RefinableSurface(icosphere(2))
    surface.points[:] = torn(surface.points)
    with pytest.raises(FrameError, match="the flow tears the surface at"):
        surface.split(Thresholds(LONGEST, 0.0, max_vertices=5000), torn, None)
    with pytest.raises(VertexBudgetError):
        refined(Thresholds(LONGEST, 0.0, max_vertices=200))
