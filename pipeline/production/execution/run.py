"""Run a plan: hold its locks, have Snakemake run its jobs, in as many rounds as healing needs.

After a corrupt file was evicted or a crashed variant is avoided, another round makes what is missing. A
killed job had too little memory, in all likelihood: the next round has half as many side by side. One that
hung is tried once more. No round mends a fault of a shot, a mesh or the disk.
"""

from __future__ import annotations

import os
import platform
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path

from flowsculpt.pipeline.errors import FrameError, MachineError
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.production.execution import snakemake
from flowsculpt.pipeline.production.execution.snakemake import end_family
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.planning.profile import Profile
from flowsculpt.pipeline.production.request.shot_source import PlanningCache
from flowsculpt.pipeline.production.stages import STAGES
from flowsculpt.pipeline.production.store.event_log import Event, EventLog, EventReader, poll
from flowsculpt.pipeline.production.store.history import summarise
from flowsculpt.pipeline.production.store.locks import Locks
from flowsculpt.pipeline.production.store.paths import EVENTS
from flowsculpt.pipeline.production.store.store import Store, remove_checkpoints, sweep
from flowsculpt.render.base.atomic_write import disk_errors
from flowsculpt.render.base.processes import is_at_work, start_of
from flowsculpt.render.base.root_files import touch
from flowsculpt.render.base.work_clock import cpu_seconds

ROUNDS = 6
"""The most times that a run plans. Each may find one more damaged file on the way from a film to a mesh: a
finished frame, a rendered one, its normals, its mesh."""

TRIES = 2
"""The most times that a frame may hang."""

PATIENCE = 1800.0
"""Seconds without a sign of life, by default: many times what the slowest sample batch of a picture takes."""

WATCH_SECONDS = 0.5


@dataclass
class RetryPolicy:
    """The retries of one run.

    cores     cores of the next round
    failures  events of what is beyond help, as failures
    """

    cores: int
    failures: list[Event] = field(default_factory=list)
    _rounds: int = 0
    _hung: Counter[tuple[object, ...]] = field(default_factory=Counter)

    def allows(self, events: Sequence[Event]) -> bool:
        """Tell whether another round may mend what a round with these events left undone."""
        self._rounds += 1
        may_help = any(event["event"] == "healed" for event in events)
        for event in events:
            if event["event"] == "hung":
                may_help |= self._may_try_again(event)
        killed = [event for event in events if event["event"] == "killed"]
        if killed and self.cores > 1:
            self.cores //= 2
            may_help = True
        else:
            self.failures += [_failure(e, f"with nothing beside it. {_likely_cause(e)}") for e in killed]
        return may_help and self._rounds < ROUNDS

    def _may_try_again(self, event: Event) -> bool:
        frame = (event.get("stage"), event.get("shot"), event.get("frame"))
        self._hung[frame] += 1
        if self._hung[frame] < TRIES:
            return True
        self.failures.append(_failure(event, "once more. If it is only slow, --timeout gives it longer."))
        return False


def _likely_cause(killed: Event) -> str:
    """Return what may have ended the process of a job."""
    plugin, _, its_own = str(killed.get("stage")).partition(".")
    if its_own:
        return f"Plug-in {plugin}, whose stage it is, ends the process."
    others = " or ".join(plugin.name for plugin in plugins() if plugin.sources)
    return "It may be out of memory" + (f", or plug-in {others} ends the process." if others else ".")


def _failure(event: Event, more: str) -> Event:
    return {**event, "event": "fail", "message": f"{event['message']} {more}"}


def watched(log: Path, patience: float = PATIENCE) -> AbstractContextManager[None]:
    """End the jobs that hang, by the event log, until the context is left."""
    watchdog = Watchdog(log, patience)
    return poll(min(WATCH_SECONDS, patience / 2.0), watchdog.check, watchdog.warn)


@dataclass
class _BegunJob:
    """A job's process and its start, the event it last wrote, and when, by the monotonic clock."""

    process: int
    start: float | None
    event: Event
    written: float = field(default_factory=time.monotonic)


