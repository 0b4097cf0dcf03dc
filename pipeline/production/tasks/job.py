"""The context of a job: how a task makes, reads and reports files."""

from __future__ import annotations

import logging
import os
import platform
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from flowsculpt.pipeline.errors import FlowsculptError, FrameError
from flowsculpt.pipeline.production.planning.plan import Job, Plan, movie_record, write_manifest
from flowsculpt.pipeline.production.stages import STAGES
from flowsculpt.pipeline.production.store.event_log import Event, EventLog, EventReader
from flowsculpt.pipeline.production.store.paths import EVENTS
from flowsculpt.pipeline.production.store.remote_store import LOG
from flowsculpt.pipeline.production.store.store import Key, Store
from flowsculpt.render.base.atomic_write import write_text
from flowsculpt.render.base.processes import start_of
from flowsculpt.render.base.root_files import guard, set_time
from flowsculpt.render.base.work_clock import Timing, WorkClock, cpu_seconds

if TYPE_CHECKING:
    from flowsculpt.pipeline.production.request.keys import PictureKeys
    from flowsculpt.pipeline.production.request.render_request import RenderRequest
    from flowsculpt.render.scene.aovs import RenderedFrame

T = TypeVar("T")

SIGN_SECONDS = 5.0
"""Interval at which a job that waits for another run says so."""

ENVIRONMENT = 4
"""The exit code of the machine's faults, which further frames would meet as well."""

MOST_FAULTS = 3
"""Frames of a stage at which a host of a farm may fail before it is left out of the rest of a run."""


def this_host() -> str:
    """Return the name of this host, as SLURM knows it where that has started the process."""
    return os.environ.get("SLURMD_NODENAME") or platform.node()


def faults_of_hosts(root: Path, plan: Plan) -> dict[tuple[str, str], set[tuple[str, str, int]]]:
    """Return the frames (shot, quality, number) at which hosts failed while a plan is run, by host and stage.

    Only what a machine is to blame for counts: where a mesh is bad, or the disk of the root is full, all
    hosts fail. Stages that only the host of the plan does do not: no other can take them over, and SLURM may
    not know that host.
    """
    failed = defaultdict(set)
    for event in EventReader(root / EVENTS / f"{plan.name}.jsonl").new("fail"):
        is_its_own = event["event"] == "fail" and event.get("exit_code") == ENVIRONMENT
        is_its_own = is_its_own and not event.get("is_shared")
        if is_its_own and event.get("frame") is not None and STAGES[event["stage"]].on_farm:
            frame = event["shot"], event["quality"], event["frame"]
            failed[event.get("host", ""), event["stage"]].add(frame)
    return failed


@dataclass(frozen=True)
class ReportedFailures:
    """What a run has reported so far, on all hosts, about failures of one of its jobs."""

    root: Path
    plan: Plan
    job: Job

    def is_final(self) -> bool:
        """Tell whether an earlier attempt at the job said why it failed, as another would.

        A killed one said nothing, and what one machine refuses another may allow; one that lacks the variant
        does not get it by a second attempt.
        """
        events = [event for event in self._events(self.job.name) if event["job"] == self.job.name]
        if any(event["event"] == "unfit" and event["host"] == this_host() for event in events):
            return True
        codes = [event.get("exit_code") for event in events if event["event"] == "fail"]
        kinds = {event["event"] for event in events}
        known = "healed" in kinds or (bool(codes) and "end" in kinds)
        return known and ENVIRONMENT not in codes

    def is_host_left_out(self) -> bool:
        """Tell whether this host of a farm has failed at so many frames that it gets no more of the stage."""
        return self.plan.farm and len(self._of_host()) >= MOST_FAULTS

    def reason_to_leave(self) -> str | None:
        """Return why this host of a farm leaves the job to others; None where it does not."""
        if not self.plan.farm:
            return None
        failed = self._of_host()
        if self.is_host_left_out():
            frames = f"{len(failed)} frames of {self.job.stage}"
            return f"{this_host()} has failed at {frames} and is left out of it"
        shot, quality = subject_and_quality(self.plan, self.job)
        again = sorted({(shot, quality, number) for number in self.job.frames} & failed)
        if not again:
            return None
        return f"{this_host()} has failed at frame {again[0][2]} of {shot}; a host gets one try at it"

    def frames(self, stage: str) -> set[int]:
        """Return the frames of the job's pictures that failed at an earlier stage.

        Those that another host has made since do not count.
        """
        shot, quality = subject_and_quality(self.plan, self.job)

        def numbers(event: str) -> set[int]:
            about = {"event": event, "stage": stage, "shot": shot, "quality": quality}
            events = (e for e in self._events(event) if about.items() <= e.items())
            return {e["frame"] for e in events if e.get("frame") is not None}

        lost = numbers("fail")
        return lost - numbers("frame") if lost else lost

    def _of_host(self) -> set[tuple[str, str, int]]:
        return faults_of_hosts(self.root, self.plan)[this_host(), self.job.stage]

    def _events(self, word: str) -> Iterator[Event]:
        """Yield the events of this run that hold a word, those of other hosts too."""
        return EventReader(self.root / EVENTS / f"{self.plan.name}.jsonl").new(word)


