"""The person for scale: closed, smooth, symmetrical and as tall as it says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.plugins.people.person import person, surface_net
from flowsculpt.pipeline.shot import Shot, read_shot

SHOT = """\
title: A crowd
frames: 1-2
subject: {people.person: POSE}
resample: {max_edge_length: 0.1}
"""


def shot(pose: str) -> Shot:
    return read_shot(Path("a.yaml"), SHOT.replace("POSE", pose))


@pytest.mark.parametrize("pose", ["standing", "walking"])
def test_a_person_is_one_closed_and_smooth_surface(pose: str) -> None:
    mesh = person(pose)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.is_watertight and solid.is_winding_consistent and solid.euler_number == 2
    assert 0.011 < solid.volume < 0.016  # 70 kg at 1.75 m are 0.013 of its cube
    sharp = solid.face_adjacency_angles > np.radians(40.0)
    assert sharp.mean() < 0.003  # in the armpits and between the legs
    assert np.ptp(mesh.vertices[:, 1]) == pytest.approx(1.0) and mesh.vertices[:, 1].min() == 0.0


def test_a_standing_person_is_the_same_on_both_sides() -> None:
    vertices = person("standing").vertices
    for side in (1.0, -1.0):
        assert (side * vertices[:, 0]).max() == pytest.approx(0.185, abs=0.01)
    assert vertices[:, 0].mean() == pytest.approx(0.0, abs=0.002)
    assert vertices[vertices[:, 1] < 0.02, 2].mean() > 0.02, "toes are in front"


@pytest.mark.parametrize(
    ("settings", "height"), [("standing", 1.75), ("{height: 0.28, pose: walking}", 0.28)]
)
def test_a_person_is_as_tall_as_the_shot_says(settings: str, height: float) -> None:
    vertices = shot(settings).motion.subject.build().vertices
    assert np.ptp(vertices[:, 1]) == pytest.approx(height)


@pytest.mark.parametrize(
    ("settings", "message"),
    [("{height: 0}", "height: 0 is out of range"), ("{pose: dancing}", "pose"), ("{tall: 2}", "tall")],
)
def test_other_settings_are_refused(settings: str, message: str) -> None:
    with pytest.raises(ShotError, match=message):
        shot(settings)


def test_a_net_of_a_field_with_thin_gaps_is_a_manifold() -> None:
    """Balls that nearly touch: where cells have corners of two of them, faces would meet in fours."""
    middles = np.random.default_rng(2).uniform(-0.5, 0.5, (14, 3))

    def field(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points[:, None] - middles, axis=2).min(axis=1) - 0.17

    points, faces = surface_net(field, np.full(3, -0.8), np.full(3, 0.8), 0.06)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]))
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert np.isfinite(points).all()
