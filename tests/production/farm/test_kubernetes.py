"""Manifests for Kubernetes: valid by the schemas of its API, and done by a stand-in for kubectl.

The stand-in runs each pod's command on this machine, in an empty folder and with the pod's environment.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
from ruamel.yaml import YAML

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.farm.kubernetes import KubernetesJob
from flowsculpt.pipeline.production.execution.project import Project
from tests.conftest import commanded

NAME = "T010_tiny"
QUALITY = "draft.scale10"

VERSION = "1.33"

KUBECTL = """\
#!{python}
import json, os, pathlib, subprocess, sys, tempfile
from ruamel.yaml import YAML
home = pathlib.Path({home!r})

def run(job):
    spec = job["spec"]["template"]["spec"]
    (container,) = spec["containers"]
    ended = []
    for index in range(job["spec"]["completions"]):
        environment = {{**os.environ, **{{entry["name"]: entry["value"] for entry in container["env"]}}}}
        command = [word.replace("/plan/", f"{{home}}/") for word in container["command"]]
        with tempfile.TemporaryDirectory(dir=home) as folder:
            environment["JOB_COMPLETION_INDEX"] = str(index)
            ended.append(subprocess.run(command, cwd=folder, env=environment).returncode)
    state = {{"labels": job["metadata"]["labels"], "state": "Failed" if any(ended) else "Complete"}}
    (home / (job["metadata"]["name"] + ".job")).write_text(json.dumps(state))

verb, rest = sys.argv[1], sys.argv[2:]
if verb == "apply":
    for part in YAML(typ="safe").load_all(pathlib.Path(rest[rest.index("-f") + 1]).read_text()):
        if part["kind"] == "ConfigMap":
            for name, text in part["data"].items():
                (home / name).write_text(text)
        elif not (home / (part["metadata"]["name"] + ".job")).exists():
            run(part)
elif verb == "get":
    asked = dict(word.split("=") for word in rest[rest.index("-l") + 1].split(","))
    for file in home.glob("*.job"):
        job = json.loads(file.read_text())
        if asked.items() <= job["labels"].items():
            print(file.stem, "SuccessCriteriaMet " * (job["state"] == "Complete") + job["state"])
"""


@pytest.fixture
def cluster(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a stand-in for kubectl that is on the path."""
    home = tmp_path_factory.mktemp("cluster")
    (home / "bin").mkdir()
    kubectl = home / "bin" / "kubectl"
    kubectl.write_text(KUBECTL.format(python=sys.executable, home=str(home)))
    kubectl.chmod(0o755)
    programs = [str(home / "bin"), str(Path(sys.executable).parent), os.environ["PATH"]]
    monkeypatch.setenv("PATH", os.pathsep.join(programs))
    return home


def export(project: Any, *words: str, code: int = 0) -> str:
    done = project.run("export", "kubernetes", *words, "-q", QUALITY, "--image", "flowsculpt:1")
    assert done.code == code, done.err
    return done.out + done.err


def job_of(project: Any, *names: str, variant: str | None = None) -> KubernetesJob:
    plan = Project(project.path, 2, variant).whole(names, QUALITY)
    return KubernetesJob(plan, "flowsculpt:1", "s3://bucket/show", threads=4, side_by_side=2)


def test_every_object_is_valid_by_the_schemas_of_kubernetes(project, monkeypatch):
    monkeypatch.chdir(project.path)
    (project.path / "shots" / "A_B.yaml").write_text(project.shot.read_text().replace("1-6", "1-40"))
    files = job_of(project, NAME, "A_B", "film", variant="cuda_ad_rgb").manifests()
    assert list(files) == [
        "0-plan.yaml",
        "1-surfaces.yaml",
        "2-render.yaml",
        "3-finish.yaml",
        "4-assemble-film.yaml",
    ]
    for described in (part for parts in files.values() for part in parts):
        kubernetes_validate.validate(described, VERSION, strict=True)
    names = [part["metadata"]["name"] for parts in files.values() for part in parts]
    assert len(names) == len(set(names)) and max(map(len, names)) < 60


