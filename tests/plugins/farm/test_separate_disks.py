"""Workers that share no disk: each has the plan, an empty root, and the remote store."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import MachineError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.plugins.farm import task_runner as tasks
from flowsculpt.pipeline.plugins.remote import remote_files, remote_requests
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.store.remote_store import VARIABLE
from flowsculpt.pipeline.production.store.store import Store

NAME = "T010_tiny"
QUALITY = "draft.scale10"


def do_task(plan: Path, root: Path, store: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Do a task in a root of its own, from a folder without shots."""
    command = [sys.executable, "-m", "flowsculpt", "--no-progress", "--store", store, "--root", str(root)]
    return subprocess.run(
        [*command, "task", str(plan), *words], cwd=plan.parent, capture_output=True, text=True, timeout=300
    )


def test_workers_with_empty_roots_render_a_shot_by_its_plan_and_the_store_alone(
    project, store, tmp_path, monkeypatch
):
    monkeypatch.chdir(project.path)
    plan = tmp_path / "far" / "plan.json"
    plan.parent.mkdir()
    Project(project.path, 1).whole([NAME], QUALITY, FrameRange.parse("1")).write(plan)
    surfaces = ("simulate", "smooth_normals", "frame_camera")
    for root, words in (("one", surfaces), ("two", ("render:1", "finish", "assemble"))):
        done = do_task(plan, plan.parent / root, store, *words)
        assert done.returncode == 0, done.stderr
    assert not list((plan.parent / "one").rglob("*.exr"))
    monkeypatch.setenv(VARIABLE, store)
    here = Project(project.path, 1)
    left = here.pictures([NAME], QUALITY, FrameRange.parse("1"))
    assert left.jobs == () and len(left.remote_names(here.store)) >= 2  # the frame and its movie


def test_a_task_whose_files_the_store_does_not_take_fails_until_it_does(tmp_path, monkeypatch):
    share = tmp_path / "share"
    monkeypatch.setenv(VARIABLE, f"file://{share}")
    monkeypatch.setattr(remote_requests, "PATIENCE", 0.1)
    Store(tmp_path).put("cameras", "ab" * 32, lambda path: path.write_text("{}"))
    with pytest.raises(MachineError, match="it did not accept 1 file, which other workers would miss"):
        tasks._upload_rest(tmp_path)
    share.mkdir()
    remote_files._opened.cache_clear()
    tasks._upload_rest(tmp_path)
    assert [path.suffix for path in share.rglob("*") if path.is_file()] == [".json"]
