"""A shot as an Open Job Description template: accepted, run in chunks, and the same to the bit."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from flowsculpt.pipeline.cli.options import Common, PictureOptions
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.plugins.farm import farm_commands
from flowsculpt.pipeline.plugins.farm.openjd import _written, template
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.profile import Profile
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.production.tasks.surfaces import simulate
from flowsculpt.render.post.image import read_exr
from tests.conftest import commanded

NAME = "T010_tiny"
QUALITY = "draft.scale10"
OPENJD = Path(sys.executable).with_name("openjd")


def openjd(*words, folder):
    return subprocess.run(
        [OPENJD, *words], cwd=folder, capture_output=True, text=True, stdin=subprocess.DEVNULL
    )


def steps(path):
    return {step["name"]: step for step in YAML(typ="safe").load(path.read_text())["steps"]}


def test_a_template_is_run_in_chunks_of_any_frames(project, monkeypatch):
    done = project.call("--root", "out", "export", "openjd", NAME, "-f", "2-6x2", "-q", QUALITY)
    assert done.code == 0, done.err
    render = steps(project.path / "template.yaml")[f"Render {NAME}"]
    frame = render["parameterSpace"]["taskParameterDefinitions"][0]
    assert frame["range"] == "2-6:2" and frame["chunks"]["rangeConstraint"] == "NONCONTIGUOUS"
    ran = openjd("run", "template.yaml", folder=project.path)
    assert ran.returncode == 0, ran.stdout
    made = sorted((project.path / "out/renders" / NAME / QUALITY / "frames").iterdir())
    assert [path.name for path in made] == [f"{NAME}.000{number}.exr" for number in (2, 4, 6)]
    monkeypatch.chdir(project.path)
    assert Project(project.path / "out", 2).pictures([NAME], QUALITY, FrameRange.parse("2-6x2")).jobs == ()


@pytest.mark.soak
def test_frames_of_a_template_are_those_of_a_run(project):
    assert (
        project.call("--root", "far", "export", "openjd", NAME, "-q", QUALITY, "-o", "job/t.yaml").code == 0
    )
    ran = openjd("run", "job/t.yaml", folder=project.path)
    assert ran.returncode == 0, ran.stdout
    assert project.run("--root", "near", "render", NAME, "-q", QUALITY).code == 0
    for kind in ("raw", "frames"):
        folders = [project.path / root / "renders" / NAME / QUALITY / kind for root in ("far", "near")]
        pairs = zip(*(sorted(folder.iterdir()) for folder in folders), strict=True)
        for far, near in pairs:
            (one, header), (other, theirs) = read_exr(far), read_exr(near)
            assert header["key"] == theirs["key"]
            assert one["beauty"].tobytes() == other["beauty"].tobytes()
            assert far.read_bytes() == near.read_bytes()


OTHER = """\
title: A box that has the motion of T010_tiny, lit otherwise
frames: 1-6
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.5}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 4: 36, 6: 60}}}
camera: {azimuth: 50, elevation: 14}
"""

EDIT = """\
title: ""
shots: [{shot: T010_tiny, frames: 1-2}, {shot: T020_other, frames: 3-4}, {shot: T010_tiny, frames: 5-6}]
title_seconds: 0
credits_seconds: 0
"""


@pytest.fixture
def edit(project, monkeypatch):
    """A project with an edit of three clips of two shots, which share their meshes."""
    (project.path / "shots" / "T020_other.yaml").write_text(OTHER)
    (project.path / "shots" / "reel.yaml").write_text(EDIT)
    monkeypatch.chdir(project.path)
    return project


def job_of(project, *names, variant=None, profile=None):
    """Return the template of a job as the command writes it, in this process."""
    plan = Project(project.path, 2, variant).whole(names, QUALITY)
    return template(plan, "plan.json", project.path, "+".join(names), 4, None)


def waits(job):
    """Return what each step of a template waits for, by its name."""
    return {
        step["name"]: {other["dependsOn"] for other in step.get("dependencies", ())} for step in job["steps"]
    }


def test_a_film_waits_for_all_its_shots_and_a_shot_for_the_meshes_that_another_makes(edit):
    after = waits(job_of(edit, "reel"))
    assert after["Film"] == {f"Finish {NAME}", "Finish T020_other"}
    assert f"Surfaces {NAME}" in after["Render T020_other"] | after["Surfaces T020_other"]
    assert after["Assemble T020_other"] == {"Finish T020_other"}
    two = waits(job_of(edit, NAME, "T020_other"))
    assert "Film" not in two and len(two) == 8


@pytest.mark.soak
def test_a_film_that_a_render_manager_makes_is_that_of_a_run(edit):
    assert edit.call("--root", "far", "export", "openjd", "reel", "-q", QUALITY).code == 0
    assert openjd("check", "template.yaml", folder=edit.path).returncode == 0
    ran = openjd("run", "template.yaml", folder=edit.path)
    assert ran.returncode == 0, ran.stdout
    assert edit.run("--root", "near", "film", "reel", "-q", QUALITY).code == 0
    films = [edit.path / root / "renders/film" / QUALITY / "reel.mp4" for root in ("far", "near")]
    assert films[0].read_bytes() == films[1].read_bytes()


def test_tasks_ask_for_a_time_limit_cores_and_what_earlier_frames_took(edit):
    unmeasured = {step["name"]: step for step in job_of(edit, NAME)["steps"]}
    assert all(step["script"]["actions"]["onRun"]["timeout"] >= 3600 for step in unmeasured.values())
    statistics = edit.path / "renders" / NAME / QUALITY / "statistics" / f"{NAME}.0001.json"
    statistics.parent.mkdir(parents=True)
    took = {"key": "k", "seconds": {"rendering": 300.0}, "threads": 4, "peak_memory_mib": 6000}
    statistics.write_text(json.dumps(took))
    measured = {step["name"]: step for step in job_of(edit, NAME)["steps"]}

    def amounts(step):
        return {amount["name"]: amount["min"] for amount in step["hostRequirements"]["amounts"]}

    render = f"Render {NAME}"
    assert amounts(unmeasured[render]) == {"amount.worker.vcpu": 4, "amount.worker.memory": 4096}
    assert amounts(measured[render]) == {"amount.worker.vcpu": 4, "amount.worker.memory": 9512}
    assert amounts(measured[f"Finish {NAME}"])["amount.worker.memory"] == 4096


@pytest.mark.parametrize(("nodes", "frames"), [(2, 3), (4, 2), (100, 1)])
def test_chunks_are_as_small_as_the_workers_need_and_so_are_those_of_a_plan(edit, nodes, frames):
    words = (NAME, "-q", "final", "--nodes", str(nodes))
    assert edit.call("export", "openjd", *words).code == 0
    render, finish = (steps(edit.path / "template.yaml")[f"{kind} {NAME}"] for kind in ("Render", "Finish"))
    chunks = render["parameterSpace"]["taskParameterDefinitions"][0]["chunks"]
    assert chunks["defaultTaskCount"] == frames
    assert chunks["targetRuntimeSeconds"] == pytest.approx(
        frames * 56, rel=0.05
    )  # of a typical final, on 4 cores
    assert finish["parameterSpace"]["taskParameterDefinitions"][0]["chunks"]["defaultTaskCount"] >= 3
    planned = json.loads(edit.call("--json", "export", "plan", *words).out)["chunks"]
    renders = [chunk for chunk in planned if chunk.startswith("render:")]
    assert len(renders) == 6 // frames and renders[0] == ("render:1" if frames == 1 else f"render:1-{frames}")


@pytest.mark.parametrize(
    ("names", "told"),
    [
        ((NAME, "T020_other", "-f", "1-2"), "frames can be chosen of one shot"),
        (("reel", "-f", "1-2"), "reel is an edit, which names its own"),
        (("reel", "film"), "a plan makes one film; name one"),
        (("T030_none",), "no such shot"),
    ],
)
def test_a_job_that_cannot_be_exported_is_told_in_one_line(edit, names, told):
    code, said = commanded(edit.path, "export", "openjd", *names)
    assert code in (2, 3) and told in said
    assert not (edit.path / "template.yaml").exists()


def test_a_shot_of_a_long_name_has_steps_of_the_length_that_the_specification_allows(edit):
    name = "T" * 90
    (edit.path / "shots" / f"{name}.yaml").write_text(OTHER)
    assert edit.call("export", "openjd", name, "-q", QUALITY).code == 0
    assert openjd("check", "template.yaml", folder=edit.path).returncode == 0


def test_a_part_of_a_task_is_a_job_of_the_whole_plan(project, monkeypatch):
    monkeypatch.chdir(project.path)
    plan = Project(project.path, 2).whole([NAME], QUALITY)
    assert plan.job("render:3,5-6").frames == (3, 5, 6)
    simulation = next(job for job in plan.jobs if job.stage == "simulate")
    assert simulate(Context.of(project.path, plan, simulation.name))
    assert Project(project.path, 2).whole([NAME], QUALITY).jobs == plan.jobs


@pytest.mark.parametrize("frames", ["1-48", "1-9x2", "3,17,41", "1-5,8-12x2", "-3-2"])
def test_frames_are_written_as_the_specification_writes_them(frames):
    from openjd.model import IntRangeExpr

    numbers = FrameRange.parse(frames).numbers
    assert tuple(IntRangeExpr.from_str(_written(numbers))) == numbers


def test_a_template_is_called_as_one(tmp_path):
    common = Common(
        json=False,
        progress=False,
        cores=1,
        dry_run=False,
        root=tmp_path,
        patience=60.0,
        profile=Profile.local(),
    )
    with pytest.raises(UsageError, match=r"job\.yaml"):
        farm_commands.openjd(common, [NAME], PictureOptions(), Path("job.txt"))
