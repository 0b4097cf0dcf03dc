"""Supervise rendering processes: what ends one before its job is done, and what then becomes of the job.

A signal ends a rendering process between two sample batches, so that its work is kept. Memory that renderers
lose from frame to frame comes back only when their process ends, so one that has grown too large ends too,
and the supervisor starts a fresh one. The supervisor itself renders nothing: a crash takes only the renderer.
"""

from __future__ import annotations

import gc
import math
import os
import signal
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from subprocess import Popen
from types import FrameType

import psutil

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.production.planning.plan import Job
from flowsculpt.pipeline.production.planning.profile import avoid
from flowsculpt.pipeline.production.store.event_log import Event, EventReader
from flowsculpt.pipeline.production.tasks.job import ENVIRONMENT, Context
from flowsculpt.render.base import python_process
from flowsculpt.render.base.python_process import ENDING, ForkedProcess, may_fork

CRASHES = {
    number for number in signal.Signals if number.name in ("SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV")
}

INTERRUPTED = 130

RESTART_WORKER = 75
"""The exit code of a rendering process that wants a fresh one to render the rest of its frames."""

GROWTH = 1.5
"""Limit on the memory of a process, as a multiple of what it holds after its first frame."""

LEAST_MIB = 1024
"""Memory that a process may hold in any case."""

VARIABLE = "FLOWSCULPT_WORKER_MIB"
"""The environment variable that sets the memory limit of a process, in MiB."""

Start = Callable[[int], "ForkedProcess | Popen[bytes]"]
"""Starts a process that renders a job's frames, without a given number of the first."""

# The supervisor


@dataclass
class Supervisor:
    """Has a job rendered by one process, or by several one after the other."""

    context: Context
    start: Start

    def run(self) -> int:
        """Return the exit code of the job. A renderer that has grown is replaced at once.

        One that crashed is not: its variant is avoided, and another round renders the shot with the next one.
        """
        reader = EventReader(self.context.log.path)
        reader.skip()  # a whole film's log takes seconds to read
        settled: list[Event] = []
        while True:
            code, interrupted = self._run_one(sum(event["frame"] is not None for event in settled))
            name = self.context.job.name
            news = [event for event in reader.new(name) if event["job"] == name]
            settled += [event for event in news if event["event"] in ("frame", "fail")]
            if interrupted:
                return INTERRUPTED
            if code == RESTART_WORKER:
                continue
            if any(event["event"] == "hung" for event in news):
                return 1  # the watchdog, which ended it, has reported that
            if code < 0:
                return self._ended_by(signal.Signals(-code))
            return _verdict(code, settled)

    def _run_one(self, settled: int) -> tuple[int, bool]:
        """Run one process; return its exit code and whether a signal ended it, which is passed on."""
        received: list[int] = []
        processes: list[ForkedProcess | Popen[bytes]] = []

        def pass_on(number: int) -> None:
            received.append(number)
            for process in processes:
                process.send_signal(number)

        with handled(pass_on):
            processes.append(self.start(settled))
            for number in received:  # while it was being started
                processes[0].send_signal(number)
            return processes[0].wait(), bool(received)

    def _ended_by(self, number: signal.Signals) -> int:
        if number in ENDING:
            return int(number)
        context = self.context
        if not (number in CRASHES and fall_back_to_other_variant(context, f"crashed ({number.name})")):
            message = f"{context.job.stage} of {context.subject} was terminated by {number.name}"
            context.write("killed", message=message)  # as the system does where memory runs out
        return 1


def _verdict(code: int, settled: Sequence[Event]) -> int:
    """Return the exit code of a job by its events.

    Frames that were made are finished though others failed, but what the machine refused ends all.
    """
    faults = [event.get("exit_code") for event in settled if event["event"] == "fail"]
    if not faults:
        return code
    return 0 if len(faults) < len(settled) and ENVIRONMENT not in faults else 1


def fall_back_to_other_variant(context: Context, fact: str) -> bool:
    """Have the shot of a job rendered from the start by another variant; return whether there is one.

    fact  what its variant did, such as "crashed (SIGABRT)"
    """
    request = context.request
    reason = f"{request.variant} {fact} while rendering {context.subject}"
    left = avoid(context.root, request.name, request.variant, reason)
    if left:
        context.log.write("healed", message=f"{reason}; the shot is rendered from the start without it")
    return left


def renderer(plan_path: str, job: Job, render: Callable[[int], int]) -> Start:
    """Start a child that renders: a fork that calls `render`, or where that is not sound, a `job_process`."""

    def start(settled: int) -> ForkedProcess | Popen[bytes]:
        if may_fork():
            return ForkedProcess(lambda: render(settled))
        words = [plan_path, job.name, "--threads", str(job.threads), "--child", str(settled)]
        command = python_process.command("flowsculpt.pipeline.production.tasks.worker", *words)
        return Popen(command, env=python_process.environment(), stdin=subprocess.DEVNULL)

    return start


# Signals


@contextmanager
def handled(handle: Callable[[int], None]) -> Iterator[None]:
    """Have `handle` called for ENDING. A signal that is ignored stays so, as in a shell's background."""

    def handler(number: int, frame: FrameType | None) -> None:
        handle(number)

    before = {number: signal.getsignal(number) for number in ENDING}
    ours = [number for number in ENDING if before[number] != signal.SIG_IGN]
    for number in ours:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, before[number])


@dataclass
class StopRequest:
    """Notes that a signal asked this process to end."""

    received: bool = False

    def receive(self, number: int) -> None:
        self.received = True

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal was received."""
        if self.received:
            raise KeyboardInterrupt


@contextmanager
def deferred_signals() -> Iterator[StopRequest]:
    """Note signals instead of obeying them; the process ends where it calls `check`."""
    stop = StopRequest()
    with handled(stop.receive):
        yield stop


# Memory


class MemoryLimitError(Exception):
    """Raised when resident memory exceeds the limit; the supervisor starts a new worker.

    held, limit  MiB
    """

    def __init__(self, held: float, limit: float | None) -> None:
        super().__init__(held, limit)
        self.held, self.limit = held, limit


@dataclass
class MemoryGuard:
    """Watches the memory of this process. Raises UsageError where VARIABLE is no size."""

    _limit: float | None = field(default_factory=lambda: _limit_from_environment())
    _excess: float | None = None

    def measure(self) -> None:
        """Measure what this process holds after a frame; the first one sets the limit."""
        held = _resident_mib()
        if self._limit is None:
            self._limit = max(float(LEAST_MIB), GROWTH * held)
        if held > self._limit:
            gc.collect()
            held = _resident_mib()
        self._excess = held if held > self._limit else None

    def check(self) -> None:
        """Raise MemoryLimitError if the last measurement exceeded the limit."""
        if self._excess is not None:
            raise MemoryLimitError(self._excess, self._limit)


def _resident_mib() -> float:
    return float(psutil.Process().memory_info().rss) / 2**20


def _limit_from_environment() -> float | None:
    text = os.environ.get(VARIABLE)
    if not text:
        return None
    try:
        limit = float(text)
    except ValueError:
        limit = math.nan
    if not (math.isfinite(limit) and limit > 0.0):
        raise UsageError(f"{VARIABLE} is {text!r}; it must be a size in MiB, such as 4096")
    return limit
