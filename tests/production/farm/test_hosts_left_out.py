"""A host of a farm gets one try at a frame, and is left out of a stage at three of whose frames it failed."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from snakemake.iocontainers import ResourceList

from flowsculpt.pipeline.errors import FrameError, MachineError
from flowsculpt.pipeline.production.execution.executors import avoid_unfit_hosts
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.execution.snakefile import PlannedWorkflow
from flowsculpt.pipeline.production.planning.profile import Profile
from flowsculpt.pipeline.production.tasks import worker
from flowsculpt.pipeline.production.tasks.job import Context, faults_of_hosts
from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.work_clock import Timing
from tests.conftest import QUALITY, ProjectFolder
from tests.production.farm.conftest import Farm, quick_profile
from tests.production.farm.slurm import SlurmError, running
from tests.production.farm.test_clusters import write_profile

pytestmark = pytest.mark.quick

NAME = "T010_tiny"

LARGEST = 100_000
"""Bytes of the largest file that the broken node writes: more than a mesh has, less than a raw picture."""


@pytest.fixture
def context(project: ProjectFolder, monkeypatch: pytest.MonkeyPatch) -> Context:
    """A job of a farm that renders, on node7."""
    monkeypatch.chdir(project.path)
    monkeypatch.delenv("SLURMD_NODENAME", raising=False)
    monkeypatch.setattr("platform.node", lambda: "node7")
    write_profile(project.path, "htcondor")
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
    assert context.failures.reason_to_leave() is None
    fail(context, 2)
    assert "node7 has failed at frame 2" in str(context.failures.reason_to_leave())
    assert worker.do_job(str(context.plan.file), context.job.name, after=0) == MachineError.exit_code
    assert context.failures.is_final(), "nor does it look at the job again"
    monkeypatch.setattr("platform.node", lambda: "node8")
    assert context.failures.reason_to_leave() is None and not context.failures.is_final()


def test_a_host_that_failed_at_three_frames_of_a_stage_is_left_out_of_it_and_named(context: Context) -> None:
    def refuse(number: int) -> bool:
        raise MachineError("no memory on the GPU")

    fail(context, 101, 102, 102)  # of other jobs, one of them twice
    assert context.failures.reason_to_leave() is None
    assert not context.for_each([103], refuse)
    warnings = [event["message"] for event in context.failures._events("warn") if event["event"] == "warn"]
    assert len(warnings) == 1 and "node7 has failed at 3 frames of render and is left out" in warnings[0]
    assert "left out" in str(context.failures.reason_to_leave())
    finish = next(job.name for job in context.plan.jobs if job.stage == "finish")
    assert Context.of(context.root, context.plan, finish).failures.reason_to_leave() is None


def test_what_a_shot_is_to_blame_for_leaves_no_host_out(context: Context) -> None:
    for number in range(101, 110):
        context.fail(FrameError("a vertex is not finite"), number)
    assert context.failures.reason_to_leave() is None
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
    assert context.failures.reason_to_leave() is None
    assert not context.failures.is_final(), "a retry may find space"
    scratch = tmp_path_factory.mktemp("scratch")
    for number in range(101, 105):
        fill(scratch, number)
    assert "left out" in str(context.failures.reason_to_leave())


def test_the_host_of_the_plan_is_not_left_out_of_what_only_it_does(context: Context) -> None:
    local = next(job.name for job in context.plan.jobs if job.is_local)
    context = Context.of(context.root, context.plan, local)
    fail(context, 1, 2, 3)
    assert context.failures.reason_to_leave() is None
    assert not faults_of_hosts(context.root, context.plan), "so SLURM does not get its name either"


@pytest.fixture
def submitted(context: Context, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Any]:
    """Submit the job to a SLURM of two nodes; return what it is submitted with besides."""
    nodes = tmp_path / "sinfo"
    nodes.write_text("#!/bin/sh\necho gpu-3\necho gpu-4\n")
    nodes.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    workflow = PlannedWorkflow.__new__(PlannedWorkflow)
    workflow._root = context.root
    workflow.__dict__["plan"] = context.plan  # as `cached_property` keeps it
    rule, wildcards = SimpleNamespace(name=context.job.stage), SimpleNamespace(key=context.job.key)

    def submit(named: str | None = None, extra: str | None = None) -> str | None:
        settings = SimpleNamespace(executor_settings=SimpleNamespace(exclude_failed_nodes=named))
        resources = ResourceList(fromdict={"slurm_extra": extra} if extra else {})
        job = SimpleNamespace(rule=rule, wildcards=wildcards, resources=resources, is_group=lambda: False)
        avoid_unfit_hosts(_Executor, workflow.unfit_hosts)(settings).run_jobs([job])
        return job.resources.get("slurm_extra")

    return submit


class _Executor:
    """An executor that submits nothing."""

    def __init__(self, workflow: Any) -> None:
        self.workflow = workflow

    def run_jobs(self, jobs: Any) -> None:
        pass


def fail_on(host: str, context: Context, *frames: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SLURMD_NODENAME", host)  # as SLURM calls it
        fail(context, *frames)


def test_slurm_spares_the_hosts_that_are_left_out(context: Context, submitted: Callable[..., Any]) -> None:
    assert submitted(named="broken") is None, "SLURM's plug-in sees to these"
    fail_on("gpu-3", context, 101, 102)
    assert submitted() is None
    fail_on("gpu-3", context, 103)
    assert submitted() == "--exclude=gpu-3" and submitted(named="broken, ") == "--exclude=broken,gpu-3"
    assert submitted(extra="--nice=7") == "--nice=7 --exclude=gpu-3"


def test_slurm_gives_a_frame_to_a_host_once(context: Context, submitted: Callable[..., Any]) -> None:
    fail_on("gpu-4", context, context.job.frames[0])
    assert submitted() == "--exclude=gpu-4"


def test_slurm_is_never_asked_to_spare_all_its_nodes(context: Context, submitted: Callable[..., Any]) -> None:
    for host in ("gpu-3", "gpu-4"):
        fail_on(host, context, context.job.frames[0])
    assert submitted() is None


@pytest.mark.soak
def test_slurm_gives_a_host_whose_pictures_fail_no_more_of_them_and_the_run_is_whole(
    project: ProjectFolder, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    quick_profile(project.path)
    profile = project.path / "profiles" / "slurm" / "profile.yaml"
    profile.write_text(profile.read_text().replace("min_frames: 6", "min_frames: 1"))
    shot = project.path / "shots" / f"{NAME}.yaml"
    shot.write_text(shot.read_text().replace("frames: 1-6", "frames: 1-8"))
    with ExitStack() as stack:
        try:
            found = stack.enter_context(running(tmp_path_factory.mktemp("slurm"), 1, {"broken": LARGEST}))
        except SlurmError as error:
            pytest.skip(str(error))
        for name, value in found.items():
            monkeypatch.setenv(name, value)
        monkeypatch.syspath_prepend(found["PYTHONPATH"].partition(":")[0])
        words = ("--json", "render", NAME, "-q", QUALITY, "--profile", "profiles/slurm")
        done = project.run(*words)
        jobs = Farm(found).jobs()
    assert done.code == 0, done.err
    assert json.loads(done.out)["made"]["render"] == 8
    assert len(project.frames(QUALITY, "frames")) == 8
    renders = [job for job in jobs if job["Comment"].startswith("rule_render")]
    there = [job for job in renders if job["NodeList"] == "broken"]
    assert len(there) == 3 and all(job["JobState"] == "FAILED" for job in there), there
    assert "broken has failed at 3 frames of render and is left out" in done.err + done.out
    excluded = [job for job in renders if job.get("ExcNodeList") == "broken"]
    assert excluded, "SLURM got its name"


def test_a_frame_that_another_host_has_made_since_does_not_count_as_failed(context: Context) -> None:
    fail(context, 1, 2)
    assert context.failures.frames("render") == {1, 2}
    context.report(2, False, Timing(1.0, 1.0))
    assert context.failures.frames("render") == {1}
