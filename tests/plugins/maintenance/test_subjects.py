"""Stored files of shots with several subjects."""

from __future__ import annotations

from pathlib import Path

from flowsculpt.pipeline.plugins.maintenance.clean import collect_garbage
from flowsculpt.pipeline.plugins.maintenance.store_repair import Evicted, repairs
from flowsculpt.pipeline.production.execution.project import Project
from tests.conftest import done

SHOT = """\
title: Two
frames: 1-3
subjects:
  crane: {solid: box, size: [0.6, 0.6, 0.6], place: [-0.8, 0, 0]}
  heron: {solid: icosphere, radius: 0.4, place: [0.8, 0, 0]}
resample: {max_edge_length: 0.5}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 3: 40}}}
"""


def test_meshes_of_each_subject_are_kept_by_cleaning_and_made_again_after_damage(tmp_path: Path) -> None:
    shot = tmp_path / "shots" / "T010_two.yaml"
    shot.parent.mkdir()
    shot.write_text(SHOT)
    project = Project(tmp_path, 2)
    done(tmp_path, project.meshes([str(shot)]))
    request, store = project.request(shot, "draft"), project.store
    heron = request.parts[1]
    shown, key = tmp_path / heron.place("mesh", 2), heron.keys.mesh(2)
    shown.unlink()
    removed = collect_garbage(store, [request], keep=1, dry_run=True).removed
    assert store.path("mesh", key) not in removed
    store.discard("mesh", key)
    lost = Evicted(frozenset({("mesh", key)}), (heron.place("mesh", 2),), ())
    plan = repairs(project, [request], (), lost)
    assert [(job.stage, job.frames) for job in plan.jobs] == [("simulate", (2,))]
    done(tmp_path, plan)
    assert shown.exists()