def subject_and_quality(plan: Plan, job: Job) -> tuple[str, str]:
    """Return the title of the pictures that a job works for, or `film`, and their quality."""
    request = plan.requests[job.requests[0]]
    return "film" if job.stage == "film" else request.folders.title, request.quality_name


@dataclass(frozen=True)
class Context:
    """One job of a plan, at work in `root`."""

    root: Path
    plan: Plan
    job: Job
    log: EventLog

    @classmethod
    def of(cls, root: Path, plan: Plan, job_name: str) -> Context:
        """Return the context of a job that writes to the plan's event log."""
        guard(root)
        return cls(root, plan, plan.job(job_name), EventLog(root / EVENTS / plan.log_name, job_name))

    @property
    def failures(self) -> ReportedFailures:
        """What the run has reported of the job's failures."""
        return ReportedFailures(self.root, self.plan, self.job)

    # What the job makes

    @property
    def store(self) -> Store:
        return Store(self.root)

    @property
    def request(self) -> RenderRequest:
        """The request that the job works for."""
        return self.requests[0]

    @cached_property
    def requests(self) -> list[RenderRequest]:
        return [self.plan.requests[place].with_cache(self.root) for place in self.job.requests]

    @property
    def subject(self) -> str:
        """The title of the pictures that the job works for, or `film`."""
        return subject_and_quality(self.plan, self.job)[0]

    @cached_property
    def _about(self) -> dict[str, Any]:
        """What events of the job are about."""
        shot, quality = subject_and_quality(self.plan, self.job)
        return {"stage": self.job.stage, "shot": shot, "quality": quality}

    def picture_keys(self, request: RenderRequest) -> PictureKeys:
        """Return the keys of a request's pictures. Raises FrameError where its cameras are not known."""
        keys = request.keys.pictures(self.store)
        if keys is None:
            raise FrameError(f"{request.folders.cameras()} is missing; run again to frame the shot again")
        return keys

    # Files

    @property
    def is_forced(self) -> bool:
        """True if the job makes again what the store holds."""
        return self.job.stage in self.plan.force

    def has(self, kind: str, key: Key) -> bool:
        """Tell whether a file is here, fetched perhaps; for a forced job, one stored since it was planned."""
        if not self.is_forced:
            return self.store.bring(kind, key)
        return self.store.stored_at(kind, key) >= (self.root / self.plan.file).stat().st_mtime_ns

    def make(self, kind: str, key: Key, target: Path, write: Callable[[Path], object]) -> bool:
        """Make the file of `key` by `write` unless the store has it, and show it; return whether it had."""
        found = self.has(kind, key)
        if not found:
            self.store.put(kind, key, write, replace=self.is_forced)
        self.store.link(kind, key, target, replace=self.is_forced and not found)
        return found

    def read(self, kind: str, key: Key, target: Path, reader: Callable[[Path], T]) -> T:
        """Read a stored file whole. A corrupt one is evicted, so that the next round makes it again."""
        path = self.store.path(kind, key)
        if not path.exists():
            with suppress(OSError):
                list(path.parent.iterdir())  # a network file system may remember that it was not there
        try:
            return self.store.read(kind, key, target, reader)
        except FrameError:
            self.log.write("healed", message=f"{target} is missing or cannot be read; it is made again")
            raise

    def read_picture(
        self, request: RenderRequest, kind: str, number: int, key: Key, shown_as: str = ""
    ) -> tuple[RenderedFrame, dict[str, Any]]:
        """Read the layers and the header of a raw picture or a finished frame.

        shown_as  the stage of a plug-in that made a raw picture
        """
        from flowsculpt.pipeline.production.store import readers  # loads numpy

        reader = readers.picture(key, request.pictures.quality.rendered_size)
        return self.read(kind, key, request.place(shown_as or kind, number), reader)

    def survey(self, numbers: Iterable[int], read: Callable[[int], object]) -> None:
        """Read the other files too once one was found corrupt: the next round makes all of these again."""
        for number in numbers:
            with suppress(FrameError):
                read(number)

    def for_each(self, frames: Iterable[int], work: Callable[[int], bool]) -> bool:
        """Call `work(number)` for every frame and report it; a frame that fails leaves the others to be made.

        `work` returns whether the frame was there already. Return whether all went well.
        """
        well = True
        for number in frames:
            self.write("start", number)
            clock = WorkClock()
            try:
                found = work(number)
            except FlowsculptError as error:
                self.fail(error, number)
                well = False
                if error.exit_code == ENVIRONMENT:
                    if self.failures.is_host_left_out():
                        fact = f"{this_host()} has failed at {MOST_FAULTS} frames of {self.job.stage}"
                        fact = f"{fact} and is left out of it for the rest of the run"
                        self.write("warn", message=f"{fact}; flowsculpt doctor there says more")
                    break
            else:
                self.report(number, found, clock.lap())
        return well

    # Events

    def write(self, event: str, number: int | None = None, **facts: Any) -> None:
        """Write an event of the job, or of one of its frames."""
        self.log.write(event, **self._about, frame=number, **facts)

    def begin(self, after: int) -> None:
        """Say that this process works on the job from now on: the watchdog ends it should it hang.

        after  the exit code of the process that did so before; 0 for the first
        """
        process = os.getpid()
        where = {"process": process, "started": start_of(process), "host": platform.node(), "after": after}
        self.log.write("begin", stage=self.job.stage, threads=self.job.threads, **where)

    def waits(self) -> None:
        """Give a sign of life while another run makes the same files."""
        if time.monotonic() - self._last_sign[0] > SIGN_SECONDS:
            self._last_sign[0] = time.monotonic()
            self.log.write("waits", stage=self.job.stage)

    @cached_property
    def _last_sign(self) -> list[float]:
        return [0.0]

    def report(self, number: int, found: bool, taken: Timing) -> None:
        """Report a frame that is made, or was there already."""
        self.write("frame", number, found=found, seconds=round(taken.seconds, 4), cpu=round(taken.cpu, 4))

    def report_work(self, cpu: float) -> None:
        """Report CPU seconds of the stage that belong to none of the job's frames."""
        self.log.write("work", stage=self.job.stage, cpu=round(cpu, 4))

    def end(self) -> None:
        """Report that the job has ended, well or not."""
        self.log.write("end", stage=self.job.stage, cpu=cpu_of_job())

    def warn(self, number: int, message: str) -> None:
        """Warn about a fault that does not fail a frame."""
        self.write("warn", number, message=message)
        with suppress(OSError):  # the job's log may lie on a full disk
            print(message, file=sys.stderr, flush=True)

    def fail(self, error: FlowsculptError, number: int | None = None) -> None:
        """Report the error of the job, or of one of its frames."""
        full = getattr(error, "full_disk", None)
        facts = {"is_shared": True} if full and full.resolve().is_relative_to(self.root.resolve()) else {}
        self.write("fail", number, message=str(error), exit_code=error.exit_code, host=this_host(), **facts)
        with suppress(OSError):  # the job's log may lie on a full disk
            print(error, file=sys.stderr, flush=True)

    def refuse(self, error: FlowsculptError) -> None:
        """Report that this node cannot do the job, and that the job ends with that; another node may."""
        self.fail(error)
        self.log.write("unfit", host=this_host())
        self.end()


