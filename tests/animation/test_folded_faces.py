"""Faces that would look against their carried normals, in flows that ask the resampler to avoid them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.animation.simulated_surfaces import at_rest
from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.flow import Flow
from flowsculpt.pipeline.mesh import TriangleMesh, validate
from flowsculpt.pipeline.resample.placement import NORMAL, Exact
from flowsculpt.pipeline.shot import Motion, read_shot
from tests.needed_plugins import shot_rows

SHOT = """\
title: A ball
frames: 1-12
subject: {{solid: icosphere}}
resample: {{max_edge_length: {edge}}}
flows: [{flow}]
"""


def ball(edge: float, flow: str = "twist: {amount: 0}") -> Motion:
    return read_shot("a.yaml", SHOT.format(edge=edge, flow=flow)).motion


@dataclass(frozen=True)
class Waves(Flow):
    """Shears by sines of the other coordinates: no two points meet, and creases become sharper than edges."""

    strength: float
    steepness: float
    follows: bool

    def displace(self, points: Points, time: float, dt: float) -> Points:
        points = points.copy()
        for axis in range(3):
            across = points[:, (axis + 1) % 3]
            points[:, axis] += dt * self.strength * np.sin(self.steepness * across + axis)
        return points

    def cache_data(self, time: float, dt: float) -> Any:
        return [self.strength, self.steepness]

    @property
    def faces_follow_normals(self) -> bool:
        return self.follows


def opposed(mesh: TriangleMesh) -> int:
    """Return how many faces look against the mean of their corners' carried normals."""
    a, b, c = (mesh.vertices[corners] for corners in mesh.faces.T)
    normals = mesh.attributes[NORMAL][mesh.faces].sum(axis=1)
    return int((np.sum(np.cross(b - a, c - a) * normals, axis=1) < 0.0).sum())


@pytest.mark.parametrize("edge, strength, steepness", [(0.2, 1.0, 4.0), (0.3, 0.6, 6.0)])
def test_no_face_looks_against_its_normals_where_the_flow_asks_for_it(
    edge: float, strength: float, steepness: float
) -> None:
    some, none = (
        [frame.mesh for frame in animate(ball(edge), flow=Waves(strength, steepness, follows))]
        for follows in (False, True)
    )
    assert sum(map(opposed, some)) > 0, "without asking there are some"
    assert sum(map(opposed, none)) == 0
    assert validate(none[-1]).require(closed=True).euler == 2


def test_where_creases_are_far_sharper_than_edges_a_third_of_such_faces_is_left_at_most() -> None:
    counts = [
        sum(opposed(frame.mesh) for frame in animate(ball(0.2), flow=Waves(1.0, 9.0, follows)))
        for follows in (False, True)
    ]
    assert counts[0] > 100 and 3 * counts[1] < counts[0]


def test_short_edges_that_mending_leaves_have_their_reasons() -> None:
    for frame in animate(ball(0.2), flow=Waves(1.0, 9.0, True)):
        report = frame.report.resampling
        assert report is not None
        assert report.too_short == sum(report.refused.values()) and report.too_long == 0


@pytest.mark.parametrize(
    "flow, follows", shot_rows([("become: {solid: rod}", True), ("twist: {amount: 1}", False)])
)
def test_a_shot_that_becomes_something_asks_for_it_and_others_keep_their_results(
    flow: str, follows: bool
) -> None:
    motion = ball(0.3, flow)
    placement = at_rest(motion, motion.flow)._resampler.placement  # type: ignore[attr-defined]
    assert isinstance(placement, Exact) and placement.faces_follow_normals == follows
