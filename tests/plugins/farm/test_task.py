"""Tasks of a render manager: parts of a frozen plan, in any order and side by side, without a lock."""

import json
import platform
import subprocess
import sys
from contextlib import chdir
from dataclasses import replace
from importlib.metadata import version

import pytest

from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.render.mitsuba.engine import works
from tests.conftest import ProjectFolder, commanded

NAME = "T010_tiny"
QUALITY = "draft.scale10"


@pytest.fixture
def plan(project):
    done = project.call("--json", "export", "plan", NAME, "-f", "1-4", "-q", QUALITY, "-o", "job/plan.json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["tasks"]["render"] == [1, 2, 3, 4]
    return "job/plan.json"


def test_tasks_side_by_side_make_the_frames_of_a_shot_and_its_movie(project, plan):
    assert project.run("task", plan, "simulate", "smooth_normals", "frame_camera").code == 0
    command = [sys.executable, "-m", "flowsculpt", "task", plan]
    renders = [subprocess.Popen([*command, f"render:{part}"], cwd=project.path) for part in ("1-2", "3,4")]
    assert [render.wait(300) for render in renders] == [0, 0]
    assert project.run("task", plan, "finish", "assemble").code == 0
    made = project.path / "renders" / NAME / QUALITY
    assert len([*(made / "frames").iterdir()]) == 4
    left = project.call("--dry-run", "render", NAME, "-f", "1-4", "-q", QUALITY)
    assert "Nothing to be done" in left.out


def test_a_worker_without_the_variant_of_the_plan_ends_with_the_environments_exit_code(project):
    words = ("-f", "1-2", "-q", QUALITY, "--variant", "cuda_ad_rgb", "-o", "plan.json")
    written = project.call("export", "plan", NAME, *words)
    assert written.code == 0 and written.err == ""  # the machine that plans needs no GPU
    if works("cuda_ad_rgb"):
        pytest.skip("this machine has a GPU")
    done = project.run("task", "plan.json", "render:1-2")
    assert done.code == 4 and done.err.count("\n") == 1
    assert f"{platform.node()} cannot render with cuda_ad_rgb, the variant of this plan" in done.err


def test_a_worker_with_other_packages_is_refused_before_it_makes_what_counts_as_missing(project, monkeypatch):
    monkeypatch.chdir(project.path)
    plan = Project(project.path, 1).whole([NAME], QUALITY)
    assert plan.versions["numba"] == version("numba")
    replace(plan, versions={**plan.versions, "numba": "0.1"}).write(project.path / "plan.json")
    code, said = commanded(project.path, "task", "plan.json", "simulate")
    assert code == 4 and f"has numba {version('numba')} (planned with 0.1)" in said
    assert not (project.path / "renders").exists()


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (("job/plan.json", "rendr:1"), 2, "has no stage 'rendr'. Did you mean 'render'?"),
        (("job/plan.json", "render:3-9"), 2, "frames 5-9 are not in plan.json, which has 1-4"),
        (("job/other.json", "render:1"), 3, "this worker does not see the plan"),
        ((f"shots/{NAME}.yaml", "render"), 2, "not a plan"),
        (("--root", "nowhere", "job/plan.json", "simulate"), 3, "this worker does not see the root"),
    ],
)
def test_a_task_that_cannot_be_done_is_told_in_one_line(project, plan, words, code, told):
    done = project.call("task", *words)
    assert done.code == code and told in done.err and done.err.count("\n") == 1


@pytest.mark.parametrize("name", ["../../x", "/tmp/x"])
def test_a_plan_that_leads_out_of_the_root_is_none(project: ProjectFolder, name: str) -> None:
    with chdir(project.path):
        plan = replace(Project(project.path, 1).pictures([NAME], QUALITY, FrameRange.parse("1")), name=name)
    file = project.path / "plan.json"
    plan.write(file)
    told = project.call("task", str(file), "simulate")
    assert told.code == 2 and "plan.json: not a plan" in told.err, told.out + told.err