def test_pods_ask_for_cores_memory_a_gpu_and_a_time_limit_and_no_rights_and_share_out_the_frames(
    project, monkeypatch
):
    monkeypatch.chdir(project.path)
    project.shot.write_text(project.shot.read_text().replace("1-6", "1-20"))
    files = job_of(project, NAME, variant="cuda_ad_rgb").manifests()
    (render,), (finish,) = files["2-render.yaml"], files["3-finish.yaml"]
    assert (render["spec"]["completions"], render["spec"]["parallelism"]) == (3, 2)
    pod = render["spec"]["template"]["spec"]
    assert pod["containers"][0]["resources"] == {
        "requests": {"cpu": "4", "memory": "4096Mi"},
        "limits": {"memory": "4096Mi", "nvidia.com/gpu": "1"},
    }
    assert pod["activeDeadlineSeconds"] >= 3600
    assert pod["securityContext"] == {"runAsNonRoot": True, "seccompProfile": {"type": "RuntimeDefault"}}
    rights = pod["containers"][0]["securityContext"]
    assert rights == {"allowPrivilegeEscalation": False, "capabilities": {"drop": ["ALL"]}}
    limits = finish["spec"]["template"]["spec"]["containers"][0]["resources"]["limits"]
    assert "nvidia.com/gpu" not in limits


def test_the_same_shot_has_the_same_objects_and_an_edited_one_others_for_they_cannot_be_changed(
    project, monkeypatch
):
    monkeypatch.chdir(project.path)
    before = job_of(project, NAME)
    later = replace(before, plan=replace(before.plan, name="20990101-000000-1", host="another"))
    assert later.manifests() == before.manifests() and later.script() == before.script()
    project.shot.write_text(project.shot.read_text().replace("azimuth: -30", "azimuth: 30"))
    names, others = (
        {part["metadata"]["name"] for parts in job.manifests().values() for part in parts}
        for job in (before, job_of(project, NAME))
    )
    assert not names & others


@pytest.mark.parametrize("address", [None, "file:///mnt/share"])
def test_without_a_store_that_pods_reach_the_message_says_so(project, monkeypatch, address):
    monkeypatch.chdir(project.path)
    plan = Project(project.path, 2).whole([NAME], QUALITY)
    with pytest.raises(UsageError, match="name one by --store s3://BUCKET/PREFIX"):
        KubernetesJob(plan, "flowsculpt:1", address, threads=4, side_by_side=2)


def test_without_an_image_nothing_is_written(project, monkeypatch):
    monkeypatch.chdir(project.path)
    code, said = commanded(project.path, "export", "kubernetes", NAME)
    assert code == 2 and "needs the container image of its pods: --image NAME" in said
    assert not (project.path / "kubernetes").exists()


@pytest.mark.soak
def test_the_script_makes_a_film_in_pods_that_share_nothing_but_the_store(project, store, cluster):
    export(project, "film", "--store", store)
    for file in (project.path / "kubernetes").glob("*.yaml"):
        for described in YAML(typ="safe").load_all(file.read_text()):
            kubernetes_validate.validate(described, VERSION, strict=True)
    script = project.path / "kubernetes" / "run.sh"
    done = subprocess.run(["sh", str(script)], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    fetched = project.run("film", "-q", QUALITY, "--store", store)
    assert fetched.code == 0 and "Nothing to be done" in fetched.out, fetched.out + fetched.err
    near = project.run("--root", "near", "film", "-q", QUALITY)
    assert near.code == 0, near.err
    films = [project.path / root / "renders/film" / QUALITY / "film.mp4" for root in (".", "near")]
    assert films[0].read_bytes() == films[1].read_bytes()


@pytest.mark.soak
def test_the_script_stops_at_a_job_that_failed_and_names_it(project, store, cluster):
    export(project, NAME, "--store", store.replace("films", "no-such-bucket"))
    script = project.path / "kubernetes" / "run.sh"
    done = subprocess.run(["sh", str(script)], capture_output=True, text=True, timeout=600)
    assert done.returncode == 1 and "flowsculpt-surfaces-t010-tiny" in done.stderr
    assert "Files after 1-surfaces.yaml were not started" in done.stderr
