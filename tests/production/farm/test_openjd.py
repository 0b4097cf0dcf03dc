"""A shot as an Open Job Description template: accepted, run in chunks, and the same to the bit."""

import subprocess
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from pipeline.cli.commands import export
from pipeline.cli.options import Common, PictureOptions
from pipeline.errors import UsageError
from pipeline.frames import FrameRange
from pipeline.production.execution.openjd import _written
from pipeline.production.execution.project import Project
from pipeline.production.planning.profile import Profile
from pipeline.production.tasks.job import Context
from pipeline.production.tasks.meshes import simulate
from render.post.image import read_exr

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
    done = project.run("--root", "out", "export", "openjd", NAME, "-f", "2-6x2", "-q", QUALITY)
    assert done.code == 0, done.err
    assert openjd("check", "template.yaml", folder=project.path).returncode == 0
    frame = steps(project.path / "template.yaml")["Render"]["parameterSpace"]["taskParameterDefinitions"][0]
    assert frame["range"] == "2-6:2" and frame["chunks"]["rangeConstraint"] == "NONCONTIGUOUS"
    ran = openjd("run", "template.yaml", "--step", "Assemble", "--run-dependencies", folder=project.path)
    assert ran.returncode == 0, ran.stdout
    made = sorted((project.path / "out/renders" / NAME / QUALITY / "frames").iterdir())
    assert [path.name for path in made] == [f"{NAME}.000{number}.exr" for number in (2, 4, 6)]
    monkeypatch.chdir(project.path)
    assert Project(project.path / "out", 2).pictures([NAME], QUALITY, "2-6x2").jobs == ()


@pytest.mark.soak
def test_frames_of_a_template_are_those_of_a_run(project):
    assert project.run("--root", "far", "export", "openjd", NAME, "-q", QUALITY, "-o", "job/t.yaml").code == 0
    ran = openjd("run", "job/t.yaml", "--step", "Assemble", "--run-dependencies", folder=project.path)
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


def test_a_part_of_a_task_is_a_job_of_the_whole_plan(project, monkeypatch):
    monkeypatch.chdir(project.path)
    plan = Project(project.path, 2).whole(NAME, QUALITY)
    assert plan.job("render:3,5-6").frames == (3, 5, 6)
    simulation = next(job for job in plan.jobs if job.stage == "simulate")
    assert simulate(Context.of(project.path, plan, simulation.name))
    assert Project(project.path, 2).whole(NAME, QUALITY).jobs == plan.jobs


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
        export.export(common, "openjd", PictureOptions(), NAME, Path("job.txt"))
