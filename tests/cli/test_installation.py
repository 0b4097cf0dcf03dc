"""The wheel in an environment of its own, outside of any checkout, and beside packages of others."""

from __future__ import annotations

import filecmp
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
from tests.mesh_files import write_ply
from tests.needed_plugins import needed_by, needed_by_gallery, needs_plugins

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
    """An environment whose other packages are links to those of this one, in one folder, as pip has it.

    Packages of others in it are called as folders of a checkout are.
    """
    made = Environment(tmp_path_factory.mktemp("environment"))
    venv.create(made.folder, with_pip=False)
    for package in Path(sysconfig.get_path("purelib")).iterdir():
        if "flowsculpt" not in package.name:
            (made.packages / package.name).symlink_to(package)
    for package in ("pipeline", "render"):
        (made.packages / package).mkdir()
        (made.packages / package / "__init__.py").write_text(f"OWNER = 'the other {package}'\n")
    pip("--python", made.folder, "install", "--no-deps", wheel)
    return made


@needs_plugins("authoring")
def test_the_wheel_begins_and_checks_a_show_outside_of_any_checkout(environment, tmp_path):
    environment.run("new", "--show", "show", cwd=tmp_path)
    assert "A010_first" in environment.run("validate", "A010_first", cwd=tmp_path / "show")


@needs_plugins("authoring", *needed_by_gallery())
def test_the_wheel_brings_the_gallery(environment, tmp_path):
    environment.run("new", "--show", "my", "--gallery", cwd=tmp_path)
    gallery, shots = ROOT / "shots", tmp_path / "my/shots"
    names = [
        file.relative_to(gallery)
        for file in gallery.rglob("[!.]*.*")
        if file.parent.name[0] != "." and file.parent.name != "takes"
    ]
    assert len(names) > 20 and filecmp.cmpfiles(gallery, shots, names, shallow=False) == (names, [], [])
    film = "title: Short\nsound: {file: film_music.opus}\nshots: [{shot: B200_walker, frames: 1-2}]\n"
    (shots / "short.yaml").write_text(film)
    planned = environment.run("--dry-run", "film", "short", cwd=tmp_path / "my")
    assert "encoding the film" in planned, "it has read a shot, its model and music"


@needs_plugins("authoring", *needed_by(ROOT / "shots/B200_walker.yaml"))
def test_a_show_around_the_environment_gets_copies_of_models_in_it(environment):
    environment.run("new", "A040", "--from", "B200_walker", cwd=environment.folder)
    shots = environment.folder / "shots"
    assert (shots / "models/B200_walker.glb").is_file()
    text = (shots / "A040.yaml").read_text()
    assert "sequence: models/B200_walker.glb" in text and "title: Walker" not in text
    shutil.rmtree(shots)


def test_the_wheel_has_all_modules_and_adds_one_name_to_those_that_python_can_import(wheel):
    with zipfile.ZipFile(wheel) as file:
        names = set(file.namelist())
    assert {top for name in names if not (top := name.split("/")[0]).endswith(".dist-info")} == {"flowsculpt"}
    modules = [file for folder in ("pipeline", "render") for file in (ROOT / folder).rglob("*.py")]
    assert {f"flowsculpt/{file.relative_to(ROOT).as_posix()}" for file in modules} <= names


def test_packages_of_others_that_are_called_pipeline_and_render_stay_theirs(environment, tmp_path):
    """All commands of these tests run beside them."""
    code = "import flowsculpt.pipeline, pipeline, render; print(pipeline.OWNER, render.OWNER)"
    words = [environment.folder / "bin" / "python", "-c", code]
    done = subprocess.run(words, cwd=tmp_path, env=env(), capture_output=True, text=True, check=True)
    assert done.stdout == "the other pipeline the other render\n"


def interpreter(path: Path, version: str) -> Path:
    """A Python of the tests, which calls itself another version."""
    number = tuple(map(int, version.split(".")))
    program = f"import sys; sys.version_info = {number}; ${{2#import sys; }}"
    told = f"if [ $1 = -V ]; then echo Python {version}; exit; fi"
    path.write_text(f'#!/bin/sh\n{told}\nexec "{sys.executable}" -c "{program}"\n')
    path.chmod(0o755)
    return path


