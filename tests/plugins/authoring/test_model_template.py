"""New shots of models."""

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.plugins.authoring.shot_templates import model_template, shot_of_flow
from flowsculpt.pipeline.shot import read_shot
from tests.mesh_files import write_ply


@pytest.mark.parametrize(
    ("count", "size", "length"), [(2, 1e-3, 0.08), (12, 1.0, 0.08), (12, 1e4, 0.08), (60, 1.0, 0.039)]
)
def test_new_shots_of_models_have_edges_for_their_detail(
    tmp_path: Path, count: int, size: float, length: float
) -> None:
    """Coarse models are refined, others keep their edges, and very fine ones are simplified for a preview."""
    ball = icosphere(count)
    write_ply(ball.with_vertices(size * ball.vertices + 1e5 * (size == 1)), tmp_path / "a.ply")
    template = model_template(tmp_path / "a.ply", "a.ply")
    assert template.max_edge_length == pytest.approx(length, rel=0.2)
    assert ("keeps all their detail" in template.edges) == (count == 60)
    (tmp_path / "n.yaml").write_text(shot_of_flow("twist", "n", template))
    first = next(animate(read_shot(tmp_path / "n.yaml")))
    assert 300 < len(first.mesh.vertices) < 40_000
    assert np.ptp(first.mesh.vertices, axis=0) == pytest.approx([2, 2, 2], rel=0.02)