def bring_inputs_to_now(context: Context) -> None:
    """Give the inputs of a job that are from the future, by this host's clock, the present time.

    Clocks of a farm differ, and Snakemake takes results that are older than their inputs for a mistake.
    """
    now = time.time()
    for path in (context.root / output for output in context.plan.all_inputs(context.job)):
        with suppress(OSError):
            if path.stat().st_mtime > now:
                set_time(path, now)


def write_done_file(context: Context) -> None:
    """Write the done-file of the job, or, as a movie is shown itself, by which key Snakemake knows it."""
    if not context.job.output:  # a part of a job, which an Open Job Description runs
        return
    kind = STAGES[context.job.stage].makes
    if kind == "movie":
        write_text(context.root / movie_record(context.job.output), context.job.key)
    else:
        keys = [key for key in _made_keys(context) if context.store.holds(kind, key)]
        write_manifest(context.root / context.job.output, kind, keys)


def _made_keys(context: Context) -> list[Key]:
    """Return the keys of what the job makes."""
    request, stage, frames = context.request, context.job.stage, context.job.frames
    if stage == "frame_camera":
        return [request.keys.cameras]
    if stage in ("simulate", "smooth_normals"):
        return [(request.keys.mesh if stage == "simulate" else request.keys.normals)(n) for n in frames]
    keys = context.picture_keys(request)
    if stage == "render":
        return [keys[number].raw for number in frames]
    if STAGES[stage].plugin:
        return [keys[number].staged[stage] for number in frames]
    made = [keys[number].frame for number in frames]
    return made if stage == "finish" else [request.keys.still(stage, key) for key in made]


_PROCESS_CLOCK = [0.0]
"""CPU seconds of this process that `cpu_of_job` has returned; a process may do several jobs in turn."""


def cpu_of_job() -> float:
    """Return the CPU seconds of this process since the last call, at first since it was started."""
    before, _PROCESS_CLOCK[0] = _PROCESS_CLOCK[0], cpu_seconds()
    return round(_PROCESS_CLOCK[0] - before, 4)


class _StoreWarnings(logging.Handler):
    """Writes warnings of the remote store to the event log of a job."""

    def __init__(self, context: Context) -> None:
        super().__init__(logging.WARNING)
        self._context = context

    def emit(self, record: logging.LogRecord) -> None:
        self._context.write("warn", message=record.getMessage())


def report_store_warnings(context: Context) -> None:
    """Report what the remote store warns of from now on, as warnings of the job."""
    LOG.handlers, LOG.propagate = [_StoreWarnings(context)], False
