"""Two users of one group work in one root, as docs/production.md says."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from flowsculpt.render.base.kernel_cache import cache_folder
from tests.conftest import QUALITY, ProjectFolder, Run, new_project
from tests.needed_plugins import needs_plugins

NAME, SIZE = "T010_tiny", ("-q", QUALITY)
ONE, OTHER, GROUP = 2001, 2002, 3000
"""Numbers of two users and of a group, which need no names."""

pytestmark = [
    pytest.mark.soak,
    pytest.mark.skipif(
        not hasattr(os, "geteuid") or os.geteuid() != 0 or shutil.which("setpriv") is None,
        reason="only root becomes other users",
    ),
]


@pytest.fixture
def place() -> Iterator[Path]:
    """A folder that both users reach; those of pytest are closed to others."""
    folder = Path(tempfile.mkdtemp(prefix="shared"))
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


@pytest.fixture
def shared(place: Path) -> ProjectFolder:
    """A root that belongs to the group."""
    project = new_project(place / "show")
    for path in [project.path, *project.path.rglob("*")]:
        os.chown(path, ONE, GROUP)
        path.chmod(0o2775 if path.is_dir() else 0o664)
    return project


@pytest.fixture
def caches(place: Path) -> Path:
    """A cache folder for each user, with the compiled kernels: compiling them takes minutes."""
    kernels = cache_folder()
    for user in (ONE, OTHER):
        home = place / str(user)
        shutil.copytree(kernels, home / "flowsculpt" / kernels.parent.name / kernels.name)
        subprocess.run(["chown", "-R", str(user), home], check=True)
    return place


def run_as(user: int, mask: int, project: ProjectFolder, caches: Path, *words: str) -> Run:
    """Run a command as a user. It may read whatever root may, as Python may lie in root's home."""
    rights = ["--inh-caps=-all,+dac_read_search", "--ambient-caps=+dac_read_search"]
    become = ["setpriv", f"--reuid={user}", f"--regid={user}", f"--groups={GROUP}", *rights]
    home = str(caches / str(user))
    done = subprocess.run(
        [*become, sys.executable, "-m", "flowsculpt", "--no-progress", "-j", "2", *words],
        cwd=project.path,
        env={**os.environ, "HOME": home, "XDG_CACHE_HOME": home},
        umask=mask,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert "Traceback" not in done.stdout + done.stderr, done.stderr
    return Run(done.returncode, done.stdout, done.stderr)


@needs_plugins("maintenance")
def test_what_one_user_makes_another_goes_on_with_repairs_and_cleans(
    shared: ProjectFolder, caches: Path
) -> None:
    first = run_as(ONE, 0o002, shared, caches, "render", NAME, *SIZE, "-f", "1-3")
    assert first.code == 0, first.err
    for path in shared.path.rglob("*"):
        facts = path.stat()
        assert facts.st_gid == GROUP and facts.st_mode & stat.S_IRGRP, path
        assert not path.is_dir() or facts.st_mode & 0o2070 == 0o2070, path
    frame = next((shared.path / ".flowsculpt/store/frame").rglob("*.exr"))
    frame.chmod(0o644)
    frame.write_bytes(frame.read_bytes()[:-1] + b"?")
    for words in (["verify"], ["film", *SIZE], ["render", NAME, *SIZE, "-f", "1", "--force"], ["clean"]):
        done = run_as(OTHER, 0o002, shared, caches, *words)
        assert done.code == 0, (words, done.err)
    done = run_as(ONE, 0o002, shared, caches, "film", *SIZE)
    assert done.code == 0 and done.out.startswith("Nothing to be done"), done.out + done.err
    assert {path.stat().st_uid for path in shared.frames()} <= {ONE, OTHER}


def test_where_somebody_worked_with_another_umask_the_next_is_told(
    shared: ProjectFolder, caches: Path
) -> None:
    assert run_as(ONE, 0o022, shared, caches, "simulate", NAME, "-f", "1-2").code == 0
    refused = run_as(OTHER, 0o002, shared, caches, "simulate", NAME, "-f", "3")
    assert refused.code == 4 and ".flowsculpt/lock: cannot be written: permission denied" in refused.err
    subprocess.run(["chmod", "-R", "g+rwX", shared.path], check=True)
    assert run_as(OTHER, 0o002, shared, caches, "simulate", NAME, "-f", "3").code == 0
