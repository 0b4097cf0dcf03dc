"""The permission to run a shot's Python files reaches every job, and nothing runs without it; jobs read the
files that the work was planned for."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.execution.snakefile import PlannedWorkflow
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.store.readers import read_npz
from flowsculpt.pipeline.production.tasks import worker
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.render.base.serialise import from_plain, to_plain
from tests.production.snakemake import snakemake, workflow

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
        Project(tmp_path, 1).meshes([shot])


def test_the_permission_is_in_the_frozen_plan_and_changes_no_key(shot: str, tmp_path: Path) -> None:
    plan = Project(tmp_path, 1, allow_code=True).meshes([shot])
    thawed = Plan.thaw(tmp_path / plan.freeze(tmp_path))
    (request,) = thawed.requests
    frames = list(animate(request.shot))
    lifted = frames[-1].mesh.vertices - frames[0].mesh.vertices
    np.testing.assert_allclose(lifted, np.tile([0.0, 2 / 24, 0.0], (len(lifted), 1)), atol=1e-12)
    forbidden = Project(tmp_path, 1).request(Path(shot), "draft", variant="none")
    assert [forbidden.keys.mesh(n) for n in (1, 2, 3)] == [request.keys.mesh(n) for n in (1, 2, 3)]


def test_a_shot_that_no_file_can_be_called_is_told_in_one_short_line() -> None:
    for name in ("n" * 5000, "n" * 5000 + ".yaml"):
        with pytest.raises(UsageError, match="cannot name a shot") as told:
            Show().find_shot(name)
        assert len(str(told.value)) < 400


def job_of(plan: Plan, root: Path) -> subprocess.CompletedProcess[str]:
    """The first job of a plan in a process of its own, as a run starts it."""
    frozen = plan.freeze(root)
    command = [
        sys.executable,
        "-m",
        "flowsculpt.pipeline.production.tasks.worker",
        str(frozen),
        plan.jobs[0].name,
    ]
    return subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)


def test_a_job_has_the_permission(shot: str, tmp_path: Path) -> None:
    plan = Project(tmp_path, 1, allow_code=True).meshes([shot])
    done = job_of(plan, tmp_path)
    assert done.returncode == 0, done.stderr
    first, last = (read_npz(tmp_path / plan.targets[k])["vertices"] for k in (0, -1))
    np.testing.assert_allclose(last - first, np.tile([0.0, 2 / 24, 0.0], (len(first), 1)), atol=1e-7)


def test_a_job_without_the_permission_runs_nothing(shot: str, tmp_path: Path) -> None:
    plan = Project(tmp_path, 1, allow_code=True).meshes([shot])
    (request,) = plan.requests
    forbidden = replace(plan, requests=(replace(request, source=replace(request.source, allow_code=False)),))
    done = job_of(forbidden, tmp_path)
    assert done.returncode == 1 and "that needs permission" in done.stderr, done.stderr
    assert not (tmp_path / plan.targets[-1]).exists()


FLOWS = {
    "mine.py": "python: {file: mine.py, function: lift}",
    "w_1.npz": "sampled: {file: 'w_*.npz'}",
    "t.obj": "attraction: {mesh: t.obj}",
    "s.obj": "within: {region: {mesh: s.obj, falloff: 0.2}, flows: [rotation: {speed: 9}]}",
    "bunny.obj": "",
}


@pytest.mark.parametrize("changed", FLOWS)
def test_a_file_that_was_changed_since_is_told_by_the_job(
    changed: str,
    shot: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(worker, "_limit_kernels", lambda threads: None)
    triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    (tmp_path / "t.obj").write_text(triangle)
    (tmp_path / "bunny.obj").write_text(triangle)
    solid = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    (tmp_path / "s.obj").write_text(solid)
    axis = np.linspace(-1, 1, 3)
    np.savez(tmp_path / "w_1.npz", x=axis, y=axis, z=axis, velocity=np.ones((3, 3, 3, 3)))
    head = SHOT.partition("flows")[0].replace("solid: icosphere", "model: bunny.obj")
    Path(shot).write_text(head + "flows:\n" + "".join(f"  - {flow}\n" for flow in FLOWS.values() if flow))
    plan = Project(tmp_path, 1, allow_code=True).meshes([shot])
    before = (tmp_path / changed).read_bytes()
    (tmp_path / changed).write_bytes(before + b"\n")
    thawed = Plan.thaw(tmp_path / plan.freeze(tmp_path))
    assert worker.work(Context.of(tmp_path, thawed, plan.jobs[0].name)) == 1
    assert not (tmp_path / plan.targets[0]).exists()
    wanted = f"{tmp_path / changed}: it was changed since the work was planned; run again"
    assert capsys.readouterr().err.strip() == wanted
    (tmp_path / changed).write_bytes(before)
    (request,) = Plan.thaw(tmp_path / plan.freeze(tmp_path)).requests
    assert request.shot.name == "a"


def test_a_file_that_joins_a_sequence_is_told_too(shot: str, tmp_path: Path) -> None:
    axis = np.linspace(-1, 1, 3)
    save = lambda name: np.savez(tmp_path / name, x=axis, y=axis, z=axis, velocity=np.ones((3, 3, 3, 3)))  # noqa: E731
    save("w_1.npz")
    Path(shot).write_text(SHOT.partition("  - ")[0] + "  - sampled: {file: 'w_*.npz'}\n")
    request = Project(tmp_path, 1).request(Path(shot), "draft", variant="none")
    save("w_2.npz")
    with pytest.raises(UsageError, match=r"w_2\.npz: it was changed since the work was planned; run again"):
        from_plain(RenderRequest, json.loads(json.dumps(to_plain(request)))).shot  # noqa: B018


def plain_snakemake(folder: Path, *config: str) -> subprocess.CompletedProcess[str]:
    """Simulate a shot by plain Snakemake, as its users call it."""
    return snakemake(
        folder, "--until", "simulate", "--config", "shot=P010", "quality=draft", *config, cores=1
    )


def test_plain_snakemake_runs_code_with_permission_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "shots").mkdir()
    (tmp_path / "shots/P010.yaml").write_text(SHOT)
    (tmp_path / "shots/mine.py").write_text("def lift(points, time, dt):\n    return points + [0, dt, 0]\n")
    refused = plain_snakemake(tmp_path)
    assert refused.returncode == 1 and "mine.py: the shot would run this Python file" in refused.stdout
    assert "Traceback" not in refused.stdout and "/pipeline/" not in refused.stdout, refused.stdout
    monkeypatch.chdir(tmp_path)
    for allowed, says in (
        (False, "(for snakemake, --config allow_code=true)"),
        (1, "allow_code is 1; it says whether shots may run their Python files. Write true or"),
    ):
        with pytest.raises(SystemExit) as told:
            PlannedWorkflow(workflow(), {"shot": "P010", "quality": "draft", "allow_code": allowed}).plan  # noqa: B018
        assert says in str(told.value)
    done = plain_snakemake(tmp_path, "allow_code=true")
    assert done.returncode == 0, done.stdout
    first, last = (read_npz(tmp_path / f"renders/P010/meshes/P010.000{n}.npz")["vertices"] for n in (1, 3))
    np.testing.assert_allclose(last - first, np.tile([0.0, 2 / 24, 0.0], (len(first), 1)), atol=1e-7)
