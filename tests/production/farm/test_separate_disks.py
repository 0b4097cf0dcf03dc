"""Workers that share no disk: each has the plan, an empty root, and the remote store."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.production.store.s3 import BUCKET

NAME = "T010_tiny"
QUALITY = "draft.scale10"


def task(plan: Path, root: Path, store: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Do a task in a root of its own, from a folder without shots."""
    command = [sys.executable, "-m", "pipeline.cli", "--no-progress", "--store", store, "--root", str(root)]
    return subprocess.run(
        [*command, "task", str(plan), *words], cwd=plan.parent, capture_output=True, text=True, timeout=300
    )


def test_workers_with_empty_roots_render_a_shot_by_its_plan_and_the_store_alone(project, store, tmp_path):
    frames = ("-f", "1-2", "-q", QUALITY)
    far = tmp_path / "far"
    far.mkdir()
    assert project.run("export", "plan", NAME, *frames, "-o", str(far / "plan.json")).code == 0
    surfaces = ("simulate", "smooth_normals", "frame_camera")
    for root, words in (("one", (*surfaces, "render:1")), ("two", ("render:2", "finish", "assemble"))):
        done = task(far / "plan.json", far / root, store, *words)
        assert done.returncode == 0, done.stderr
    assert len(list((far / "one").rglob("raw/*.exr"))) == 1
    left = project.run("--dry-run", "render", NAME, *frames, "--store", store)
    assert "Nothing to be done" in left.out and "would be fetched" in left.out


def test_a_task_whose_frames_the_store_does_not_take_fails(project, store, tmp_path):
    assert project.run("export", "plan", NAME, "-q", QUALITY, "-o", "plan.json").code == 0
    gone = store.replace(BUCKET, "no-such-bucket")
    done = task(project.path / "plan.json", tmp_path / "root", gone, "simulate")
    assert done.returncode == 4
    assert "it did not take 6 files, which other workers would miss" in done.stderr
