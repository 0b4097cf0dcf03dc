"""The pool of workers: each job is a process of its own, and none outlives the process that has the pool."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from flowsculpt.pipeline.production.execution.project import Project
from tests.processes import has_ended, wait_until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux forks safely")

LONG = """
title: Long
frames: 1-9000
subject: {solid: box}
resample: {max_edge_length: 0.4}
flows: [translation: {rate: [1, 0, 0]}]
"""

OWNER = """
import json, os, sys
from flowsculpt.pipeline.production.tasks.worker_pool import WorkerPool
pool = WorkerPool()
pool.start()
for line in sys.stdin:
    pool.submit(json.loads(line), lambda code: print(code, flush=True))
pool.close()
"""


class Owner:
    """A process that has a pool, in a root."""

    def __init__(self, root: Path) -> None:
        command = [sys.executable, "-c", OWNER]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, cwd=root, stdin=pipe, stdout=pipe, stderr=pipe, text=True)

    def submit(self, *words: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(words) + "\n")
        self.process.stdin.flush()

    def code(self) -> int:
        """Wait for a worker; return its exit code."""
        assert self.process.stdout is not None
        return int(self.process.stdout.readline())

    @property
    def pool(self) -> psutil.Process:
        (pool,) = psutil.Process(self.process.pid).children()
        return pool

    @property
    def workers(self) -> list[psutil.Process]:
        return list(self.pool.children())


@pytest.fixture
def words(tmp_path: Path) -> list[str]:
    """The words of a job that takes a minute."""
    shot = tmp_path / "long.yaml"
    shot.write_text(LONG)
    plan = Project(tmp_path, 1).meshes([str(shot)])
    return [str(plan.freeze(tmp_path)), plan.jobs[0].name]


@contextmanager
def working(root: Path, words: list[str]) -> Iterator[Owner]:
    """Have a job under way."""
    owner = Owner(root)
    owner.submit(*words)
    with owner.process:
        try:
            wait_until(lambda: list(root.rglob("long.0002.npz")))
            yield owner
        finally:
            owner.process.kill()


def test_the_exit_code_of_a_job_is_reported_and_the_next_is_done(tmp_path: Path) -> None:
    owner = Owner(tmp_path)
    for _ in range(2):
        owner.submit()
        assert owner.code() == 2
    _, told = owner.process.communicate(timeout=300)
    assert owner.process.returncode == 0
    assert told.count("required: plan_path, job_name") == 2


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 130), (signal.SIGKILL, 1)]
)
def test_a_signal_to_a_worker_ends_its_job_alone(
    tmp_path: Path, words: list[str], number: int, code: int
) -> None:
    with working(tmp_path, words) as owner:
        owner.workers[0].send_signal(number)
        assert owner.code() == code
        owner.submit()
        assert owner.code() == 2, "the pool works on"
    (log,) = tmp_path.glob(".flowsculpt/events/*.jsonl")
    assert ("was terminated by SIGKILL" in log.read_text()) == (number == signal.SIGKILL)


def test_signals_to_the_pool_leave_its_end_to_its_owner(tmp_path: Path, words: list[str]) -> None:
    with working(tmp_path, words) as owner:
        for number in (signal.SIGINT, signal.SIGTERM):
            owner.pool.send_signal(number)
        owner.submit()
        assert owner.code() == 2
        assert owner.process.stdin is not None
        owner.process.stdin.close()
        assert owner.code() == 130, "closing ends the jobs, which keep what they have done"
        assert owner.process.wait(300) == 0


@pytest.mark.parametrize("killed", ["owner", "pool"])
def test_no_worker_outlives_the_pool_or_the_process_that_has_it(
    tmp_path: Path, words: list[str], killed: str
) -> None:
    with working(tmp_path, words) as owner:
        pool, (worker,) = owner.pool, owner.workers
        (pool if killed == "pool" else psutil.Process(owner.process.pid)).kill()
        if killed == "pool":
            assert owner.code() == -signal.SIGKILL
            owner.submit()
            assert owner.code() == -signal.SIGKILL, "nor does a job that comes later wait for ever"
        wait_until(lambda: has_ended(worker) and has_ended(pool))
