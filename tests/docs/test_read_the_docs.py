"""Read the Docs can build the site: it knows every key of its file, whose commands need nothing else."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[2]
CONFIG: dict[str, Any] = YAML(typ="safe").load((ROOT / ".readthedocs.yaml").read_text())
JOBS: dict[str, Any] = CONFIG["build"]["jobs"]

# https://docs.readthedocs.io/en/stable/config-file/v2.html, which says that any other key fails the build
KEYS = {
    "": {"version", "formats", "conda", "build", "python", "sphinx", "mkdocs", "submodules", "search"},
    "build": {"os", "tools", "jobs", "apt_packages", "commands"},
    "build.tools": {"python", "nodejs", "ruby", "rust", "golang"},
    "build.jobs": {
        *("post_checkout", "pre_system_dependencies", "post_system_dependencies", "pre_create_environment"),
        *("create_environment", "post_create_environment", "pre_install", "install", "post_install"),
        *("pre_build", "build", "post_build"),
    },
    "build.jobs.build": {"html", "htmlzip", "pdf", "epub"},
    "sphinx": {"configuration", "builder", "fail_on_warning"},
}


def mappings(value: dict[str, Any], path: str = "") -> dict[str, dict[str, Any]]:
    """Return all mappings of a document by their dotted paths."""
    inner = {f"{path}.{key}".strip("."): part for key, part in value.items() if isinstance(part, dict)}
    return {path: value} | {
        name: each for key, part in inner.items() for name, each in mappings(part, key).items()
    }


@pytest.mark.parametrize("path", mappings(CONFIG))
def test_read_the_docs_knows_every_key_of_its_file(path: str) -> None:
    assert set(mappings(CONFIG)[path]) <= KEYS[path]


def test_read_the_docs_knows_the_system_and_the_python_of_its_file() -> None:
    assert CONFIG["version"] == 2
    assert CONFIG["build"]["os"] in ("ubuntu-22.04", "ubuntu-24.04", "ubuntu-lts-latest")
    python = CONFIG["build"]["tools"]["python"]
    assert isinstance(python, str), "3.10 without quotes is the number 3.1"
    classifiers = (ROOT / "pyproject.toml").read_text()
    assert f'"Programming Language :: Python :: {python}"' in classifiers
    assert (ROOT / CONFIG["sphinx"]["configuration"]).is_file()


def test_read_the_docs_builds_as_make_docs_does() -> None:
    recipe = re.search(r"^docs:.*\n\t\$\(BIN\)/(.+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert recipe is not None
    *command, output = recipe[1].split()
    assert output == "docs/site"
    assert JOBS["build"]["html"] == [" ".join([*command, '"$READTHEDOCS_OUTPUT/html"'])]


@pytest.mark.soak
def test_the_commands_of_read_the_docs_build_the_site_in_an_empty_environment(tmp_path: Path) -> None:
    venv.create(tmp_path / "venv", with_pip=True)
    search = os.pathsep.join([str(tmp_path / "venv" / "bin"), os.environ["PATH"]])
    surroundings = {**os.environ, "PATH": search, "READTHEDOCS_OUTPUT": str(tmp_path / "out")}
    surroundings.pop("PYTHONPATH", None)
    for command in [*JOBS["install"], *JOBS["build"]["html"]]:
        done = subprocess.run(
            ["bash", "-c", command], cwd=ROOT, env=surroundings, capture_output=True, text=True, timeout=1200
        )
        assert done.returncode == 0, (command, done.stdout + done.stderr)
    assert "flowsculpt.Resampler" in (tmp_path / "out" / "html" / "api.html").read_text()
    packages = (
        tmp_path / "venv" / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}" / "site-packages"
    )
    assert not any((packages / name).exists() for name in ("mitsuba", "snakemake")), "it needs no renderer"
