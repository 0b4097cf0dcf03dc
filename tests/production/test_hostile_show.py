"""A show is data: whatever lies in its folder, nothing of it runs.

People get shows from each other. A show here holds a module under every name that Python may import, native
plugins of the renderer, and settings of the libraries in use; each module leaves a trace where it runs.
"""

from __future__ import annotations

import os
import pkgutil
import sys
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.versions.hooks import user_environment
from flowsculpt.pipeline.production.execution.snakemake import DEPLOYMENTS, running
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.planning.profile import Profile
from flowsculpt.render.base import python_process
from tests.conftest import QUALITY, ProjectFolder
from tests.needed_plugins import installed
from tests.production.farm.test_clusters import write_profile

PACKAGES = [*Path(python_process.PACKAGE_ROOT, "pipeline").rglob("*.py")]
PACKAGES += [*Path(python_process.PACKAGE_ROOT, "render").rglob("*.py")]

NEVER_INSTALLED = {
    "sitecustomize",
    "usercustomize",
    "cuda",
    "snakemake_executor_plugin_of_the_show",
    "snakemake_logger_plugin_of_the_show",
}
"""Modules that Python, numba and Snakemake import where they find them."""

TRACE = """\
import os
with open({trace!r}, "a") as file:
    print(__file__, file=file)
"""


@pytest.fixture
def hostile(project: ProjectFolder) -> ProjectFolder:
    """A project whose folder brings code along, under every name; `trace` in it lists what has run."""
    installed = {module.name for module in pkgutil.iter_modules()}
    code = TRACE.format(trace=str(project.path / "trace"))
    for folder in (project.path, project.path / DEPLOYMENTS):
        folder.mkdir(parents=True, exist_ok=True)
        for name in (sys.stdlib_module_names | installed | NEVER_INSTALLED) - {"shots"}:
            (folder / f"{name}.py").write_text(code)
    (project.path / "plugins").mkdir()
    mitsuba = next(Path(entry, "mitsuba") for entry in sys.path if Path(entry, "mitsuba").is_dir())
    for plugin in (mitsuba / "plugins").glob("*.so"):
        (project.path / "plugins" / plugin.name).write_text("no library: loading it fails")
    (project.path / ".snakemake/iocache").mkdir()
    call = b"cbuiltins\nexec\n(V" + code.replace("\n", "\\u000a").encode() + b"\ntR."
    (project.path / ".snakemake/iocache/latest.pkl").write_bytes(call)
    (project.path / ".numba_config.yaml").write_text("disable_jit: 1\ncache_dir: numba\n")
    (project.path / "matplotlibrc").write_text("backend: module://random\nfont.size: 90\n")
    for name in ("bash", "sh", "uname", "sed"):
        (project.path / name).write_text(f"#!/bin/sh\necho {name} >> '{project.path}/trace'\nexit 1\n")
        (project.path / name).chmod(0o755)
    return project


@pytest.mark.renderer
@pytest.mark.usefixtures("without_forks")
def test_no_file_of_a_show_runs(hostile: ProjectFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", f".:{os.environ['PATH']}:")
    render = ["render", "T010_tiny", "-q", QUALITY, "-f", "1"]
    for words in installed(render, ["curves", "T010_tiny"]):
        done = hostile.run(*words)
        assert done.code == 0, done.err
    assert not (hostile.path / "trace").exists(), (hostile.path / "trace").read_text()
    assert not (hostile.path / "numba").exists()


def test_an_empty_entry_of_pythonpath_is_not_the_show(
    hostile: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(hostile.path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", "shots", str(hostile.path / "own")]))
    entries = python_process.environment()["PYTHONPATH"].split(os.pathsep)
    assert str(hostile.path / "own") in entries
    assert not {"", "shots", str(hostile.path), str(hostile.path / "shots")} & set(entries)


def test_a_farm_is_given_no_root_that_brings_packages_for_snakemake(
    project: ProjectFolder,
) -> None:
    (project.path / DEPLOYMENTS).mkdir(parents=True)
    write_profile(project.path, "lsf")
    plan = Plan((), None, ())
    run = running(plan, project.path, 1, Profile(project.path / "profiles" / "lsf"))
    with pytest.raises(UsageError, match="would import packages from here"), run:
        pass


def test_every_python_is_started_in_one_place() -> None:
    """What starts Python elsewhere would let modules of a show run."""
    starting = [file.name for file in PACKAGES if "sys.executable" in file.read_text()]
    assert starting == ["python_process.py"]
    assert "executable" not in (python_process.PACKAGE_ROOT / "Snakefile").read_text()


def test_a_hook_of_the_user_finds_the_modules_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(python_process.SAFE_PATH, "1")
    assert python_process.SAFE_PATH not in user_environment()
