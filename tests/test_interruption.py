"""Ctrl-C ends what is computed, however long its compiled calls are."""

from __future__ import annotations

import signal
import subprocess
import sys
from contextvars import ContextVar
from pathlib import Path
from threading import Thread, current_thread, main_thread

import numba
import pytest

from flowsculpt.pipeline.long_computations import interruptible
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.resample import Thresholds, resample, resample_pass

pytestmark = pytest.mark.quick

SLEEPING = """
import ctypes
from flowsculpt.pipeline.long_computations import interruptible
interruptible(lambda: (print("begins", flush=True), ctypes.CDLL(None).sleep(3600)))
"""


FREEING = """
import signal, time
from flowsculpt.render.base.python_process import interrupt_once
signal.signal(signal.SIGTERM, interrupt_once)

def frames():
    try:
        yield 1
    finally:
        print("begins", flush=True)
        time.sleep(30)

next(frames())
time.sleep(10)
print("goes on")
"""


def test_a_signal_ends_a_process_that_is_just_freeing_what_it_has_left() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", FREEING], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None and process.stdout.readline() == b"begins\n"
    process.send_signal(signal.SIGTERM)
    said, errors = process.communicate(timeout=300)
    assert process.returncode == -signal.SIGINT and said == b""
    assert errors.endswith(b"KeyboardInterrupt\n") and b"ignored" not in errors


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_compiled_call_of_an_hour(number: signal.Signals) -> None:
    folder = Path(__file__).parents[1]
    process = subprocess.Popen(
        [sys.executable, "-c", SLEEPING], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None and process.stdout.readline() == b"begins\n"
    process.send_signal(number)
    process.communicate(timeout=300)
    assert process.returncode == -number


def test_results_errors_context_and_number_of_threads_are_those_of_a_plain_call() -> None:
    variable: ContextVar[int] = ContextVar("variable")
    variable.set(3)
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        assert interruptible(lambda: (variable.get(), numba.get_num_threads())) == (3, 1)
    finally:
        numba.set_num_threads(before)
    with pytest.raises(ZeroDivisionError):
        interruptible(lambda: 1 // 0)


def test_other_threads_call_it_themselves() -> None:
    assert interruptible(current_thread) is not main_thread()
    threads = []
    other = Thread(target=lambda: threads.append(interruptible(current_thread)))
    other.start()
    other.join()
    assert threads == [other]


def test_a_surface_has_the_same_bits_whether_a_thread_resamples_it_or_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ball = icosphere(6)
    stretched = ball.with_vertices(ball.vertices * (4.0, 1.0, 0.2))
    alone, report = resample(stretched, Thresholds(0.2))
    monkeypatch.setattr(resample_pass, "_MANY_FACES", 0)
    by_thread, same = resample(stretched, Thresholds(0.2))
    assert report == same and report.splits and report.collapses
    assert by_thread.vertices.tobytes() == alone.vertices.tobytes()
    assert by_thread.faces.tobytes() == alone.faces.tobytes()