class Watchdog:
    """Watches the jobs that write to an event log.

    Whatever a job writes is a sign of life: a frame begun or done, a sample batch rendered. One that is
    silent for longer than `patience` seconds is ended with all that it started, and the log says so (`hung`).
    """

    def __init__(self, log: Path, patience: float) -> None:
        self._log, self._patience = log, patience
        self._reader = EventReader(log)
        self._jobs: dict[str, _BegunJob] = {}

    def check(self) -> None:
        """Read what was written since the last check, and end the jobs that were silent for too long."""
        for event in self._reader.new():
            self._note(event)
        silent = time.monotonic() - self._patience
        for name in [name for name, job in self._jobs.items() if job.written < silent]:
            self._end(name, self._jobs.pop(name))

    def warn(self, message: str) -> None:
        """Say in the log that it cannot be read: until then nothing that hangs is ended."""
        EventLog(self._log).write("warn", message=f"{message}; jobs that hang are not ended meanwhile")

    def _note(self, event: Event) -> None:
        name = str(event["job"])
        if event["event"] == "end":
            self._jobs.pop(name, None)
        elif event["event"] == "begin":
            if event["host"] == platform.node():  # a farm ends what hangs on its nodes
                self._jobs[name] = _BegunJob(int(event["process"]), event.get("started"), event)
        elif name in self._jobs:
            self._jobs[name] = replace(self._jobs[name], event=event, written=time.monotonic())

    def _end(self, name: str, job: _BegunJob) -> None:
        """End a job. The log says so first: there, the process that waits for the job reads why it ended.

        One that was killed wrote no end, and another process may have its number by now.
        """
        if not is_at_work(job.process, job.start):
            return
        about = {part: job.event.get(part) for part in ("stage", "shot", "quality", "frame")}
        message = f"{name} gave no sign of life for {self._patience:g} s and was ended"
        EventLog(self._log, name).write("hung", **about, message=message)
        end_family(job.process)


Watcher = AbstractContextManager[object]


@dataclass
class Outcome:
    """The outcome of a run. `exit_code` is 0, 1 (some frames failed) or 4 (the machine's fault).

    runs      the names of its rounds: of their plans and event logs
    restored  links that were made again
    fetched   files that came from the remote store
    """

    plan: Plan
    runs: list[str] = field(default_factory=list)
    restored: int = 0
    fetched: int = 0
    events: list[Event] = field(default_factory=list)
    unfinished: bool = False

    @property
    def failures(self) -> list[Event]:
        """Failures, one for each shot, stage and frame; none if the run ended well all the same.

        What the machine refuses, such as more of a full disk, is one failure, whatever jobs met it.
        """
        seen: dict[object, Event] = {}
        for event in self.events:
            if event["event"] == "fail":
                about: object = (event.get("shot"), event.get("stage"), event.get("frame"))
                if self._exit_code(event) == MachineError.exit_code:
                    about = str(event["message"]).rpartition(": ")[2]
                seen.setdefault(about, event)
        return list(seen.values()) if self.unfinished else []

    @property
    def warnings(self) -> list[str]:
        """Warnings of frames that were made, each once."""
        return list(dict.fromkeys(str(e["message"]) for e in self.events if e["event"] == "warn"))

    @property
    def exit_code(self) -> int:
        codes = [self._exit_code(event) for event in self.failures]
        return max(codes, default=FrameError.exit_code) if self.unfinished else 0

    def _exit_code(self, failure: Event) -> int:
        """Return 1 if others of the frame's stage were made; a fault of the machine keeps its code."""
        code = int(failure.get("exit_code", FrameError.exit_code))
        some_failed = failure.get("frame") is not None and self.made(str(failure["stage"]))
        return FrameError.exit_code if some_failed and code != MachineError.exit_code else code

    def made_by_stage(self) -> dict[str, int]:
        """Return how many frames of each stage were computed."""
        return {stage: made for stage in STAGES if (made := self.made(stage))}

    def made(self, stage: str) -> int:
        """Return how many frames of a stage were computed, not reused."""
        return sum(e["event"] == "frame" and e["stage"] == stage and not e["found"] for e in self.events)


def run(
    make_plan: Callable[[], Plan],
    root: Path,
    cores: int,
    watch: Callable[[Plan, EventReader], Watcher],
    profile: Profile | None = None,
    patience: float = PATIENCE,
    wait: bool = False,
) -> Outcome:
    """Plan, restore links, run what is left, until nothing is left or nothing more can be healed.

    watch     a context manager that shows progress while Snakemake works
    profile   where jobs run, by default on this machine
    patience  seconds after which a silent job of this machine is ended, and tried once more
    wait      wait for another run of the same shot and quality

    Raises MachineError where another run holds a lock, the disk refuses, or nothing can be compiled.
    """
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):  # said once, not by each process
        raise MachineError("NUMBA_DISABLE_JIT is set, but flowsculpt needs compiled kernels; unset it")
    clock = _RunClock()
    store, plan = Store(root), make_plan()
    locks, names = Locks(root), plan.lock_names if plan.jobs else {}
    with locks.hold_with_writers(wait), locks.hold(names, wait) as waited:
        sweep(store)
        store.upload_missed()
        PlanningCache(root).prune()
        if waited:
            clock, plan = _RunClock(), make_plan()
        outcome, policy = Outcome(plan), RetryPolicy(cores)
        rounds = _Rounds(make_plan, root, watch, profile or Profile.local(), patience, clock)
        try:
            rounds.run(outcome, policy)
        finally:
            summarise(root)
        store.upload_missed()
        outcome.unfinished = bool(outcome.plan.jobs)
        outcome.events += policy.failures
        if not outcome.unfinished:
            remove_checkpoints(store, outcome.plan.raw_places)
        return outcome


