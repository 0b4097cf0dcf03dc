"""Run a plan: hold its locks, have Snakemake run its jobs, in as many rounds as healing needs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.errors import FrameError, MachineError
from pipeline.production.execution import snakemake
from pipeline.production.execution.recovery import PATIENCE, RetryPolicy, watched
from pipeline.production.planning.plan import Plan
from pipeline.production.planning.profile import Profile
from pipeline.production.request.planning_cache import PlanningCache
from pipeline.production.store.ended_runs import summarise
from pipeline.production.store.event_log import Event, EventLog, EventReader
from pipeline.production.store.locks import making, writing
from pipeline.production.store.paths import EVENTS
from pipeline.production.store.processes import start_of
from pipeline.production.store.remote_store import upload_missed
from pipeline.production.store.store import Store
from pipeline.production.store.unfinished import remove_checkpoints, sweep
from render.base.atomic_write import disk_errors
from render.base.work_clock import cpu_seconds

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

    Raises MachineError where another run holds a lock or the disk refuses.
    """
    clock = _RunClock()
    store, plan = Store(root), make_plan()
    with writing(root, wait), making(root, plan.lock_names if plan.jobs else {}, wait) as waited:
        sweep(store)
        upload_missed(store)
        PlanningCache(root).prune()
        if waited:
            clock, plan = _RunClock(), make_plan()
        outcome, policy = Outcome(plan), RetryPolicy(cores)
        rounds = _Rounds(make_plan, root, watch, profile or Profile.local(), patience, clock)
        try:
            rounds.run(outcome, policy)
        finally:
            summarise(root)
        upload_missed(store)
        outcome.unfinished = bool(outcome.plan.jobs)
        outcome.events += policy.failures
        if not outcome.unfinished:
            remove_checkpoints(store, outcome.plan.raw_places)
        return outcome


class _RunClock:
    """Times a round of a run, from the planning before it."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        self.began, self.cpu_before = time.time(), cpu_seconds()


@dataclass(frozen=True)
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
            self.clock.restart()
            outcome.plan = self.make_plan()
            may_retry = policy.allows(events)

    def _execute(self, plan: Plan, cores: int) -> list[Event]:
        """Have Snakemake run a plan; return the events of its log."""
        log, clock = self.root / EVENTS / f"{plan.name}.jsonl", self.clock
        plan.freeze(self.root)
        with disk_errors(log):  # events that cannot be written are lost, and failures with them
            log.parent.mkdir(parents=True, exist_ok=True)
            log.touch()
        where = {"host": plan.host, "farm": not self.profile.is_local, "started": start_of(os.getpid())}
        EventLog(log).write("run", time=round(clock.began, 3), cores=cores, **where)
        try:
            running = snakemake.running(plan, self.root, cores, self.profile)  # before any thread is started
            with (
                running as process,
                self.watch(plan, EventReader(log)),
                watched(log, self.patience),
            ):
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
