"""Why a worker ends before its job is done, and what then becomes of the job.

A signal ends a renderer between two sample batches, so that its work is kept. Memory that renderers lose from
frame to frame comes back only when their process ends, so one that has grown too large ends too, and another
worker renders the rest. After a crash another worker says what that means for the shot. Who starts workers
renders nothing itself: a crash takes only the worker.
"""

from __future__ import annotations

import gc
import math
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from subprocess import Popen
from types import FrameType

import psutil

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.production.planning.profile import avoid
from flowsculpt.pipeline.production.store.event_log import Event, EventReader
from flowsculpt.pipeline.production.tasks.job import ENVIRONMENT, Context
from flowsculpt.render.base.python_process import ENDING, ForkedProcess

CRASHES = {
    number for number in signal.Signals if number.name in ("SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV")
}

INTERRUPTED = 130

RESTART_WORKER = 75
"""The exit code of a worker that wants a fresh one to render the rest of its frames."""

GROWTH = 1.5
"""Limit on the memory of a process, as a multiple of what it holds after its first frame."""

LEAST_MIB = 1024
"""Memory that a process may hold in any case."""

VARIABLE = "FLOWSCULPT_WORKER_MIB"
"""The environment variable that sets the memory limit of a process, in MiB."""

# Another worker


def needs_another(code: int, before: int) -> bool:
    """Tell whether a job needs another worker: to render the rest, or to say why this one was killed.

    code    the exit code of a worker: minus the number of a signal that ended it
    before  that of the worker before it, which `--after` told it; 0 for the first
    """
    return code == RESTART_WORKER or (code < 0 <= before and -code not in ENDING)


def run_children(start: Callable[[int], ForkedProcess | Popen[bytes]]) -> int:
    """Have a job done by workers, one after the other, that are children of this process.

    A signal is passed on. Return the exit code of the last.

    start  starts a worker, with the exit code of the one before it
    """
    received: list[int] = []
    workers: list[ForkedProcess | Popen[bytes]] = []

    def pass_on(number: int) -> None:
        received.append(number)
        for worker in workers:
            worker.send_signal(number)

    code = before = 0
    with handled(pass_on):
        while not workers or needs_another(code, before):
            before = code
            workers[:] = [start(before)]
            for number in received:  # while it was being started
                workers[0].send_signal(number)
            code = workers[0].wait()
            if received:
                return INTERRUPTED
    return code


def events_of_try(context: Context) -> list[Event]:
    """Return the events of a job since the first of the workers began that do it one after the other."""
    events: list[Event] = []
    for event in EventReader(context.log.path).new(context.job.name):
        if event["event"] == "begin" and not event.get("after"):
            events.clear()
        if event["job"] == context.job.name:
            events.append(event)
    return events


def settled_frames(context: Context) -> int:
    """Return how many frames of a job its workers have made, or failed at."""
    kinds = ("frame", "fail")
    return sum(event["event"] in kinds and event["frame"] is not None for event in events_of_try(context))


def verdict(context: Context, code: int) -> int:
    """Return the exit code of a job by that of its last worker, and its events.

    Frames that were made are finished though others failed, but what the machine refused ends all.
    """
    if code != 1:
        return code
    events = events_of_try(context)
    faults = [event.get("exit_code") for event in events if event["event"] == "fail"]
    made = any(event["event"] == "frame" for event in events)
    return 0 if faults and made and ENVIRONMENT not in faults else 1


def report_killed(context: Context, number: signal.Signals) -> None:
    """Report that a signal has ended the worker of a job. After a crash, its variant is avoided.

    The watchdog has reported the end of one that hung.
    """
    if any(event["event"] == "hung" for event in events_of_try(context)):
        return
    crashed = context.job.stage == "render" and number in CRASHES
    if not (crashed and fall_back_to_other_variant(context, f"crashed ({number.name})")):
        message = f"{context.job.stage} of {context.subject} was terminated by {number.name}"
        context.write("killed", message=message)  # as the system does where memory runs out


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


class StoppedError(KeyboardInterrupt):
    """Raised where a process ends as a signal had asked it to, a while before."""


@dataclass
class StopRequest:
    """Notes that a signal asked this process to end."""

    received: bool = False

    def receive(self, number: int) -> None:
        self.received = True

    def check(self) -> None:
        """Raise StoppedError if a signal was received."""
        if self.received:
            raise StoppedError


@contextmanager
def deferred_signals() -> Iterator[StopRequest]:
    """Note signals instead of obeying them; the process ends where it calls `check`."""
    stop = StopRequest()
    with handled(stop.receive):
        yield stop


# Memory


class MemoryLimitError(Exception):
    """Raised when resident memory exceeds the limit; another worker renders the rest.

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
