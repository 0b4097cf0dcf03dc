"""Vertices, normals and creases that come from the surface at rest."""

from __future__ import annotations

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.shot import Motion
from tests.animation.motions import resampled


def carried_to(motion: Motion, number: int, rest: Points, since: int = 5) -> Points:
    """Move rest points of frame `since` to a frame by the flow alone."""
    for frame in range(since + 1, number + 1):
        rest = motion.flow.displace(rest, *motion.clock.step(frame))
    return rest


def test_vertices_lie_where_the_flow_takes_their_points_at_rest(motion: Motion) -> None:
    """Exact placement: but for the few that would have folded the surface, and stayed on the chord."""
    *_, last = animate(motion)
    exactly = carried_to(motion, 24, last.mesh.attributes["rest"])
    off = np.linalg.norm(exactly - last.mesh.vertices, axis=1)
    assert np.mean(off < 1e-12) > 0.99
    np.testing.assert_allclose(np.abs(last.mesh.attributes["rest"]).max(axis=1), 1.0, atol=1e-12)


def test_normals_go_with_the_flow_and_end_at_creases(motion: Motion) -> None:
    """Compared with cof(J) n of the whole way from the cube's sides, J by central differences."""
    *_, last = animate(motion)
    rest, normals = last.mesh.attributes["rest"], last.mesh.attributes["normal"]
    known = normals.any(axis=1)
    outermost = np.abs(rest) > 1 - 1e-9
    assert np.array_equal(known, outermost.sum(axis=1) == 1)
    points, sides = rest[known], np.sign(rest[known]) * outermost[known]
    columns = []
    for axis in np.eye(3):
        ahead, behind = (carried_to(motion, 24, points + h * axis) for h in (1e-5, -1e-5))
        columns.append((ahead - behind) / 2e-5)
    exact = np.linalg.inv(np.stack(columns, axis=1)) @ sides[:, :, None]
    exact = exact[:, :, 0] / np.linalg.norm(exact[:, :, 0], axis=1, keepdims=True)
    assert np.linalg.norm(np.cross(exact, normals[known]), axis=1).max() < 1e-5
    assert np.einsum("ij,ij->i", exact, normals[known]).min() > 0


def test_the_surface_at_rest_is_renewed_every_so_many_frames(motion: Motion) -> None:
    for frame in animate(resampled(motion, rest_interval=6)):
        since = 5 + (frame.number - 5) // 6 * 6
        rest = frame.mesh.attributes["rest"]
        if frame.number == since:
            assert frame.number == 5 or np.array_equal(rest, frame.mesh.vertices)
        exactly = carried_to(motion, frame.number, rest, since)
        off = np.linalg.norm(exactly - frame.mesh.vertices, axis=1)
        assert np.mean(off < 1e-12) > 0.99


def test_geometric_normals_are_not_kept(motion: Motion) -> None:
    *_, last = animate(resampled(motion, normals="geometric"))
    assert "normal" not in last.mesh.attributes
    *_, last = animate(resampled(motion, placement="curved"))
    assert set(last.mesh.attributes) == {"identity", "material"}


def test_the_creases_at_rest_stay_creases(motion: Motion) -> None:
    """P31: the twelve edges of the cube, by the fields of their vertices at rest."""
    *_, last = animate(motion)
    ends = np.abs(last.mesh.attributes["rest"])[last.mesh.creases]
    assert ((ends > 1 - 1e-9).all(axis=1).sum(axis=1) >= 2).all()
    length = np.linalg.norm(np.diff(last.mesh.attributes["rest"][last.mesh.creases], axis=1), axis=2).sum()
    assert length == pytest.approx(24.0)
    *_, last = animate(resampled(motion, placement="curved", creases="none"))
    assert not len(last.mesh.creases)
