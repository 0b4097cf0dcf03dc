"""Runs on a SLURM of one node: the files of a local run, few hops, and no frame lost with a killed job."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.store.paths import STATE
from flowsculpt.pipeline.production.store.store import missed_uploads
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.production.tasks.surfaces import simulate
from tests.needed_plugins import needs_plugins
from tests.production.snakemake import snakemake

NAME = "T010_tiny"
QUALITY = "draft.scale10"
SLOW = ("--set", "quality.draft={samples: 1024}")


def files(root):
    """Return the content of all files of a run by path; links lead to the store, whose names are keys."""
    return {
        path.relative_to(root): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.suffix in (".npz", ".exr", ".mp4") and "logs" not in path.parts
    }


def events(root, kind="frame"):
    lines = [
        line for log in (root / STATE / "events").glob("*.jsonl") for line in log.read_text().splitlines()
    ]
    return [event for event in map(json.loads, lines) if event["event"] == kind]


def requested(job):
    """Return the rule and the frames of a job of SLURM, its cores, memory and time."""
    rule = job["Comment"].rpartition("_")[0]  # without the job's key
    return [rule, *(job[name] for name in ("NumCPUs", "MinMemoryNode", "TimeLimit"))]


def wait_until(there, seconds=120):
    deadline = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.1)


def running(slurm, task):
    return [
        job["JobId"]
        for job in slurm.jobs()
        if job["JobState"] == "RUNNING" and job["Comment"].startswith(f"rule_{task}")
    ]


def start(project, *words):
    command = [
        sys.executable,
        "-m",
        "flowsculpt",
        "--no-progress",
        "--json",
        *words,
        "--profile",
        "profiles/slurm",
    ]
    return subprocess.Popen(
        command, cwd=project.path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def test_a_simulation_on_a_node_makes_the_same_meshes(on_slurm, slurm, monkeypatch):
    before = len(slurm.jobs())
    far = on_slurm.run(
        "--json", "--root", "far", "simulate", NAME, "-f", "1-2", "--profile", "profiles/slurm"
    )
    assert far.code == 0, far.err
    assert json.loads(far.out)["made"] == {"simulate": 2}
    (job,) = slurm.jobs()[before:]
    assert job["JobState"] == "COMPLETED" and job["MinMemoryNode"] == "4G"
    near = on_slurm.path / "near"
    monkeypatch.chdir(on_slurm.path)
    plan = Project(near, 2).meshes([NAME], FrameRange.parse("1-2"))
    assert simulate(Context.of(near, plan, plan.jobs[0].name))
    assert files(on_slurm.path / "far") == files(near)


@pytest.mark.soak
class TestFilms:
    def test_a_film_is_the_same_to_the_bit_after_three_hops(self, on_slurm, slurm):
        before = len(slurm.jobs())
        words = ("film", "-q", QUALITY)
        for root, where in (("far", "slurm"), ("near", "local")):
            done = on_slurm.run("--root", root, *words, "--profile", where)
            assert done.code == 0, done.err
        far, near = files(on_slurm.path / "far"), files(on_slurm.path / "near")
        assert len(far) == len(near) > 24
        assert far == near
        tasks = [job["Comment"].split("_")[1] for job in slurm.jobs()[before:]]
        assert sorted(set(tasks)) == ["finish", "render", "simulate"]

    def test_nodes_upload_what_they_make_and_another_root_makes_none_of_it_again(
        self, on_slurm, slurm, store, tmp_path_factory
    ):
        before = len(slurm.jobs())
        words = ("film", "-q", QUALITY, "--store", store)
        far = on_slurm.run("--json", *words, "--profile", "profiles/slurm")
        assert far.code == 0, far.err
        assert json.loads(far.out)["warnings"] == [] and missed_uploads(on_slurm.path) == []
        assert len(slurm.jobs()) == before + 3
        other = on_slurm.copy(tmp_path_factory.mktemp("other") / "root")
        for made in ("renders", STATE):
            shutil.rmtree(other.path / made)
        again = other.run("--json", *words, "--profile", "profiles/slurm")
        assert again.code == 0 and json.loads(again.out)["made"] == {}, again.err
        assert len(slurm.jobs()) == before + 3
        movies = [root / "renders/film" / QUALITY / "film.mp4" for root in (on_slurm.path, other.path)]
        assert movies[0].read_bytes() == movies[1].read_bytes()

    def test_snakemake_asks_slurm_for_the_same_as_the_command(self, on_slurm, slurm, tmp_path_factory):
        other = on_slurm.copy(tmp_path_factory.mktemp("other") / "root")
        before = len(slurm.jobs())
        done = on_slurm.run("render", NAME, "-q", QUALITY, "--profile", "profiles/slurm")
        assert done.code == 0, done.err
        between = len(slurm.jobs())
        settings = ("--config", f"shot={NAME}", f"quality={QUALITY}")
        done = snakemake(other.path, "--profile", "profiles/slurm", *settings, cores=None)
        assert done.returncode == 0, done.stdout
        jobs = slurm.jobs()
        command, theirs = (sorted(map(requested, part)) for part in (jobs[before:between], jobs[between:]))
        assert command == theirs and len(command) == 3

    @needs_plugins("maintenance")
    def test_an_audit_makes_frames_again_on_nodes_and_finds_one_that_is_not_from_the_shot(
        self, on_slurm, slurm
    ):
        done = on_slurm.run("render", NAME, "-q", QUALITY)
        assert done.code == 0, done.err
        before = len(slurm.jobs())
        words = ("--json", "audit", NAME, "-q", QUALITY, "--share", "50%", "--profile", "profiles/slurm")
        audited = on_slurm.run(*words)
        assert audited.code == 0, audited.err
        facts = json.loads(audited.out)
        assert facts["same"] and facts["kept"] is None and len(facts["frames"]) == 3
        tasks = {job["Comment"].split("_")[1] for job in slurm.jobs()[before:]}
        assert tasks == {"finish", "render", "simulate"}, "nodes have made the frames"
        frames = sorted((on_slurm.path / "renders" / NAME / QUALITY / "frames").glob("*.exr"))
        chosen = facts["frames"][0]["frame"]
        other = frames[chosen % 6].read_bytes()
        stored = frames[chosen - 1].resolve()
        stored.chmod(0o644)
        stored.write_bytes(other)
        audited = on_slurm.run(*words)
        facts = json.loads(audited.out)
        assert audited.code == 1 and not facts["same"] and Path(on_slurm.path, facts["kept"]).is_dir()
        assert [row["frame"] for row in facts["frames"] if not row["same"]] == [chosen]

    def test_a_job_killed_mid_batch_is_tried_again_and_loses_no_frame(self, on_slurm, slurm):
        process = start(on_slurm, "--root", "far", "render", NAME, "-q", QUALITY, *SLOW)
        raw = on_slurm.path / "far" / "renders" / NAME / QUALITY / "raw"
        wait_until(lambda: len(list(raw.glob("*.exr"))) > 1)
        (job,) = running(slurm, "render")
        slurm.said("scancel", "--signal=KILL", "--full", job)
        out, err = process.communicate(timeout=300)
        assert process.returncode == 0, err
        assert json.loads(out)["made"]["render"] == 6
        found = [
            event["frame"]
            for event in events(on_slurm.path / "far")
            if event["stage"] == "render" and event["found"]
        ]
        assert found[:2] == [1, 2]
        near = on_slurm.run("--root", "near", "render", NAME, "-q", QUALITY, *SLOW)
        assert near.code == 0, near.err
        assert files(on_slurm.path / "far") == files(on_slurm.path / "near")

    def test_an_interrupt_takes_jobs_back_and_leaves_no_draft(self, on_slurm, slurm):
        process = start(on_slurm, "render", NAME, "-q", QUALITY, *SLOW)
        wait_until(lambda: on_slurm.frames(QUALITY, "raw"))
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
        assert process.returncode == 130, err
        wait_until(
            lambda: (
                not [job for job in slurm.jobs() if job["JobState"] in ("RUNNING", "COMPLETING", "PENDING")]
            ),
            30,
        )
        assert slurm.jobs()[-1]["JobState"] == "CANCELLED"
        assert not list(Path(on_slurm.path, STATE, "tmp").glob("*"))
        assert list((on_slurm.path / STATE / "checkpoints").glob("*"))

    def test_who_kills_the_command_leaves_no_job_behind(self, on_slurm, slurm):
        process = start(on_slurm, "render", NAME, "-q", QUALITY, *SLOW)
        wait_until(lambda: running(slurm, "simulate"))
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
        wait_until(lambda: slurm.jobs()[-1]["JobState"] in ("CANCELLED", "COMPLETED"), 60)
        time.sleep(2)
        assert not running(slurm, "render")
