"""What set-up leaves to compile is compiled in the background of the first run, and nobody waits for it."""

import os
import signal
import sys
import time
from pathlib import Path

import pytest

from flowsculpt.render.base import kernel_cache, remaining_kernels
from flowsculpt.render.base.kernel_build import film_calls, kernel_calls
from flowsculpt.render.base.remaining_kernels import (
    compile_remaining_kernels,
    kernels_remain,
    note_no_remaining_kernels,
    note_remaining_kernels,
)

SLEEPER = "import os, sys, time; open(sys.argv[1], 'w').write(f'{os.getpid()} {os.nice(0)}'); time.sleep(60)"


@pytest.fixture
def started(tmp_path, monkeypatch):
    """An empty cache; return the file in which a process that sleeps, not compiles, writes what it is."""
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / name)
    file = tmp_path / "started"
    command = [sys.executable, "-c", SLEEPER, str(file)]
    monkeypatch.setattr(remaining_kernels, "python_command", lambda *words: command)
    yield file
    if file.exists():
        os.kill(int(file.read_text().split()[0]), signal.SIGKILL)


def process_and_priority(file: Path) -> list[int]:
    """Return the process that wrote to a file, and its priority, as soon as it has."""
    while not file.exists() or " " not in file.read_text():
        time.sleep(0.01)
    return [int(word) for word in file.read_text().split()]


def test_nothing_is_started_where_set_up_has_left_nothing(started):
    assert not kernels_remain() and not compile_remaining_kernels()
    note_remaining_kernels()
    note_no_remaining_kernels()
    assert not kernels_remain() and not compile_remaining_kernels()


@pytest.mark.skipif(os.name != "posix", reason="needs priorities and locks of files")
def test_one_process_of_the_lowest_priority_compiles_what_is_left_and_another_after_it_was_killed(started):
    note_remaining_kernels()
    assert compile_remaining_kernels()
    process, priority = process_and_priority(started)
    assert priority == 19
    assert not compile_remaining_kernels(), "one does so already"
    started.unlink()
    os.kill(process, signal.SIGKILL)
    while not compile_remaining_kernels():
        assert kernels_remain()
    assert process_and_priority(started)[0] != process


@pytest.mark.parametrize("is_in_background", [False, True])
def test_nobody_waits_for_a_kernel_that_is_compiled_in_the_background(is_in_background, started, monkeypatch):
    monkeypatch.setattr(kernel_cache, "is_in_background", lambda: is_in_background)
    place = Path("folder/name.kernel")
    kernel_cache.reserve_kernel(place)
    try:
        assert kernel_cache._lock_of(place).exists() != is_in_background
    finally:
        kernel_cache._release_kernels(0)
    assert not kernel_cache._lock_of(place).exists()


def test_kernels_of_films_call_none_that_set_up_leaves():
    films = film_calls(kernel_calls())
    assert set().union(*films.values()) <= films.keys()
    assert len(films) < len(kernel_calls())
