"""A host of a farm gets one try at a frame, and is left out of a stage at three of whose frames it failed."""

from __future__ import annotations

import errno
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pipeline.errors import FrameError, MachineError
from pipeline.production.execution.project import Project
from pipeline.production.execution.snakefile import PlannedWorkflow
from pipeline.production.planning.profile import Profile
from pipeline.production.tasks import worker
from pipeline.production.tasks.job import Context, faults_of_hosts
from render.base.atomic_write import atomic_write
from tests.conftest import QUALITY, ProjectFolder

pytestmark = pytest.mark.quick

NAME = "T010_tiny"


@pytest.fixture
def context(project: ProjectFolder, monkeypatch: pytest.MonkeyPatch) -> Context:
    """A job of a farm that renders, on node7."""
    monkeypatch.chdir(project.path)
    monkeypatch.delenv("SLURMD_NODENAME", raising=False)
    monkeypatch.setattr("platform.node", lambda: "node7")
    farm = Project(project.path, 1, "scalar_rgb", profile=Profile.named("htcondor"), for_farm=True)
    plan = farm.pictures([NAME], QUALITY)
    assert plan.farm
    plan.freeze(project.path)
    return Context.of(project.path, plan, next(job.name for job in plan.jobs if job.stage == "render"))


def fail(context: Context, *frames: int) -> None:
    for number in frames:
        context.fail(MachineError("no memory on the GPU"), number)


def test_a_host_tries_no_frame_twice_and_leaves_it_to_another(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert context.reason_to_leave() is None
    fail(context, 2)
    assert "node7 has failed at frame 2" in str(context.reason_to_leave())
    assert worker.main(str(context.plan.file), context.job.name) == MachineError.exit_code
    assert context.failed_for_good(), "nor does it look at the job again"
    monkeypatch.setattr("platform.node", lambda: "node8")
    assert context.reason_to_leave() is None and not context.failed_for_good()


def test_a_host_that_failed_at_three_frames_of_a_stage_is_left_out_of_it_and_named(context: Context) -> None:
    def refuse(number: int) -> bool:
        raise MachineError("no memory on the GPU")

    fail(context, 101, 102, 102)  # of other jobs, one of them twice
    assert context.reason_to_leave() is None
    assert not context.for_each([103], refuse)
    warnings = [event["message"] for event in context._events("warn") if event["event"] == "warn"]
    assert len(warnings) == 1 and "node7 has failed at 3 frames of render and is left out" in warnings[0]
    assert "left out" in str(context.reason_to_leave())
    finish = next(job.name for job in context.plan.jobs if job.stage == "finish")
    assert Context.of(context.root, context.plan, finish).reason_to_leave() is None


def test_what_a_shot_is_to_blame_for_leaves_no_host_out(context: Context) -> None:
    for number in range(101, 110):
        context.fail(FrameError("a vertex is not finite"), number)
    assert context.reason_to_leave() is None
    assert not faults_of_hosts(context.root, context.plan)


def test_a_full_disk_that_all_hosts_share_leaves_none_out_and_one_of_its_own_does(
    context: Context, tmp_path_factory: pytest.TempPathFactory
) -> None:
    def fill(disk: Path, number: int) -> None:
        with pytest.raises(MachineError) as caught, atomic_write(disk / f"{number}.exr"):
            raise OSError(errno.ENOSPC, "No space left on device")
        context.fail(caught.value, number)

    for number in range(101, 105):
        fill(context.root / "renders", number)
    assert context.reason_to_leave() is None
    assert not context.failed_for_good(), "a retry may find space"
    scratch = tmp_path_factory.mktemp("scratch")
    for number in range(101, 105):
        fill(scratch, number)
    assert "left out" in str(context.reason_to_leave())


def test_the_host_of_the_plan_is_not_left_out_of_what_only_it_does(context: Context) -> None:
    local = next(job.name for job in context.plan.jobs if job.is_local)
    context = Context.of(context.root, context.plan, local)
    fail(context, 1, 2, 3)
    assert context.reason_to_leave() is None
    assert not faults_of_hosts(context.root, context.plan), "so SLURM does not get its name either"


def test_slurm_is_told_which_hosts_not_to_choose(context: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Any] = []

    def submit_command(job: str, **options: Any) -> str:
        given.append(options.get("failed_nodes"))
        return f"sbatch {job}"

    workflow = SimpleNamespace(_root=context.root, plan=context.plan)
    sparing = PlannedWorkflow._sparing_hosts(workflow, submit_command)  # type: ignore[arg-type]
    monkeypatch.setenv("SLURMD_NODENAME", "gpu-3")  # as SLURM calls it
    assert sparing("a", failed_nodes={"broken"}) == "sbatch a" and given == [{"broken"}]
    fail(context, 101, 102)
    sparing("b")
    fail(context, 103)
    sparing("c", failed_nodes={"broken"})
    sparing("d")
    assert given[1:] == [None, ["broken", "gpu-3"], ["gpu-3"]]