@dataclass(frozen=True)
class _RunClock:
    """When a round of a run began, with the planning before it, and the CPU seconds until then."""

    began: float = field(default_factory=time.time)
    cpu_before: float = field(default_factory=cpu_seconds)


@dataclass
class _Rounds:
    """The rounds of a run; its values are the arguments of `run`."""

    make_plan: Callable[[], Plan]
    root: Path
    watch: Callable[[Plan, EventReader], Watcher]
    profile: Profile
    patience: float
    clock: _RunClock

    def run(self, outcome: Outcome, policy: RetryPolicy) -> None:
        """Execute the plan of an outcome, and plan again while that may help."""
        may_retry, store = True, Store(self.root)
        while True:
            outcome.plan, fetched = with_inputs_here(outcome.plan, self.make_plan, store)
            outcome.fetched += fetched
            outcome.restored += outcome.plan.restore_links(store)
            if not (outcome.plan.jobs and may_retry):
                return
            outcome.plan = outcome.plan.named_last(self.root)
            events = self._execute(outcome.plan, policy.cores)
            outcome.runs.append(outcome.plan.name)
            outcome.events += events
            self.clock = _RunClock()
            outcome.plan = self.make_plan()
            may_retry = policy.allows(events)

    def _execute(self, plan: Plan, cores: int) -> list[Event]:
        """Have Snakemake run a plan; return the events of its log."""
        log, clock = self.root / EVENTS / f"{plan.name}.jsonl", self.clock
        plan.freeze(self.root)
        with disk_errors(log):  # events that cannot be written are lost, and failures with them
            touch(log)
        where = {"host": plan.host, "farm": not self.profile.is_local, "started": start_of(os.getpid())}
        EventLog(log).write("run", time=round(clock.began, 3), cores=cores, **where)
        try:
            running = snakemake.running(plan, self.root, cores, self.profile)  # before any thread is started
            with running as process, self.watch(plan, EventReader(log)), watched(log, self.patience):
                well = process.wait() == 0
        finally:
            EventLog(log).write("ran", cpu=round(cpu_seconds() - clock.cpu_before, 3))
        events = list(EventReader(log).new())
        if well or {"fail", "healed", "hung", "killed"} & {event["event"] for event in events}:
            return events
        if not (self.root / plan.file).exists():
            message = f"{plan.file}, by which the jobs work, was deleted; what is left is planned again"
            return [*events, {"event": "healed", "message": message}]
        return events + _unexplained(events, self.root, snakemake.log_of(plan))


def with_inputs_here(plan: Plan, make_plan: Callable[[], Plan], store: Store) -> tuple[Plan, int]:
    """Fetch what a plan shows and only the remote store has; return the plan, and how many files came.

    Where not all of it comes, plan again: the remote store has lost a file, or does not answer any more.
    Raises MachineError where the disk refuses.
    """
    fetched = 0
    while names := plan.remote_names(store):
        came = store.bring_all(names)
        fetched += came
        if came < len(names):
            plan = make_plan()
    return plan, fetched


def _unexplained(events: list[Event], root: Path, log: Path) -> list[Event]:
    """Return events for what no job wrote: killed, refused by disk or farm, or Snakemake failed."""
    ended = {event["job"] for event in events if event["event"] == "end"}
    killed = [e for e in events if e["event"] == "begin" and e["job"] not in ended]
    if not killed:
        message, code = f"the workflow failed; {log} says more", FrameError.exit_code
        refusal = snakemake.refusal(root, root / log)
        if refusal is not None:
            message, code = refusal, MachineError.exit_code
        elif (complaint := snakemake.complaint(root / log)) is not None:
            message, code = f"no job could run: {complaint} {log} says more", MachineError.exit_code
        return [{"event": "fail", "shot": "workflow", "stage": "", "message": message, "exit_code": code}]
    return [{**begun, "event": "killed", "message": f"{begun['job']} was killed"} for begun in killed]