def make(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run make on a copy of the project's Makefile."""
    for name in ("Makefile", "pyproject.toml", "requirements-pip.lock", "requirements.lock"):
        shutil.copy(ROOT / name, cwd)
    command = ["make", "--no-print-directory", *words]
    variables = {name: value for name, value in os.environ.items() if name != "PYTHON"}
    return subprocess.run(command, cwd=cwd, env=variables, capture_output=True, text=True, timeout=300)


def test_set_up_says_at_once_which_pythons_it_supports(tmp_path):
    newer = interpreter(tmp_path / "python3.14", "3.14.0")
    done = make(f"PYTHON={newer}", "setup", cwd=tmp_path)
    told = done.stderr.splitlines()[0]
    assert done.returncode != 0 and told.startswith(
        "flowsculpt's lock supports Python 3.11, 3.12 and 3.13, and"
    )
    assert "for 3.14, immutables, which Snakemake needs, and opentimelineio have no wheels" in told
    assert "make PYTHON=python3.12" in told and not (tmp_path / ".venv").exists()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["requires-python"] == ">=3.11,<3.14"


@pytest.mark.parametrize(
    ("there", "asked", "fact"),
    [
        ("3.11.7", "3.13.0", ".venv has Python 3.11.7, and ./asked is Python 3.13.0; "),
        ("3.13.0", "3.1.3", ".venv has Python 3.13.0, and ./asked is Python 3.1.3; "),
        ("3.12.1", "", ".venv has Python 3.12.1, and ./asked is no Python; "),
        ("", "3.12.1", ".venv has a Python that is gone, and ./asked is Python 3.12.1; "),
        ("3.12.1", "3.12.9", ""),
    ],
)
def test_make_refuses_another_python_than_that_of_the_environment(tmp_path, there, asked, fact):
    (tmp_path / ".venv/bin").mkdir(parents=True)
    (tmp_path / ".venv/bin/python").symlink_to(tmp_path / "there")
    for name, version in (("there", there), ("asked", asked)):
        if version:
            interpreter(tmp_path / name, version)
    done = make("PYTHON=./asked", "same-python", cwd=tmp_path)
    assert (done.returncode != 0) == bool(fact) and done.stderr.startswith(fact)
    assert not fact or "to set up another, remove it: rm -r .venv" in done.stderr


def test_an_environment_keeps_its_python_where_make_is_given_none(tmp_path):
    (tmp_path / ".venv/bin").mkdir(parents=True)
    (tmp_path / ".venv/bin/python").symlink_to(interpreter(tmp_path / "there", "3.1.0"))
    assert "and .venv/bin/python is none of them" in make("setup", cwd=tmp_path).stderr
    (tmp_path / "there").unlink()
    assert make("setup", cwd=tmp_path).stderr.startswith(".venv has a Python that is gone, and python3 is ")


@needs_plugins("authoring", "review", "turntable")
@pytest.mark.soak
def test_the_wheel_and_its_locked_packages_render_in_an_empty_environment(wheel, tmp_path):
    made = Environment(tmp_path / "environment")
    venv.create(made.folder, with_pip=True)
    pip("--python", made.folder, "install", "--require-hashes", "-r", ROOT / "requirements.lock")
    pip("--python", made.folder, "install", "--no-deps", wheel)
    write_ply(icosphere(6), tmp_path / "ball.ply")
    made.run("new", "--show", "show", cwd=tmp_path)
    show = tmp_path / "show"
    made.run("render", "A010_first", "-f", "1-3", cwd=show)
    made.run("turntable", "../ball.ply", "--frames", "4", cwd=show)
    made.run("review", "A010_first", cwd=show)
    assert (show / "renders/A010_first/draft/frames/A010_first.0003.exr").is_file()
    assert [*(show / "renders/turntable").rglob("*.mp4")]
    assert [*(show / "renders/review").rglob("index.html")]


@needs_plugins("authoring")
@pytest.mark.soak
@pytest.mark.parametrize("installer", ["uv", "pipx"])
def test_a_film_can_be_made_from_an_empty_folder_with(installer, wheel, tmp_path):
    """As docs/your-show.md says, with the newest packages that the wheel allows."""
    tools = tmp_path / "tools"
    venv.create(tools, with_pip=True)
    pip("--python", tools, "install", installer)
    own = {"UV_TOOL_DIR": "uv", "UV_TOOL_BIN_DIR": "bin", "PIPX_HOME": "pipx", "PIPX_BIN_DIR": "bin"}
    variables = env() | {name: str(tmp_path / folder) for name, folder in own.items()}

    def run(*words: str | Path, cwd: Path = tmp_path) -> None:
        done = subprocess.run(words, cwd=cwd, env=variables, capture_output=True, text=True, timeout=1200)
        assert done.returncode == 0 and "Traceback" not in done.stderr, (words, done.stdout, done.stderr)

    words = (
        ["uv", "tool", "install", "--python", sys.executable] if installer == "uv" else ["pipx", "install"]
    )
    run(tools / "bin" / words[0], *words[1:], f"{wheel}[film]")
    command, show = tmp_path / "bin/flowsculpt", tmp_path / "my"
    run(command, "new", "--show", "my", "--gallery")
    run(command, "render", "A010_cube", "-f", "1-2", cwd=show)
    text = "title: Short\nsound: {file: film_music.opus}\nshots: [{shot: A010_cube, frames: 2-3}]\n"
    (show / "shots/short.yaml").write_text(text)
    run(command, "film", "short", cwd=show)
    assert (show / "renders/A010_cube/draft/frames/A010_cube.0002.exr").is_file()
    assert (show / "renders/film/draft/short.mp4").is_file()


@pytest.mark.soak
def test_the_wheel_passes_what_the_index_checks(wheel, tmp_path):
    venv.create(tmp_path / "tools", with_pip=True)
    pip("--python", tmp_path / "tools", "install", "twine", "check-wheel-contents")
    for words in (["twine", "check", "--strict"], ["check-wheel-contents"]):
        command = [tmp_path / "tools" / "bin" / words[0], *words[1:], wheel]
        done = subprocess.run(command, env=env(), capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.soak
def test_the_library_alone_takes_a_quarter_of_a_gigabyte(wheel, tmp_path):
    """As uv installs it: pip adds 30 MB of compiled Python. Its packages are all but 8 MB of it."""
    tools, library = tmp_path / "tools", tmp_path / "library"
    venv.create(tools, with_pip=True)
    pip("--python", tools, "install", "uv")
    for words in (["venv", library], ["pip", "install", wheel]):
        command = [tools / "bin/uv", *words, "--quiet", "--python"]
        python = library if "pip" in words else sys.executable
        subprocess.run([*command, python], env=env(), check=True, timeout=600)
    code = "from flowsculpt import Resampler, Thresholds, icosphere\n"
    code += "print(Resampler(icosphere(8), Thresholds(0.1)).resample().vertices)"
    words = [library / "bin" / "python", "-B", "-c", code]
    done = subprocess.run(words, cwd=tmp_path, env=env(), capture_output=True, text=True, check=True)
    size = sum(file.stat().st_size for file in library.rglob("*") if not file.is_symlink() and file.is_file())
    assert int(done.stdout) > 642 and size <= 250 * 2**20
