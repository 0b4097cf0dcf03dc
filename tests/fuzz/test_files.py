"""Files from outside, damaged or hostile: an error in one line, soon, with little memory, and no code run."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fuzz.files import Worker, attempts
from tests.fuzz.past_failures import PAST_FAILURES, PastFailure


@pytest.fixture(scope="module")
def worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    worker = Worker(tmp_path_factory.mktemp("fuzz"))
    yield worker
    worker.close()


@pytest.mark.slow
@pytest.mark.parametrize("past", PAST_FAILURES, ids=lambda past: f"{past.kind} {past.name}")
def test_files_that_once_crashed_or_hung_are_told_in_one_line(
    past: PastFailure, worker: Worker, tmp_path: Path
) -> None:
    path = tmp_path / past.name
    past.make(path)
    attempt = worker.read(past.kind, path)
    assert not attempt.fault, attempt
    assert past.fact in attempt.message and bool(past.fact) == bool(attempt.message), attempt.message


@pytest.mark.slow
@pytest.mark.parametrize("count", [310])
def test_mutated_files_are_read_or_told(count: int, worker: Worker) -> None:
    for _, (kind, name, content, attempt) in zip(range(count), attempts(7, worker), strict=False):
        assert not attempt.fault, (kind, name, content, attempt)


@pytest.mark.soak
def test_new_mutated_files_are_read_or_told(worker: Worker) -> None:
    """Try files for FUZZ_MINUTES, five by default, from another seed each time."""
    end, seed = time.monotonic() + 60 * float(os.environ.get("FUZZ_MINUTES", "5")), time.time_ns() % 10**6
    for kind, name, content, attempt in attempts(seed, worker):
        assert not attempt.fault, (seed, kind, name, content, attempt)
        if time.monotonic() > end:
            break
