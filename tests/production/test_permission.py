"""The permission to run a shot's Python files reaches every job, and nothing runs without it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.animation import animate
from pipeline.errors import UsageError
from pipeline.production.plan import Plan
from pipeline.production.take import Take
from pipeline.production.workflow import Studio

SHOT = (
    "title: T\nframes: 1-3\nsubject: {solid: icosphere}\nresample: off\n"
    "flows:\n  - python: {file: mine.py, function: lift}\n"
)


@pytest.fixture
def shot(tmp_path: Path) -> str:
    (tmp_path / "a.yaml").write_text(SHOT)
    (tmp_path / "mine.py").write_text("def lift(points, time, dt):\n    return points + [0, dt, 0]\n")
    return str(tmp_path / "a.yaml")


def test_without_permission_nothing_is_planned(shot: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"mine\.py: the shot would run this Python file.*--allow-code"):
        Studio(tmp_path, 1).meshes([shot])


def test_the_permission_is_in_the_frozen_plan_and_changes_no_key(shot: str, tmp_path: Path) -> None:
    plan = Studio(tmp_path, 1, allow_code=True).meshes([shot])
    thawed = Plan.thaw(tmp_path / plan.freeze(tmp_path))
    (take,) = (Take.from_data(data) for data in json.loads(json.dumps(thawed.takes)))
    frames = list(animate(take.shot))
    lifted = frames[-1].mesh.vertices - frames[0].mesh.vertices
    np.testing.assert_allclose(lifted, np.tile([0.0, 2 / 24, 0.0], (len(lifted), 1)), atol=1e-12)
    forbidden = Studio(tmp_path, 1).take(Path(shot), "draft", variant="none")
    assert [forbidden.mesh_key(n) for n in (1, 2, 3)] == [take.mesh_key(n) for n in (1, 2, 3)]
