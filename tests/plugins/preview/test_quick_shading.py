"""A frame that is performed looks as it does when it is simulated again."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.animation import MeshFrame
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere
from flowsculpt.pipeline.mesh.solids import box
from flowsculpt.pipeline.plugins.preview import quick_shading as shading
from flowsculpt.pipeline.production.request.shading import Shading
from flowsculpt.pipeline.resample import Thresholds

MOST_DEGREES = 0.01


def both(mesh: TriangleMesh, hard_angle: float = np.radians(40), pieces: int = 1) -> list[dict[str, Any]]:
    """Return the quick arrays of a mesh, and those of a render."""
    frame, thresholds = MeshFrame.at_rest(3, mesh), Thresholds(1.0, hard_angle=hard_angle)
    motion: Any = SimpleNamespace(thresholds_at=lambda number: thresholds)
    quick = shading.quick_shading(frame, motion, pieces)
    return [quick, Shading.of(frame, thresholds, pieces).arrays()]


def require_same(quick: dict[str, Any], whole: dict[str, Any]) -> None:
    assert quick.keys() == whole.keys()
    for name, values in whole.items():
        assert quick[name].dtype == values.dtype and quick[name].shape == values.shape, name
        if name != "normals":
            assert np.array_equal(quick[name], values), name
    apart = np.linalg.norm(quick["normals"].astype(float) - whole["normals"], axis=1)
    assert np.degrees(apart.max()) <= MOST_DEGREES


@given(
    seed=st.integers(0, 1000),
    noise=st.floats(0.0, 0.3),
    stretch=st.floats(0.05, 20.0),
    hard_angle=st.floats(0.1, 3.1),
    pieces=st.sampled_from((1, 2)),
)
def test_a_surface_is_shaded_as_in_a_render_however_its_faces_turn(
    seed: int, noise: float, stretch: float, hard_angle: float, pieces: int
) -> None:
    ball = icosphere(4)
    points = ball.vertices + noise * np.random.default_rng(seed).normal(size=ball.vertices.shape)
    require_same(*both(ball.with_vertices(points * (1.0, stretch, 1.0)), hard_angle, pieces))


def test_sides_of_a_box_stay_apart_at_its_edges() -> None:
    quick, whole = both(box((1.0, 2.0, 3.0)))
    require_same(quick, whole)
    assert len(quick["vertices"]) > len(box((1.0, 2.0, 3.0)).vertices)


def test_a_surface_that_has_only_tagged_creases_shows_them() -> None:
    ball = icosphere(3)
    ring = ball.faces[:40, :2]
    quick, whole = both(ball.with_creases(ring))
    require_same(quick, whole)
    assert len(quick["vertices"]) > len(ball.vertices)


def test_of_a_smooth_surface_no_neighbours_are_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shading, "Shading", None)
    motion: Any = SimpleNamespace(thresholds_at=lambda number: Thresholds(1.0))
    ball = icosphere(3)
    assert len(shading.quick_shading(MeshFrame.at_rest(1, ball), motion, 1)["normals"]) == len(ball.vertices)
