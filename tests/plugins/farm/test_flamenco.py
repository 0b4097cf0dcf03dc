"""The job type for Flamenco makes tasks that do a whole plan, in order; run by node with a stand-in's API."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.plugins.farm.flamenco import JOB_TYPE
from flowsculpt.pipeline.plugins.farm.task_runner import _jobs
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.plan import Plan
from tests.conftest import ProjectFolder

pytestmark = pytest.mark.quick

NAME = "T010_tiny"
QUALITY = "draft.scale10"

MANAGER = """
// What Flamenco's compiler offers to scripts: it calls compileJob with a job to which tasks are added.
const fs = require("fs"), vm = require("vm");
const [script, submitted] = process.argv.slice(1);
const job = JSON.parse(fs.readFileSync(submitted)), added = [];
const checked = (kind, value) => { if (typeof value !== kind) throw new Error(`${value}: no ${kind}`); };
const author = {
  Task(name, type) {
    checked("string", name); checked("string", type);
    const task = {name, type, commands: [], dependencies: [],
                  addCommand(command) { task.commands.push(command); },
                  addDependency(other) { task.dependencies.push(other); }};
    return task;
  },
  Command(name, parameters) {
    checked("string", name); checked("object", parameters);
    return {name, parameters};
  },
};
const context = vm.createContext({author, print() {}});
const source = fs.readFileSync(script, "utf-8");
vm.runInContext(source + "\\nObject.assign(this, {JOB_TYPE, compileJob});", context);
const kinds = {string: "string", int32: "number"};
for (const {key, type} of context.JOB_TYPE.settings) checked(kinds[type], job.settings[key]);
for (const key of Object.keys(job.settings))
  if (!context.JOB_TYPE.settings.some((known) => known.key === key)) throw new Error(`${key}: unknown`);
context.compileJob({settings: job.settings, addTask(task) { added.push(task); }});
console.log(JSON.stringify(added.map((task) => (
  {...task, dependencies: task.dependencies.map((other) => added.indexOf(other))}))));
"""


def node() -> str:
    """The program of node: the system's, or the one that playwright brings."""
    from playwright._impl._driver import compute_driver_executable

    return shutil.which("node") or str(compute_driver_executable()[0])


def compiled(job: Path) -> list[dict[str, Any]]:
    """The tasks that the job type makes of a submitted job, with the places of those they wait for."""
    ran = subprocess.run(
        [node(), "-e", MANAGER, str(job.with_name(JOB_TYPE.name)), str(job)], capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    tasks: list[dict[str, Any]] = json.loads(ran.stdout)
    return tasks


def test_the_tasks_of_a_film_do_all_of_its_plan_each_after_what_it_reads(project: ProjectFolder) -> None:
    done = project.call("--root", "out", "export", "flamenco", "film", "-q", QUALITY, "-o", "job/film.json")
    assert done.code == 0, done.err
    job = json.loads((project.path / "job/film.json").read_text())
    assert (job["type"], job["name"], job["submitter_platform"]) == ("flowsculpt", "flowsculpt film", "linux")
    changed = {**job, "settings": {**job["settings"], "chunk_size": 4, "store": "s3://bucket/show"}}
    (project.path / "job/film.json").write_text(json.dumps(changed))
    tasks = compiled(project.path / "job/film.json")

    plan_file = project.path / "job/film.json.plan.json"
    plan, asked = Plan.thaw(plan_file), []
    for place, task in enumerate(tasks):
        assert task["type"] == "misc" and all(0 <= other < place for other in task["dependencies"])
        (command,) = task["commands"]
        assert command["name"] == "exec" and command["parameters"]["exe"] == "flowsculpt"
        begin = ["task", str(plan_file), "--root", str(project.path / "out"), "--store", "s3://bucket/show"]
        words = command["parameters"]["args"]
        assert words[:6] == begin
        asked.append(list(_jobs(plan, plan_file, words[6:], None)))
    names = [task["name"].partition(" ")[0] for task in tasks]
    assert names == ["Surfaces", "Render", "Render", "Finish", "Finish", "Assemble", "Film"]
    waits = [task["dependencies"] for task in tasks]
    assert waits[1] == [0] and waits[3] == waits[4] == [1, 2] and waits[5] == waits[6] == [3, 4]
    frames = [frame for job in asked[1] + asked[2] for frame in plan.job(job).frames]
    rendered = sorted({frame for each in plan.jobs if each.stage == "render" for frame in each.frames})
    assert frames == rendered and len(frames) > 4
    whole = {name for names in (asked[0], *asked[5:]) for name in names}
    assert whole == {each.name for each in plan.jobs if each.stage not in ("render", "finish")}


@pytest.mark.soak
def test_the_tasks_of_a_job_make_the_film(project: ProjectFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project.path)
    assert project.call("--root", "out", "export", "flamenco", "film", "-q", QUALITY).code == 0
    for task in compiled(project.path / "flamenco.json"):
        ran = project.run(*task["commands"][0]["parameters"]["args"])
        assert ran.code == 0, ran.err
    assert (project.path / "out/renders/film" / QUALITY / "film.mp4").exists()
    assert Project(project.path / "out", 2).pictures([NAME], QUALITY).jobs == ()


def test_a_chunk_of_fewer_frames_than_none_is_refused(project: ProjectFolder) -> None:
    assert project.call("export", "flamenco", NAME, "-q", QUALITY).code == 0
    file = project.path / "flamenco.json"
    assert [task["name"] for task in compiled(file)] == [
        f"Surfaces {NAME}",
        f"Render {NAME} 1 to 6",
        f"Finish {NAME} 1 to 6",
        f"Assemble {NAME}",
    ]
    job = json.loads(file.read_text())
    file.write_text(json.dumps({**job, "settings": {**job["settings"], "chunk_size": -1}}))
    with pytest.raises(AssertionError, match="chunk_size is -1; it must be at least 1"):
        compiled(file)
