"""Faults of disks and network folders, as the C library reports them: no traceback, no wrong file, and once
they are over the same bits as without."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.production.store.digests import digest_of
from tests.conftest import QUALITY, Run

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="LD_PRELOAD is Linux's")

NAME = "T010_tiny"
SIZE = ("-q", QUALITY)
FAULTS = 200
"""Faults that the series meets."""

RATES = (100, 400, 1500)
"""One call in so many meets a fault, from run to run."""

FORGOTTEN = (("movie",), ("movie", "frame"), ("movie", "frame", "raw"), ())
"""Kinds of files that a run has to make; all where none are named."""

SOURCE = Path(__file__).with_name("disk_faults.c")
INVISIBLE, VISIBLE = "si", "et"
"""Faults that nobody may notice, short reads and writes and EINTR; and those that may end a frame."""


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library that makes calls fail, compiled."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    made = tmp_path_factory.mktemp("faults") / "disk_faults.so"
    subprocess.run([compiler, "-O1", "-shared", "-fPIC", "-o", made, SOURCE, "-ldl"], check=True)
    return made


@dataclass
class Disk:
    """A disk that refuses some calls below a project's folder; `log` lists them."""

    library: Path
    project: Any
    log: Path

    def run(self, kinds: str, seed: int, rate: int, *words: str) -> Run:
        """Run a command of ours; one call in `rate` meets a fault of the kinds."""
        return self.start(kinds, seed, rate, "-m", "flowsculpt", "--no-progress", "-j", "2", *words)

    def start(self, kinds: str, seed: int, rate: int, *words: str) -> Run:
        """Run Python in the project's folder."""
        environment = {
            **os.environ,
            "PYTHONPATH": str(Path(__file__).parents[3]),
            "LD_PRELOAD": str(self.library),
            "FAULTS_BELOW": str(self.project.path),
            "FAULTS_KINDS": kinds,
            "FAULTS_SEED": str(seed),
            "FAULTS_RATE": str(rate),
            "FAULTS_LOG": str(self.log),
        }
        command, folder = [sys.executable, *words], self.project.path
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600
        )
        return Run(done.returncode, done.stdout, done.stderr)

    @property
    def faults(self) -> list[str]:
        return self.log.read_text().splitlines() if self.log.exists() else []


@pytest.fixture
def disk(library: Path, project: Any, tmp_path_factory: pytest.TempPathFactory) -> Disk:
    return Disk(library, project, tmp_path_factory.mktemp("log") / "faults")


def contents(project: Any) -> dict[str, str]:
    """Return the digest of every file of the store and in renders/ but drafts, by its name."""
    folders = (project.path / ".flowsculpt/store", project.path / "renders")
    paths = (path for folder in folders for path in folder.rglob("*") if path.parent.name != "tmp")
    kinds = (".npz", ".exr", ".mp4")  # statistics tell of seconds
    return {str(path.relative_to(project.path)): digest_of(path) for path in paths if path.suffix in kinds}


def said(project: Any, done: Run) -> str:
    """Return all that a command and its jobs have printed."""
    logs = (path.read_text(errors="replace") for path in (project.path / ".flowsculpt/logs").rglob("*.log"))
    return "\n".join([done.out, done.err, *logs])


def forget(project: Any, finished: Any, kinds: Sequence[str]) -> None:
    """Have a project be one that is finished, but for kinds of files; for all where none are named."""
    shutil.rmtree(project.path)
    finished.copy(project.path)
    shutil.rmtree(project.path / "renders")
    if not kinds:
        shutil.rmtree(project.path / ".flowsculpt")
    for kind in kinds:
        shutil.rmtree(project.path / ".flowsculpt/store" / kind)


def require_harmless(disk: Disk, kinds: str, seed: int, rate: int, wanted: dict[str, str]) -> None:
    """Make the film with faults and once more without; what is there at any time is what is `wanted`."""
    project, before = disk.project, len(disk.faults)
    movies = {name: digest for name, digest in wanted.items() if name.endswith(".mp4")}
    done = disk.run(kinds, seed, rate, "film", *SIZE)
    told = "\n".join([f"seed {seed}, one in {rate}", done.out, done.err, *disk.faults[before:]])
    assert "Traceback" not in done.out + done.err, told
    assert "Exception in thread" not in said(project, done), told
    assert done.code in ((0,) if kinds == INVISIBLE else (0, 1, 4)), told
    assert done.code == 0 or done.err.strip(), told
    assert contents(project).items() <= wanted.items(), told
    if done.code:
        again = project.run("film", *SIZE)
        assert again.code == 0, told + again.err
    made = contents(project)
    assert movies.items() <= made.items() <= wanted.items(), told


JOBS = """
import sys
from pathlib import Path
from tests.conftest import ProjectFolder
ProjectFolder(Path(sys.argv[1])).render()
"""


def test_the_jobs_of_a_shot_notice_no_short_reads_and_writes_and_no_interrupted_calls(
    disk: Disk, finished_project: Any
) -> None:
    forget(disk.project, finished_project, ("movie", "frame", "raw"))
    done = disk.start(INVISIBLE, 1, 20, "-c", JOBS, str(disk.project.path))
    assert done.code == 0, done.err
    assert contents(disk.project).items() <= contents(finished_project).items()
    assert len(disk.project.frames()) == 6
    assert len(disk.faults) > 10


@pytest.mark.soak
def test_no_run_notices_short_reads_and_writes_and_interrupted_calls(
    disk: Disk, finished_project: Any
) -> None:
    for seed in range(3):
        forget(disk.project, finished_project, ())
        require_harmless(disk, INVISIBLE, seed, 20, contents(finished_project))
    assert len(disk.faults) > 200


@pytest.mark.soak
def test_two_hundred_errors_of_a_disk_harm_nothing(disk: Disk, finished_project: Any) -> None:
    wanted, seed = contents(finished_project), 0
    while len(disk.faults) < FAULTS:
        forget(disk.project, finished_project, FORGOTTEN[seed % len(FORGOTTEN)])
        require_harmless(disk, VISIBLE, seed, RATES[seed % len(RATES)], wanted)
        seed += 1
    met = {line.split()[1] for line in disk.faults}
    assert {"open", "read", "write", "stat"} <= met, met
