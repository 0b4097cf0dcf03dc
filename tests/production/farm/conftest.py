"""Shared fixtures of farms: a SLURM of one node, and a profile for it."""

from __future__ import annotations

import json
import subprocess
import sys
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from flowsculpt.pipeline.production.planning.profile import shipped

SLURM = Path(__file__).with_name("slurm.py")


@dataclass(frozen=True)
class Farm:
    """A SLURM at work.

    variables   of the environment, by which its commands and Snakemake's plugin for it are found
    """

    variables: Mapping[str, str]

    def jobs(self) -> list[dict[str, str]]:
        """All of its jobs, ended ones too, as `scontrol show job` tells of them."""
        told = self.said("scontrol", "show", "job", "--oneliner")
        lines = [line for line in told.splitlines() if line.startswith("JobId=")]
        return [dict(word.split("=", 1) for word in line.split() if "=" in word) for line in lines]

    def said(self, *command: str) -> str:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="session")
def slurm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    """SLURM from Debian packages, on this machine alone; skips where set-up could not fetch them."""
    folder = tmp_path_factory.mktemp("slurm")
    process = subprocess.Popen(
        [sys.executable, str(SLURM), "serve", str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None and process.stderr is not None
    line = process.stdout.readline()
    if not line:
        _, complaint = process.communicate()
        pytest.skip(f"no SLURM here: {complaint.strip()}")
    yield Farm(json.loads(line))
    process.communicate()


def quick_profile(folder: Path) -> None:
    """The shipped profile, changed as it may be in a working folder: for a small node that answers fast."""
    text = (shipped() / "slurm" / "profile.yaml").read_text()
    for old, new in (
        ("threads: 4", "threads: 1"),
        ("# min_frames: 4", "min_frames: 6"),
        ("status-checks: 5", "status-checks: 1"),
    ):
        assert old in text
        text = text.replace(old, new)
    (folder / "profiles" / "slurm").mkdir(parents=True)
    (folder / "profiles" / "slurm" / "profile.yaml").write_text(text)


@pytest.fixture
def on_slurm(project, slurm: Farm, monkeypatch: pytest.MonkeyPatch):
    """A project whose working folder holds a profile for this SLURM, which is found in this test alone.

    Snakemake takes a second longer to start where it finds the plugin, with the packages that this needs.
    """
    for name, value in slurm.variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.syspath_prepend(slurm.variables["PYTHONPATH"].partition(":")[0])
    quick_profile(project.path)
    return project


@pytest.fixture
def store(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The address of an S3 store that every process finds."""
    s3 = pytest.importorskip("tests.plugins.remote.s3")  # a second, which few tests need
    with s3.serving() as server:
        for name, value in {**s3.CREDENTIALS, "AWS_ENDPOINT_URL": server.url}.items():
            monkeypatch.setenv(name, value)
        yield f"s3://{s3.BUCKET}/{uuid.uuid4().hex}"
