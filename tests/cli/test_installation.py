"""The wheel in an environment of its own, outside of any checkout, and beside packages of others."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest

from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Environment:
    """A virtual environment with the wheel installed."""

    folder: Path

    @property
    def packages(self) -> Path:
        return next((self.folder / "lib").glob("python*/site-packages"))

    def run(self, *words: str | Path, cwd: Path, code: int = 0, path: str = "") -> str:
        command = [self.folder / "bin" / "flowsculpt", *words]
        done = subprocess.run(command, cwd=cwd, env=env(path), capture_output=True, text=True, timeout=600)
        assert done.returncode == code and "Traceback" not in done.stderr, (words, done.stdout, done.stderr)
        return done.stdout + done.stderr


def env(path: str = "") -> dict[str, str]:
    """The variables of this process with another search path of Python."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | {"PYTHONPATH": path}


def pip(*words: str | Path) -> None:
    subprocess.run([sys.executable, "-m", "pip", "--quiet", *words], env=env(), check=True, timeout=600)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, ROOT)
    return next(folder.glob("flowsculpt-*.whl"))


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Environment:
    """An environment whose other packages are links to those of this one, in one folder, as pip has it."""
    made = Environment(tmp_path_factory.mktemp("environment"))
    venv.create(made.folder, with_pip=False)
    for package in Path(sysconfig.get_path("purelib")).iterdir():
        if "flowsculpt" not in package.name:
            (made.packages / package.name).symlink_to(package)
    pip("--python", made.folder, "install", "--no-deps", wheel)
    return made


def test_the_wheel_begins_and_checks_a_show_outside_of_any_checkout(environment, tmp_path):
    environment.run("new", "--show", "show", cwd=tmp_path)
    assert "A010_first" in environment.run("validate", "A010_first", cwd=tmp_path / "show")


def test_the_wheel_adds_one_name_to_those_that_python_can_import(wheel):
    with zipfile.ZipFile(wheel) as file:
        tops = {name.partition("/")[0] for name in file.namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"flowsculpt"}


def test_packages_of_others_that_are_called_pipeline_and_render_stay_theirs(environment, tmp_path):
    for package in ("pipeline", "render"):
        (environment.packages / package).mkdir()
        (environment.packages / package / "__init__.py").write_text(f"OWNER = 'the other {package}'\n")
    environment.run("new", "--show", "show", cwd=tmp_path)
    assert "A010_first" in environment.run("validate", "A010_first", cwd=tmp_path / "show")
    code = "import flowsculpt.pipeline, pipeline, render; print(pipeline.OWNER, render.OWNER)"
    words = [environment.folder / "bin" / "python", "-c", code]
    done = subprocess.run(words, cwd=tmp_path, env=env(), capture_output=True, text=True, check=True)
    assert done.stdout == "the other pipeline the other render\n"


def test_set_up_says_at_once_which_pythons_it_supports(tmp_path):
    for name in ("Makefile", "pyproject.toml", "requirements-pip.lock", "requirements.lock"):
        shutil.copy(ROOT / name, tmp_path)
    newer = tmp_path / "python3.14"
    program = "import sys; sys.version_info = (3, 14, 0); ${2#import sys; }"
    newer.write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "{program}"\n')
    newer.chmod(0o755)
    words = ["make", "--no-print-directory", f"PYTHON={newer}", "setup"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    told = done.stderr.splitlines()[0]
    assert done.returncode != 0 and told.startswith(
        "flowsculpt's lock supports Python 3.11, 3.12 and 3.13, and"
    )
    assert "make PYTHON=python3.12" in told and not (tmp_path / ".venv").exists()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["requires-python"] == ">=3.11,<3.14"


@pytest.mark.soak
def test_the_wheel_and_its_locked_packages_render_in_an_empty_environment(wheel, tmp_path):
    made = Environment(tmp_path / "environment")
    venv.create(made.folder, with_pip=True)
    pip("--python", made.folder, "install", "--require-hashes", "-r", ROOT / "requirements.lock")
    pip("--python", made.folder, "install", "--no-deps", wheel)
    write_mesh(icosphere(6), tmp_path / "ball.obj")
    made.run("new", "--show", "show", cwd=tmp_path)
    show = tmp_path / "show"
    made.run("render", "A010_first", "-f", "1-3", cwd=show)
    made.run("turntable", "../ball.obj", "--frames", "4", cwd=show)
    made.run("review", "A010_first", cwd=show)
    assert (show / "renders/A010_first/draft/frames/A010_first.0003.exr").is_file()
    assert [*(show / "renders/turntable").rglob("*.mp4")]
    assert [*(show / "renders/review").rglob("index.html")]
