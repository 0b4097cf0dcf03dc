"""The context of a job: how a task makes, reads and reports files."""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pipeline.errors import FlowsculptError, FrameError
from pipeline.production.planning.plan import Job, Plan, movie_record, write_manifest
from pipeline.production.request.planning_cache import PlanningCache
from pipeline.production.stages import STAGES
from pipeline.production.store.event_log import EventLog, EventReader
from pipeline.production.store.paths import EVENTS
from pipeline.production.store.store import Key, Store
from render.base.atomic_write import atomic_write

if TYPE_CHECKING:
    from pipeline.production.request.keys import PictureKeys
    from pipeline.production.request.render_request import RenderRequest

T = TypeVar("T")

SIGN_SECONDS = 5.0
"""Interval at which a job that waits for another run says so."""

ENVIRONMENT = 4
"""The exit code of the machine's faults, which further frames would meet as well."""


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
        return cls(root, plan, plan.job(job_name), EventLog(root / EVENTS / plan.log_name, job_name))

    def failed_for_good(self) -> bool:
        """Tell whether an earlier attempt at this job said why it failed, as another would.

        A killed one said nothing, and what one machine refuses another may allow.
        """
        log = EventReader(self.root / EVENTS / f"{self.plan.name}.jsonl")
        told = [event for event in log.new(self.job.name) if event["job"] == self.job.name]
        fails = [event.get("exit_code") for event in told if event["event"] == "fail"]
        kinds = {event["event"] for event in told}
        known = "healed" in kinds or (bool(fails) and "end" in kinds)
        return known and ENVIRONMENT not in fails

    def failed(self, stage: str) -> set[int]:
        """The frames of this job's pictures that failed at an earlier stage of this run."""
        quality = self.plan.requests[self.job.requests[0]]["quality_name"]
        about = {"event": "fail", "stage": stage, "shot": self.subject, "quality": quality}
        told = EventReader(self.root / EVENTS / f"{self.plan.name}.jsonl").new("fail")
        return {e["frame"] for e in told if e.get("frame") is not None and about.items() <= e.items()}

    def bring_inputs_to_now(self) -> None:
        """Give inputs that are from the future, by this host's clock, the present time. Clocks of a farm
        differ, and Snakemake takes results that are older than their inputs for a mistake."""
        now = time.time()
        for path in (self.root / output for output in self.plan.all_inputs(self.job)):
            with suppress(OSError):
                if path.stat().st_mtime > now:
                    os.utime(path)

    def write_done_file(self) -> None:
        """Write the done-file of the job, or, as a movie is shown itself, by which key Snakemake knows it."""
        if not self.job.output:  # a part of a job, which an Open Job Description runs
            return
        kind = STAGES[self.job.stage].makes
        if kind == "movie":
            with atomic_write(self.root / movie_record(self.job.output)) as draft:
                draft.write_text(self.job.key)
        else:
            keys = [key for key in self._keys() if self.store.holds(kind, key)]
            write_manifest(self.root / self.job.output, kind, keys)

    def _keys(self) -> list[Key]:
        """Return the keys of what the job makes."""
        request, frames = self.request, self.job.frames
        if self.job.stage == "frame_camera":
            return [request.cameras_key]
        if self.job.stage in ("simulate", "smooth_normals"):
            key = request.mesh_key if self.job.stage == "simulate" else request.normals_key
            return [key(number) for number in frames]
        keys = self.picture_keys(request)
        if self.job.stage == "render":
            return [keys[number].raw for number in frames]
        made = [keys[number].frame for number in frames]
        return (
            made if self.job.stage == "finish" else [request.still_key(self.job.stage, key) for key in made]
        )

    @property
    def is_forced(self) -> bool:
        """True if the job makes again what the store holds."""
        return self.job.stage in self.plan.force

    def has(self, kind: str, key: Key) -> bool:
        """Tell whether the store holds a file; for a forced job, one that was stored since it was planned."""
        if not self.store.holds(kind, key):
            return False
        if not self.is_forced:
            return True
        return self.store.stored_at(kind, key) >= (self.root / self.plan.file).stat().st_mtime_ns

    @property
    def store(self) -> Store:
        return Store(self.root)

    @cached_property
    def request(self) -> RenderRequest:
        """The take of a job that has one."""
        return self.requests[0]

    @cached_property
    def requests(self) -> list[RenderRequest]:
        from pipeline.production.request.render_request import (
            RenderRequest,  # a second's work, which who only watches never needs
        )

        ledger = PlanningCache(self.root)
        return [RenderRequest.from_data(self.plan.requests[place], ledger) for place in self.job.requests]

    def picture_keys(self, request: RenderRequest) -> PictureKeys:
        """The keys of a take's pictures. Raises FrameError where its cameras have not been found."""
        keys = request.picture_keys(self.store)
        if keys is None:
            raise FrameError(f"{request.folders.cameras()} is gone; run again to frame the shot again")
        return keys

    def make(self, kind: str, key: Key, target: Path, write: Callable[[Path], object]) -> bool:
        """Have the file of `key` made unless the store holds it, and show it; whether it was there."""
        found = self.has(kind, key)
        if not found:
            self.store.put(kind, key, write, replace=self.is_forced)
        self.store.link(kind, key, target, replace=self.is_forced and not found)
        return found

    def read(self, kind: str, key: Key, target: Path, reader: Callable[[Path], T]) -> T:
        """A stored file, read whole. A corrupt one is forgotten, so that the next round makes it anew."""
        path = self.store.path(kind, key)
        if not path.exists():
            with suppress(OSError):
                list(path.parent.iterdir())  # a network file system may remember that it was not there
        try:
            return self.store.read(kind, key, target, reader)
        except FrameError:
            self.log.write("healed", message=f"{target} is gone or cannot be read; it is made again")
            raise

    def survey(self, numbers: Iterable[int], read: Callable[[int], object]) -> None:
        """Once one file was found corrupt, read the others too: the next round makes them all anew."""
        for number in numbers:
            with suppress(FrameError):
                read(number)

    def each(self, frames: Iterable[int], work: Callable[[int], bool]) -> bool:
        """Do `work(number)` for every frame and tell; a frame that fails leaves the others to be made.

        `work` returns whether the frame had been there already. Returns whether all went well.
        """
        well = True
        for number in frames:
            self._log("start", number)
            started = time.perf_counter()
            try:
                found = work(number)
            except FlowsculptError as error:
                self.fail(error, number)
                well = False
                if error.exit_code == ENVIRONMENT:
                    break
            else:
                self.tell(number, found, time.perf_counter() - started)
        return well

    def tell(self, number: int, found: bool, seconds: float) -> None:
        self._log("frame", number, found=found, seconds=round(seconds, 4))

    def begin(self) -> None:
        """This process works on the job from now on: by it the job is ended should it hang."""
        here = {"process": os.getpid(), "host": platform.node()}
        self.log.write("begin", stage=self.job.stage, threads=self.job.threads, **here)

    def waits(self) -> None:
        """Give a sign of life while another run makes the same files."""
        if time.monotonic() - self._waits[0] > SIGN_SECONDS:
            self._waits[0] = time.monotonic()
            self.log.write("waits", stage=self.job.stage)

    @cached_property
    def _waits(self) -> list[float]:
        """When the last sign was given."""
        return [0.0]

    def passed(self, number: int, done: int, most: int) -> None:
        """So many passes of a picture have been rendered, of at most so many."""
        self._log("pass", number, done=done, most=most)

    @property
    def _place(self) -> str | None:
        """The folder of the pictures that the job is about."""
        if self.job.stage == "film":
            return None
        return (self.request.folders.home / self.request.quality_name).as_posix()

    def warn(self, number: int, message: str) -> None:
        """Something that a frame is made in spite of."""
        print(message, file=sys.stderr)
        self._log("warn", number, message=message)

    def resumed(self, number: int, passes: int) -> None:
        """A frame went on from where its passes had been kept."""
        self._log("resumed", number, passes=passes)

    def renewed(self, held: float, most: float | None) -> None:
        """This process holds so many MiB, more than it may, and another one makes the rest."""
        message = f"the renderer grew to {held:.0f} MiB; a fresh one goes on"
        self._log("renewed", message=message, held_mib=held, most_mib=most)

    def fail(self, error: FlowsculptError, number: int | None = None) -> None:
        print(error, file=sys.stderr)
        self._log("fail", number, message=str(error), exit_code=error.exit_code)

    def killed(self, signal: str) -> None:
        """Something else ended a process of this job, as the system does where memory runs out."""
        self._log("killed", message=f"{self.job.stage} of {self.subject} was ended by {signal}")

    def _log(self, event: str, number: int | None = None, **facts: Any) -> None:
        quality = self.plan.requests[self.job.requests[0]]["quality_name"]
        about = {"stage": self.job.stage, "shot": self.subject, "quality": quality, "frame": number}
        self.log.write(event, **about, **facts)

    @property
    def subject(self) -> str:
        """The shot's name, or `film`."""
        return "film" if self.job.stage == "film" else self.request.subject
