"""Example profiles of PBS, Grid Engine, LSF and HTCondor, with a stand-in for the programs that submit jobs.

It takes the words of its program, runs the job's script on this machine, and answers as the program does.
"""

import json
import os
import re
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from flowsculpt.render.mitsuba.engine import works

NAME = "T010_tiny"
QUALITY = "draft.scale10"

SUBMIT = """\
#!{python}
import json, os, subprocess, sys, pathlib
home = pathlib.Path({home!r})
files = [word.rpartition("=")[2] for word in sys.argv[1:]]
script = [file for file in files if os.path.isfile(file)][-1]  # /dev/null is none
number = len(list(home.glob("*.json"))) + 1
(home / f"{{number}}.json").write_text(json.dumps(sys.argv[1:]))
subprocess.Popen(["sh", script], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                 start_new_session=True)
print({answer!r}.format(number))
"""

CLUSTERS = {
    "pbs": ("qsub", "{}.server", ["select=1:ncpus=1:mem=4096mb", "walltime=240:00"]),
    "sge": ("qsub", "{}", ["-pe", "smp", "mem_free=4096M", "h_rt=0:240:0"]),
    "lsf": (
        "bsub",
        "Job <{}> is submitted to default queue <normal>.",
        ["-n", "1", "-M", "4096MB", "-W", "240"],
    ),
    "htcondor": ("condor_submit", "{0}.0 - {0}.0", ["request_cpus=1", "request_memory=4096"]),
}
"""By profile: the program that submits, its answer, and words that it must be given."""


def write_profile(folder: Path, name: str, **config: str) -> None:
    """Write the example of docs/farm.md to profiles/NAME of a folder, for a cluster that answers fast."""
    page = (Path(__file__).parents[3] / "docs" / "farm.md").read_text(encoding="utf-8")
    example = r"^```yaml\n# profiles/(\w+)/profile[^\n]*, for [^\n]*\n(.*?)^```"
    blocks = dict(re.findall(example, page, re.MULTILINE | re.DOTALL))
    yaml = YAML(typ="safe")
    profile = {**yaml.load(blocks["pbs"]), **yaml.load(blocks[name])}
    profile |= {"config": {**profile["config"], "threads": 1, **config}, "latency-wait": 5}
    (folder / "profiles" / name).mkdir(parents=True, exist_ok=True)
    (folder / "profiles" / name / "profile.yaml").write_text(json.dumps(profile))


@pytest.fixture
def cluster(project, request, tmp_path_factory, monkeypatch):
    """The name of a cluster whose stand-in is on the path, and the folder where it notes its jobs."""
    program, answer, _ = CLUSTERS[request.param]
    home = tmp_path_factory.mktemp(request.param)
    stand_in = home / program
    stand_in.write_text(SUBMIT.format(python=sys.executable, home=str(home), answer=answer))
    stand_in.chmod(0o755)
    monkeypatch.setenv("PATH", f"{home}{os.pathsep}{os.environ['PATH']}")
    write_profile(project.path, request.param)
    return request.param, home


QUICK = [name if name == "lsf" else pytest.param(name, marks=pytest.mark.soak) for name in CLUSTERS]


@pytest.mark.parametrize("cluster", QUICK, indirect=True)
def test_a_simulation_is_given_to_the_cluster_with_cores_memory_and_time(project, cluster):
    name, home = cluster
    root = "My {x} films [b] & ü"
    (project.path / root).mkdir()
    (project.path / root / "random.py").write_text("raise SystemExit('a module of the show ran')")
    words = "--json", "--root", root, "simulate", NAME, "-f", "1-2"
    done = project.run(*words, "--profile", name)
    assert done.code == 0, done.err
    assert json.loads(done.out)["made"] == {"simulate": 2}
    (submitted,) = [json.loads(file.read_text()) for file in home.glob("*.json")]
    told = " ".join(submitted)
    assert [word for word in CLUSTERS[name][2] if word not in told] == []


@pytest.mark.soak
@pytest.mark.parametrize("cluster", ["lsf"], indirect=True)
def test_nodes_without_the_variant_of_their_profile_end_the_run_with_one_message(project, cluster):
    if works("cuda_ad_rgb"):
        pytest.skip("this machine has a GPU")
    write_profile(project.path, "lsf", variant="cuda_ad_rgb")
    done = project.run("render", NAME, "-q", QUALITY, "--profile", "lsf")
    assert done.code == 4 and done.err.count("cannot render with cuda_ad_rgb") == 1


@pytest.mark.soak
@pytest.mark.parametrize("cluster", [*CLUSTERS], indirect=True)
def test_frames_of_a_cluster_are_those_of_this_machine(project, cluster):
    name, _ = cluster
    for root, profile in (("far", name), ("near", "local")):
        done = project.run("--root", root, "render", NAME, "-q", QUALITY, "--profile", profile)
        assert done.code == 0, done.err
    far, near = (sorted((project.path / root).rglob("frames/*.exr")) for root in ("far", "near"))
    assert [one.read_bytes() for one in far] == [other.read_bytes() for other in near] and len(far) == 6
