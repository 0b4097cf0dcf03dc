"""Profiles say where jobs run; plans are made by them."""

import json
import math
import os
import time
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import MachineError, MissingInputError, UsageError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.execution.snakemake import _words, complaint
from flowsculpt.pipeline.production.planning.plan import Job, Plan
from flowsculpt.pipeline.production.planning.profile import SIDE_BY_SIDE, Profile
from flowsculpt.pipeline.production.planning.timings import (
    LEAST_MIB,
    START_MINUTES,
    UNMEASURED_MIB,
    MeasuredResources,
)
from flowsculpt.pipeline.production.store.event_log import EventLog, EventReader
from flowsculpt.pipeline.production.store.paths import EVENTS
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.pipeline.production.tasks.job import Context, bring_inputs_to_now

NAME = "T010_tiny"


@pytest.fixture
def folder(project, monkeypatch):
    """The working folder of a project."""
    monkeypatch.chdir(project.path)
    return project.path


@pytest.fixture(autouse=True)
def plugin(tmp_path_factory, monkeypatch):
    """An executor that seems to be installed; nothing is run here."""
    place = tmp_path_factory.mktemp("plugin")
    (place / "snakemake_executor_plugin_slurm.py").touch()
    monkeypatch.syspath_prepend(place)


def profile(folder, text, name="mine"):
    (folder / "profiles" / name).mkdir(parents=True, exist_ok=True)
    (folder / "profiles" / name / "profile.yaml").write_text(text)
    return Profile.named(name)


def hops(plan):
    """The longest chain of jobs that a farm does one after the other."""

    def depth(job):
        read = [other for other in plan.jobs if other.output in plan.all_inputs(job)]
        return (not job.is_local) + max(map(depth, read), default=0)

    return max(map(depth, plan.jobs))


def test_a_profile_of_a_show_takes_the_name_of_no_shipped_one_and_is_named_by_its_path(folder):
    assert Profile.named("slurm").executor == "slurm" and Profile.named("slurm").hides is None
    assert Profile.named("local") == Profile.local() and Profile.local().is_local
    shipped = profile(folder, "executor: local\n", "slurm")
    assert shipped.executor == "slurm" and shipped.hides == Path("profiles/slurm")
    own = Profile.named("profiles/slurm")
    assert own.folder == folder / "profiles" / "slurm" and own.is_local and own.hides is None
    assert profile(folder, "executor: local\n", "ours").folder == folder / "profiles" / "ours"


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        ("executor: moonbase\n", MachineError, "pip install snakemake-executor-plugin-moonbase"),
        ("executor: [slurm]\n", UsageError, "it must be a name"),
        ("executor: slurm\njobs: many\n", UsageError, "jobs is 'many'; it must be a whole number"),
        ("executor: slurm\nconfig: {threads: 0}\n", UsageError, "config: threads is 0"),
        ("executor: {\n", UsageError, "not a profile"),
        ("slurm\n", UsageError, "executor: slurm"),
    ],
)
def test_what_is_wrong_with_a_profile_is_said_in_one_line(folder, text, error, says):
    with pytest.raises(error, match=r"profile\.yaml") as told:
        Project(folder, 2, profile=profile(folder, text)).meshes([NAME])
    assert says in str(told.value) and "\n" not in str(told.value)


def test_a_profile_that_is_not_there_is_told_with_those_there_are(folder):
    with pytest.raises(MissingInputError, match="Did you mean 'slurm'"):
        Profile.named("slrum")


def test_a_farm_gets_batches_with_cores_of_their_own_in_three_hops(folder):
    farm = profile(folder, "executor: slurm\njobs: 50\nconfig: {threads: 8, min_frames: 2}\n")
    plan = Project(folder, 2, profile=farm).film("draft")
    renders = [job for job in plan.jobs if job.stage == "render"]
    assert [job.frames for job in renders] == [(1, 2), (3, 4), (5, 6)]
    assert {job.threads for job in plan.jobs if not job.is_local} == {8}
    frozen = Plan.thaw(folder / plan.freeze(folder))
    assert [job.threads for job in frozen.jobs] == [job.threads for job in plan.jobs]
    assert hops(frozen) == 3
    assert {job.stage for job in plan.jobs if job.is_local} == {
        "smooth_normals",
        "frame_camera",
        "assemble",
        "film",
    }


