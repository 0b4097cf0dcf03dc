"""The Snakefile by Snakemake's own commands: on an empty, a half-done and a finished root."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.execution.snakefile import PlannedWorkflow, _unprotect
from flowsculpt.pipeline.production.planning.profile import Profile, shipped
from flowsculpt.pipeline.production.stages import STAGES
from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.post.image import read_exr, read_header
from tests.conftest import QUALITY
from tests.production.snakemake import CHECKOUT, snakemake, workflow

NAME = "T010_tiny"
STAGE_RULES = ("simulate", "smooth_normals", "frame_camera", "render", "finish", "assemble", "film")
TARGETS = ("all", "shots", "frame", "stills")
FRAME = f"renders/{NAME}/{QUALITY}/frames/{NAME}.0003.exr"
MOVIE = f"renders/{NAME}/{QUALITY}/{NAME}.mp4"
FILM = f"renders/film/{QUALITY}/film.mp4"
CONFIG = ("--config", f"quality={QUALITY}")


def jobs_in(told: str) -> dict[str, int]:
    """Read the table of jobs that Snakemake prints first: how many of each rule are to run."""
    table = told.partition("Job stats:")[2].partition("total")[0]
    return {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE)}


def store_times(root: Path, kind: str) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in (root / ".flowsculpt/store" / kind).glob("*/*")}


def forget(root: Path, kind: str, picture: Path) -> None:
    """Remove the file of a picture from the store."""
    key = read_header(picture)["key"]
    (root / ".flowsculpt/store" / kind / key[:2] / f"{key}.exr").unlink()


def wrong(error: Callable[[], object]) -> str:
    with pytest.raises(SystemExit) as ended:
        error()
    return str(ended.value)


def test_every_stage_is_a_rule_with_a_line_about_it(project: Any) -> None:
    listed = snakemake(project.path, "--list").stdout
    assert all(re.search(rf"^{rule} \([A-Z].*\.\)$", listed, re.MULTILINE) for rule in STAGE_RULES)
    assert all(re.search(rf"^{rule} \(", listed, re.MULTILINE) for rule in TARGETS)


def test_the_snakefile_and_the_table_of_stages_agree_about_what_a_stage_reads() -> None:
    text = (CHECKOUT / "Snakefile").read_text()
    read = {rule: re.findall(rf'inputs\("{rule}", w, "(\w+)"\)', text) for rule in STAGE_RULES}
    assert read == {rule: list(STAGES[rule].reads) for rule in STAGE_RULES}
    local = text.partition("localrules:")[2].partition("rule all:")[0].replace(",", "").split()
    assert {rule for rule in STAGE_RULES if rule not in local} == {
        s.name for s in STAGES.values() if s.on_farm
    }


def test_on_an_empty_root_everything_is_to_be_made(project: Any) -> None:
    told = snakemake(project.path, "-n", *CONFIG).stdout
    assert jobs_in(told) == {**dict.fromkeys(STAGE_RULES, 1), "render": 2, "finish": 2, "all": 1}
    assert "missing" in snakemake(project.path, "--summary", *CONFIG).stdout
    assert not (project.path / ".flowsculpt/plans").exists(), "nothing is planned for jobs, nothing is locked"
    assert not (project.path / ".flowsculpt/lock").exists()


@pytest.mark.soak
def test_one_frame_is_made_by_its_name_and_the_film_goes_on_from_there(
    project: Any, finished_project: Any
) -> None:
    done = snakemake(project.path, FRAME)
    assert done.returncode == 0, done.stdout
    assert [path.name for path in project.frames()] == [Path(FRAME).name]
    until = snakemake(project.path, "-n", *CONFIG, "--until", "finish").stdout
    assert jobs_in(until) == {"smooth_normals": 1, "render": 2, "finish": 2}
    done = snakemake(project.path, *CONFIG)
    assert done.returncode == 0, done.stdout
    assert not {"simulate", "frame_camera"} & jobs_in(done.stdout).keys()
    assert len(project.frames()) == 6
    for one, other in zip(finished_project.frames(), project.frames(), strict=True):
        assert np.array_equal(read_exr(one)[0]["beauty"], read_exr(other)[0]["beauty"])
    assert project.call("film", "-q", QUALITY).out.startswith("Nothing to be done")


def test_on_a_finished_root_nothing_is_to_be_done_and_any_rule_can_be_forced(finished: Any) -> None:
    for words in ((FRAME, MOVIE, FILM), CONFIG):
        assert "Nothing to be done" in snakemake(finished.path, "-n", *words).stdout
    forced = snakemake(finished.path, "-n", *CONFIG, "--forcerun", "render").stdout
    assert jobs_in(forced) == {"render": 2, "finish": 2, "assemble": 1, "film": 1, "all": 1}
    assert re.search(r"^rule render:", forced, re.MULTILINE)
    graph = snakemake(finished.path, "--rulegraph", *CONFIG).stdout
    assert all(f'"{rule}"' in graph for rule in STAGE_RULES)
    assert "missing" not in snakemake(finished.path, "--summary", *CONFIG).stdout
    reported = snakemake(finished.path, "--report", "report.html", *CONFIG)
    assert reported.returncode == 0 and (finished.path / "report.html").stat().st_size > 10000


def replaced_by(root: Path, command: Callable[[], object]) -> dict[str, list[bool]]:
    """Run a command; return by kind which files of the store it has replaced."""
    kinds = ("mesh", "normals", "cameras", "raw", "frame", "movie")
    before = {kind: store_times(root, kind) for kind in kinds}
    command()
    after = {kind: store_times(root, kind) for kind in kinds}
    return {kind: [after[kind][name] > before[kind][name] for name in before[kind]] for kind in kinds}


@pytest.mark.soak
def test_forced_jobs_replace_what_the_store_holds(finished: Any) -> None:
    pictures = [path.read_bytes() for path in finished.frames()]

    def force() -> None:
        done = snakemake(finished.path, *CONFIG, "--forcerun", "render")
        assert done.returncode == 0, done.stdout

    newer = replaced_by(finished.path, force)
    assert all(newer["raw"]) and all(newer["frame"]) and all(newer["movie"])
    assert not any(newer["mesh"]) and not any(newer["normals"])
    assert [path.read_bytes() for path in finished.frames()] == pictures
    assert finished.call("film", "-q", QUALITY).out.startswith("Nothing to be done")


def test_the_command_forces_rendering_once_and_shows_what_it_made(finished: Any) -> None:
    pictures = [path.read_bytes() for path in finished.frames()]
    words = ("render", NAME, "-q", QUALITY, "-f", "2-3", "--force")
    assert "rendering 2 frames, denoising 2 frames" in finished.call(*words, "--dry-run").out

    def force() -> None:
        done = finished.run(*words)
        assert done.code == 0 and "(2 frames rendered)" in done.out, done.err

    newer = replaced_by(finished.path, force)
    assert sum(newer["raw"]) == sum(newer["frame"]) == 2
    assert not any(newer["mesh"] + newer["normals"] + newer["cameras"] + newer["movie"])
    assert [path.read_bytes() for path in finished.frames()] == pictures
    assert [path.stat().st_nlink for path in finished.frames()] == [1, 2, 2, 1, 1, 1], (
        "links to the new files"
    )
    assert finished.call("render", NAME, "-q", QUALITY).out.startswith("Nothing to be done")


@pytest.mark.soak
def test_a_film_is_forced_with_all_of_its_frames_and_movies(finished: Any) -> None:
    def force() -> None:
        done = finished.run("film", "-q", QUALITY, "--force", "--json")
        assert done.code == 0, done.err

    newer = replaced_by(finished.path, force)
    assert all(newer["raw"]) and all(newer["frame"]) and all(newer["movie"])
    assert not any(newer["mesh"] + newer["normals"] + newer["cameras"])


def test_on_a_half_done_root_just_what_is_missing_is_made(finished: Any) -> None:
    for path in (finished.frames()[1], finished.frames()[4]):
        forget(finished.path, "frame", path)
    forget(finished.path, "raw", finished.frames(kind="raw")[4])
    before = store_times(finished.path, "raw")
    done = snakemake(finished.path, *CONFIG, cores=1)
    assert done.returncode == 0, done.stdout
    assert jobs_in(done.stdout) == {"render": 1, "finish": 1, "assemble": 1, "film": 1, "all": 1}
    assert "frames 0005-0005" in done.stdout and "frames 0002-0005" in done.stdout
    assert before.items() <= store_times(finished.path, "raw").items()
    assert finished.call("film", "-q", QUALITY).out.startswith("Nothing to be done")


def test_done_files_cannot_lie_when_the_store_has_lost_what_they_name(finished: Any) -> None:
    for stored in (finished.path / ".flowsculpt/store/cameras").rglob("*.json"):
        stored.unlink()
    forget(finished.path, "frame", finished.frames()[0])
    assert jobs_in(snakemake(finished.path, "-n", *CONFIG).stdout)["frame_camera"] == 1
    made = json.loads(finished.run("film", "-q", QUALITY, "--json").out)["made"]
    assert made["finish"] == 1, made
    assert "Nothing to be done" in snakemake(finished.path, "-n", *CONFIG).stdout


def test_an_edit_is_made_and_taken_back_for_nothing(finished: Any) -> None:
    text = finished.shot.read_text()
    finished.shot.write_text(text.replace("azimuth: -30", "azimuth: 20"))
    words = ("--config", f"shot={NAME}", "frames=1-2", f"quality={QUALITY}")
    jobs = jobs_in(snakemake(finished.path, "-n", *words).stdout)
    assert "simulate" not in jobs and jobs["assemble"] == 1
    assert finished.run("render", NAME, "-f", "1-2", "-q", QUALITY).code == 0
    assert "Nothing to be done" in snakemake(finished.path, "-n", *words).stdout, "both mean the same files"
    assert probe_movie(finished.path / MOVIE.replace(".mp4", ".1-2.mp4")).frames == 2
    finished.shot.write_text(text)
    back = snakemake(finished.path, *CONFIG, cores=1)
    assert back.returncode == 0 and not {"simulate", "render", "finish"} & jobs_in(back.stdout).keys()
    assert finished.call("film", "-q", QUALITY).out.startswith("Nothing to be done")


def test_a_movie_that_fails_to_encode_leaves_the_one_before(finished: Any) -> None:
    before = (finished.path / FILM).read_bytes()
    edit = finished.path / "shots/film.yaml"
    edit.write_text(edit.read_text() + "sound: {file: ../noise.wav}\n")
    (finished.path / "noise.wav").write_bytes(b"no sound at all")
    done = snakemake(finished.path, *CONFIG, cores=1)
    assert done.returncode == 1
    assert (finished.path / FILM).read_bytes() == before


@pytest.mark.parametrize(
    ("targets", "config", "says"),
    [
        ((), {"qualty": "draft"}, "--config qualty: unknown setting. Did you mean 'quality'?"),
        ((), {"quality": "drft"}, "'drft' is not a quality"),
        ((), {"shot": "T010_tin"}, "no such shot; did you mean T010_tiny?"),
        ((), {"shot": NAME, "frames": "9-12"}, "frames 9-12 are not in the shot, which has 1-6"),
        ((), {"frames": "1-2"}, "needs a shot; add shot=NAME"),
        ((), {"edit": "flim"}, "no such edit; did you mean film?"),
        ((), {"allow_code": "perhaps"}, "allow_code is 'perhaps'"),
        ((FRAME.replace("0003", "0099"),), {}, "frame 99 is not in the shot"),
        ((FRAME.replace(QUALITY, "prevew"),), {}, "'prevew' is not a quality"),
        (("renders/Nix/draft/Nix.mp4",), {}, "shots/Nix.yaml: no such shot"),
        (("renders/turntable/a.0001/draft/a.0001.mp4",), {}, "flowsculpt turntable"),
    ],
)
def test_what_cannot_be_made_is_one_message(
    project: Any, monkeypatch: pytest.MonkeyPatch, targets: tuple[str, ...], config: dict[str, str], says: str
) -> None:
    monkeypatch.chdir(project.path)
    told = wrong(lambda: PlannedWorkflow(workflow(*targets), config).plan)
    assert says in told and "\n" not in told


def test_the_message_is_all_that_the_command_says_and_it_ends_with_1(project: Any) -> None:
    done = snakemake(project.path, "-n", "--config", "qualty=draft")
    assert done.returncode == 1 and "Traceback" not in done.stdout
    assert done.stdout.strip().splitlines()[-1].startswith("--config qualty: unknown setting.")
    (project.path / "shots/film.yaml").unlink()
    for path in (project.path / "shots").glob("*.yaml"):
        path.unlink()
    done = snakemake(project.path, "-n")
    assert done.returncode == 1 and "Traceback" not in done.stdout
    assert "flowsculpt new --show" in done.stdout.strip().splitlines()[-1]


def test_a_profile_means_the_same_through_snakemake(project: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project.path)
    monkeypatch.setattr(Profile, "executor", "slurm")
    ours = Project(project.path, 2, profile=Profile.named("slurm")).film("draft")
    monkeypatch.setattr(sys, "argv", ["snakemake", "--profile", str(shipped() / "slurm")])
    planned = PlannedWorkflow(workflow(nodes=100), {"quality": "draft"})
    theirs = planned.plan
    assert theirs.farm and ours.farm
    shapes = [{(j.stage, j.frames, j.threads) for j in plan.jobs} for plan in (ours, theirs)]
    assert shapes[0] == shapes[1]
    render = next(job for job in theirs.jobs if job.stage == "render")
    assert render.threads == 4 and planned.memory("render", render) == 4096


def test_a_setting_on_the_command_line_leaves_the_others_of_the_profile(
    project: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(project.path)
    (project.path / "mine").mkdir()
    (project.path / "mine/profile.yaml").write_text("config: {threads: 3, min_frames: 2}\n")
    monkeypatch.setattr(sys, "argv", ["snakemake", "--profile=mine", "--config", "min_frames=6"])
    plan = PlannedWorkflow(workflow(nodes=100), {"quality": "draft", "min_frames": 6}).plan
    assert {(job.frames, job.threads) for job in plan.jobs if job.stage == "render"} == {
        (tuple(range(1, 7)), 3)
    }
    monkeypatch.setattr(sys, "argv", ["snakemake"])
    monkeypatch.setenv("SNAKEMAKE_PROFILE", "mine")
    plan = PlannedWorkflow(workflow(nodes=100), {"quality": "draft"}).plan
    assert [job.frames for job in plan.jobs if job.stage == "render"] == [(1, 2), (3, 4), (5, 6)]


def test_stills_go_through_the_same_rules(finished: Any) -> None:
    done = finished.run("stills", NAME, "-f", "2-3", "-q", QUALITY)
    assert done.code == 0, done.err
    made = sorted(path.name for path in (finished.path / f"renders/{NAME}/{QUALITY}/png").iterdir())
    assert made == [f"{NAME}.0002.png", f"{NAME}.0003.png"]
    log = max((finished.path / ".flowsculpt/logs").glob("2*/snakemake.log"))
    assert "rule stills:" in log.read_text()


def test_a_read_only_link_makes_way_for_a_copy_that_snakemake_may_replace(tmp_path: Path) -> None:
    stored, shown = tmp_path / "stored.exr", tmp_path / "shown.exr"
    stored.write_text("pixels")
    stored.chmod(0o444)
    shown.hardlink_to(stored)
    _unprotect(shown)
    _unprotect(tmp_path / "missing.exr")
    assert shown.read_text() == "pixels" and shown.stat().st_mode & 0o200
    assert not stored.stat().st_mode & 0o222
