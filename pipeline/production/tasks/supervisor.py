"""Rendering processes, watched by one that renders nothing: what becomes of a job when one of them ends."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pipeline.production.planning.plan import Job
from pipeline.production.store.event_log import Event, EventReader
from pipeline.production.tasks.job import ENVIRONMENT, Context
from pipeline.production.tasks.memory_guard import RESTART_WORKER
from pipeline.production.tasks.signals import SIGNALS, handled

CRASHES = {signal.SIGABRT, signal.SIGSEGV, signal.SIGILL, signal.SIGBUS, signal.SIGFPE}

INTERRUPTED = 130

Start = Callable[[int], "subprocess.Popen[bytes]"]
"""Starts a process that renders a job's frames but for so many of the first."""


@dataclass
class Supervisor:
    """Has a job rendered by one process, or by several one after the other."""

    context: Context
    start: Start

    def run(self) -> int:
        """The exit code of the job. Where its renderer crashes its shot is rendered by another variant."""
        told = EventReader(self.context.log.path)
        told.skip()  # a whole film's log takes seconds to read
        settled: list[Event] = []
        while True:
            code, asked_to_end = self._run_one(sum(event["frame"] is not None for event in settled))
            name = self.context.job.name
            news = [event for event in told.new(name) if event["job"] == name]
            settled += [event for event in news if event["event"] in ("frame", "fail")]
            if asked_to_end:
                return INTERRUPTED
            if code == RESTART_WORKER:
                continue
            if any(event["event"] == "hung" for event in news):
                return 1  # who ended it for that has said so
            if code < 0:
                return self._ended_by(signal.Signals(-code))
            return _verdict(code, settled)

    def _run_one(self, settled: int) -> tuple[int, bool]:
        """Run one process; return its exit code and whether a signal ended it, which is passed on."""
        asked: list[int] = []
        processes: list[subprocess.Popen[bytes]] = []

        def pass_on(number: int) -> None:
            asked.append(number)
            for process in processes:
                process.send_signal(number)

        with handled(pass_on):
            processes.append(self.start(settled))
            for number in asked:  # while it was being started
                processes[0].send_signal(number)
            return processes[0].wait(), bool(asked)

    def _ended_by(self, number: signal.Signals) -> int:
        if number in SIGNALS:
            return int(number)
        context = self.context
        if number in CRASHES and fall_back_to_other_variant(context, f"crashed ({number.name})"):
            return 1
        context.killed(number.name)
        return 1


def _verdict(code: int, settled: Sequence[Event]) -> int:
    """The exit code of a job by what it told: where some frames were made, those are to be finished though
    others failed; but what the machine refused ends all."""
    faults = [event.get("exit_code") for event in settled if event["event"] == "fail"]
    if not faults:
        return code
    return 0 if len(faults) < len(settled) and ENVIRONMENT not in faults else 1


def fall_back_to_other_variant(context: Context, fact: str) -> bool:
    """Have the shot of a job rendered from the start by another variant; whether there is one.

    fact  what its variant did, such as "crashed (SIGABRT)"
    """
    from pipeline.production.request.variants import avoid  # who only watches must be there at once

    request = context.request
    reason = f"{request.variant} {fact} while rendering {context.subject}"
    left = avoid(context.root, request.name, request.variant, reason)
    if left:
        context.log.write("healed", message=f"{reason}; the shot is rendered without it from the start")
    return left


def renderer(plan_path: str, job: Job) -> Start:
    """Start `python -m pipeline.production.tasks` as a child that renders."""

    def start(settled: int) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "pipeline.production.tasks", plan_path, job.name]
        words = ["--threads", str(job.threads), "--child", str(settled)]
        return subprocess.Popen([*command, *words], stdin=subprocess.DEVNULL)

    return start