def test_clips_of_the_same_frames_share_the_batches_of_a_farm(folder):
    clips = ", ".join(f"{{shot: {NAME}, frames: {frames}}}" for frames in ("1-6", "2-4"))
    (folder / "shots/film.yaml").write_text(f"title: T\nshots: [{clips}]\n")
    plan = Project(folder, 2).whole(["film"], "final", nodes=3)
    renders = [(job.frames, job.requests) for job in plan.jobs if job.stage == "render"]
    assert [frames for frames, _ in renders] == [(1, 2), (3, 4), (5, 6)]
    assert [places for _, places in renders] == [(0, 1), (0, 1), (0,)]


def test_snakemake_is_given_the_profile_and_what_this_machine_has(folder):
    farm = profile(folder, "executor: slurm\n")
    words = _words(Plan((), None, ()), 2, farm)
    assert words[words.index("--local-cores") + 1] == "2"
    assert words[words.index("--jobs") + 1] == str(SIDE_BY_SIDE)
    assert "--cores" in _words(Plan((), None, ()), 2, Profile.local())


def test_a_farm_that_takes_no_job_is_told_in_its_own_words(tmp_path):
    log = tmp_path / "snakemake.log"
    assert complaint(log) is None
    log.write_text("rule simulate:\n    jobid: 1\n    message: None\n")
    assert complaint(log) is None
    with log.open("a") as file:
        file.write("    message: Job submission failed: no sbatch.For further error details see the log\n")
    assert complaint(log) == "Job submission failed: no sbatch."


def test_what_earlier_pictures_took_is_asked_for(tmp_path):
    assert MeasuredResources.of(tmp_path, 960 * 540) is None
    for number, mib in ((1, 700), (2, 3000)):
        told = {
            "key": "k",
            "seconds": {"rendering": 25.0, "building": 5.0},
            "threads": 4,
            "peak_memory_mib": mib,
        }
        (tmp_path / f"a.{number:04d}.json").write_text(json.dumps(told))
    (tmp_path / "a.0003.json").write_text('{"seconds": ')
    (tmp_path / "a.0004.json").write_text(json.dumps({**told, "peak_memory_mib": 800, "pixels": 480 * 270}))
    measured = MeasuredResources.of(tmp_path, 960 * 540)
    assert measured.memory_mib == math.ceil(1.5 * 3200) + LEAST_MIB // 2, "the small one, four times as large"
    (tmp_path / "a.0004.json").unlink()
    measured = MeasuredResources.of(tmp_path, 960 * 540)
    assert measured.memory_mib == 4500 + LEAST_MIB // 2
    assert (
        measured.minutes(frames=10, threads=2) == START_MINUTES + 40
    )  # four times ten frames of a minute of two cores


@pytest.fixture
def context(tmp_path):
    """A job that waits for another."""
    simulation = Job("simulate_1", "simulate", (0,), (1,), output="done/simulate")
    normals = Job("smooth_normals_1", "smooth_normals", (0,), (1,), reads=(1,), output="done/normals")
    plan = Plan(requests=(), film=None, jobs=(simulation, normals))
    return Context.of(tmp_path, plan, "smooth_normals_1")


def test_a_job_that_said_why_it_failed_is_not_tried_again_and_a_killed_one_is(context):
    log = context.log
    log.write("begin")
    assert not context.failures.is_final()
    log.write("fail", exit_code=4)
    log.write("end")
    assert not context.failures.is_final()  # a full disk of one node
    context.log.path.unlink()
    log.write("fail", frame=3, exit_code=1)
    assert not context.failures.is_final()  # killed at a later frame
    log.write("end")
    assert context.failures.is_final()
    context.log.path.unlink()
    log.write("healed")
    assert context.failures.is_final()  # another round makes what it lacks


