"""Compiled kernels: made at set-up, never while somebody waits."""

import os
import shutil
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import render
from pipeline import kernels
from render import kernels as render_kernels

SCENE = """
from pathlib import Path
from pipeline import kernels
from pipeline.animation import animate
from pipeline.mesh import split_at_creases
from pipeline.shot import read_shot

shot = read_shot(Path({path!r}))
for frame in animate(shot):
    split_at_creases(frame.mesh)
for dispatcher, signature in kernels.DECLARED:
    if len(dispatcher.signatures) > 1:
        print(dispatcher.__name__, dispatcher.signatures)
    if dispatcher.stats.cache_misses:
        print(dispatcher.__name__, "was compiled")
"""


def test_a_whole_shot_runs_on_what_set_up_has_compiled(project):
    assert kernels.compile_all() > 0
    scene = SCENE.format(path=str(project.shot))
    done = subprocess.run([sys.executable, "-c", scene], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""


PREPARE = """
import {module}
kernels.DECLARED[:] = [(d, types) for d, types in kernels.DECLARED if d.py_func.__module__ == {module!r}]
kernels.BLOCK_KERNELS.clear()
kernels.compile_all()
"""

CALL = """
import numpy as np
from {module} import twist
twist(np.zeros((1, 3)), np.zeros(3), np.array([0.0, 1.0, 0.0]), 1.0, np.zeros((1, 3)))
print(dict(twist.stats.cache_misses), len(twist.stats.cache_hits))
"""


def test_a_call_finds_what_set_up_has_compiled_in_an_empty_cache(tmp_path):
    module = "pipeline.flow._kernels_deform"
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    said = []
    for step in (PREPARE, CALL):
        lines = [
            "from pipeline import kernels",
            f"kernels.kernel_modules = lambda: [{module!r}]",
            step.format(module=module),
        ]
        code = "\n".join(lines)
        done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        said.append(done.stdout.strip())
    assert said == ["", "{} 1"]


def test_no_vector_library_with_other_bits_is_taken():
    code = "import pipeline.kernels, numba.core.config as c; print(c.DISABLE_INTEL_SVML, c.USING_SVML)"
    environment = {name: value for name, value in os.environ.items() if "SVML" not in name}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.stdout.split() == ["1", "False"], done.stderr


WHERE = """
from pathlib import Path
from render import kernels
from render.raster._kernels_paint import paint
file = Path(kernels.__file__)
print(Path(paint.stats.cache_path).is_relative_to(kernels.folder_of(file.parent, file)))
"""


@pytest.fixture
def folder_now(tmp_path, monkeypatch):
    """Where kernels would live, asked anew each time: the caches are empty, and the user's is in `home`."""
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / "home" / name)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    def ask():
        kernels.cache_folder.cache_clear()
        return kernels.cache_folder()

    yield ask
    kernels.cache_folder.cache_clear()


def test_an_edit_of_any_kernel_file_means_another_folder(tmp_path, monkeypatch, folder_now):
    package = tmp_path / "pipeline"
    sources = shutil.copytree(
        kernels._PACKAGE, package, ignore=lambda _, names: [n for n in names if n.startswith("__pycache__")]
    )
    monkeypatch.setattr(kernels, "_PACKAGE", package)
    before = folder_now()
    files = sorted(sources.rglob("_kernels*.py"))
    assert len(files) == len(kernels.kernel_modules()) > 5
    for file in files:
        text = file.read_bytes()
        file.write_bytes(text + b"# edited")
        assert folder_now() != before, file
        file.write_bytes(text)
    assert folder_now() == before


def test_kernels_of_pictures_live_in_a_folder_of_their_sources_too(tmp_path, folder_now):
    """One calls others, in other files: where these have changed it must not be found as it was."""
    whole = Path(render.__file__).parent
    copied = shutil.copytree(whole, tmp_path / "render", ignore=shutil.ignore_patterns("__pycache__"))
    before = render_kernels.folder_of(copied)
    assert before == render_kernels.folder_of(whole)
    for file in sorted((copied / "raster").glob("_kernels*.py")):
        text = file.read_bytes()
        file.write_bytes(text + b"# edited")
        assert render_kernels.folder_of(copied) != before, file
        file.write_bytes(text)
    cached = subprocess.run([sys.executable, "-c", WHERE], capture_output=True, text=True, check=True)
    assert cached.stdout.strip() == "True"


@pytest.fixture
def no_home(tmp_path):
    """A user's cache that cannot be made."""
    (tmp_path / "home").write_text("a file")


def test_without_a_home_kernels_live_in_a_folder_of_the_users_own(tmp_path, no_home, folder_now):
    folder = folder_now()
    base = tmp_path / f"flowsculpt-cache-{os.getuid()}"
    assert folder.is_relative_to(base)
    assert stat.S_IMODE(base.stat().st_mode) == 0o700
    assert folder_now() == folder


def _open_to_others(base, tmp_path, monkeypatch):
    base.mkdir()
    base.chmod(0o777)


def _of_somebody_else(base, tmp_path, monkeypatch):
    base.mkdir(mode=0o700)
    owner = base.stat().st_uid + 1
    base.rename(base.with_name(f"flowsculpt-cache-{owner}"))
    monkeypatch.setattr(os, "getuid", lambda: owner)


def _a_link(base, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    base.symlink_to(tmp_path / "elsewhere")


@pytest.mark.parametrize("set_up", [_open_to_others, _of_somebody_else, _a_link])
def test_a_folder_that_others_could_have_filled_is_not_trusted(
    set_up, tmp_path, monkeypatch, no_home, folder_now
):
    set_up(tmp_path / f"flowsculpt-cache-{os.getuid()}", tmp_path, monkeypatch)
    folder = folder_now()
    assert folder.parent == tmp_path and folder.name.startswith("flowsculpt-kernels-")
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
