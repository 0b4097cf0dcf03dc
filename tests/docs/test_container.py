"""The Dockerfile: its steps work in a clean checkout, and what it makes renders for any user."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.needed_plugins import needs_plugins

ROOT = Path(__file__).parents[2]
HOME = "/opt/flowsculpt"


def instructions() -> list[tuple[str, str]]:
    """The instructions of the Dockerfile, each with its words, in order."""
    text = re.sub(r"^#.*\n", "", (ROOT / "Dockerfile").read_text(), flags=re.MULTILINE).replace("\\\n", "")
    return [(line.split()[0], line.partition(" ")[2]) for line in text.splitlines() if line]


def test_the_container_is_the_system_that_the_tests_run_on() -> None:
    steps = instructions()
    assert steps[0] == ("FROM", "debian:bookworm-slim")
    (packages,) = [words for name, words in steps if name == "RUN" and "apt-get install" in words]
    assert {"make", "python3", "python3-venv"} <= set(packages.split())
    ignored = set((ROOT / ".dockerignore").read_text().split())
    assert {".git", ".venv", "renders", ".flowsculpt"} <= ignored


def test_the_container_runs_as_a_user_whose_number_clusters_can_check_and_nobody_writes_its_kernels() -> None:
    (user,) = [words for name, words in instructions() if name == "USER"]
    assert re.fullmatch("[1-9][0-9]*:[1-9][0-9]*", user)
    assert not [words for _, words in instructions() if re.search("a[+]rwX|777 \\$XDG_CACHE_HOME ", words)]


@needs_plugins("authoring")
@pytest.mark.soak
def test_the_steps_of_the_container_make_a_flowsculpt_that_renders(tmp_path: Path) -> None:
    """Steps run in a clone in place of /opt/flowsculpt; the packages of the system are those of this one."""
    clone = tmp_path / "flowsculpt"
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    for name, words in instructions():
        words = words.replace(HOME, str(clone))
        if name == "COPY":
            subprocess.run(["git", "clone", "--quiet", ROOT, clone], check=True)
        elif name == "ENV":
            variable, _, value = words.partition("=")
            variables[variable] = value.replace("$PATH", variables["PATH"])
        elif name == "RUN" and "apt-get" not in words:
            done, *_ = words.partition(" && rm ")  # caches that are this machine's
            subprocess.run(done, shell=True, env=variables, check=True, timeout=1800)
    command = shutil.which("flowsculpt", path=variables["PATH"])
    assert command == str(clone / ".venv/bin/flowsculpt")
    for words in (["new", "--show", "."], ["render", "A010_first", "-f", "1-2"]):
        subprocess.run([command, *words], cwd=tmp_path, env=variables, check=True, timeout=600)
    assert (tmp_path / "renders/A010_first/draft/frames/A010_first.0002.exr").is_file()