def test_a_node_without_the_variant_is_not_tried_again_and_another_node_is(context, monkeypatch):
    monkeypatch.setattr("platform.node", lambda: "node7")
    context.log.write("fail", exit_code=4)
    context.log.write("unfit", host="node7")
    context.log.write("end")
    assert context.failures.is_final()
    monkeypatch.setattr("platform.node", lambda: "node8")
    assert not context.failures.is_final()


def test_a_profile_names_the_variant_of_its_nodes(folder):
    profile(folder, "executor: slurm\nconfig: {variant: cuda_ad_rgb}\n")
    assert Project(folder, 1, profile=Profile.named("mine")).variant_of(NAME) == "cuda_ad_rgb"
    profile(folder, "executor: slurm\nconfig: {variant: cuda}\n")
    with pytest.raises(UsageError, match="variant is 'cuda', which Mitsuba does not have"):
        _ = Profile.named("mine").variant
    assert Profile.local().variant is None


def test_a_profile_without_an_executor_says_what_an_exported_job_asks_for(folder):
    profile(folder, "jobs: 7\nconfig: {threads: 16, variant: cuda_ad_rgb}\n")
    ours = Profile.named("mine")
    assert ours.is_local and ours.share is None and ours.jobs == 7 and ours.exported_share.threads == 16
    plan = Project(folder, 1, profile=ours).whole([NAME], "draft")
    assert plan.requests[0].variant == "cuda_ad_rgb"
    render = next(job for job in plan.jobs if job.stage == "render")
    assert (plan.memory_mib(render), plan.gpus(render), render.threads) == (UNMEASURED_MIB, 1, 16)


def test_who_fetches_the_frames_of_a_farm_needs_no_gpu(folder):
    profile(folder, "config: {variant: cuda_ad_rgb}\n")
    plan = Project(folder, 1, profile=Profile.named("mine")).pictures([NAME], "draft")
    assert plan.requests[0].variant == "cuda_ad_rgb" and plan.notes == ()


def test_inputs_from_the_future_are_given_the_present_time(context):
    source = context.root / context.plan.jobs[0].output
    source.parent.mkdir(parents=True)
    source.touch()
    os.utime(source, (0, 0))
    bring_inputs_to_now(context)
    assert source.stat().st_mtime == 0
    os.utime(source, (time.time() + 3600, time.time() + 3600))
    bring_inputs_to_now(context)
    assert source.stat().st_mtime <= time.time()


def test_every_other_host_has_an_event_log_of_its_own(tmp_path, monkeypatch):
    plan = Plan(requests=(), film=None, jobs=())
    reader = EventReader(tmp_path / EVENTS / f"{plan.name}.jsonl")
    EventLog(tmp_path / EVENTS / plan.log_name, "a").write("begin")
    assert [event["job"] for event in reader.new()] == ["a"]
    monkeypatch.setattr("platform.node", lambda: "node7")
    assert plan.log_name == f"{plan.name}.node7.jsonl"
    EventLog(tmp_path / EVENTS / plan.log_name, "b").write("begin")
    assert [event["job"] for event in reader.new()] == ["b"]
    assert list(reader.new()) == []


def test_a_simulation_tried_again_goes_on_from_its_last_frame(folder):
    from flowsculpt.pipeline.production.tasks.surfaces import simulate

    plan = Project(folder, 1).meshes([NAME], FrameRange.parse("1-3"))
    (job,) = plan.jobs
    context = Context.of(folder, plan, job.name)
    assert simulate(context)
    store, request = Store(folder), context.request
    store.discard("mesh", request.keys.mesh(3))
    outputs = [folder / place for place in request.places("mesh", job.frames)]
    for output in outputs:
        output.unlink()
    again = EventReader(context.log.path)
    list(again.new())
    assert simulate(context)
    assert [(event["frame"], event["found"]) for event in again.new()] == [(1, True), (2, True), (3, False)]
    assert all(output.is_file() for output in outputs)
