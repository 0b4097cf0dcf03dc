"""Tasks of a render manager: stages of a frozen plan, or some of their frames.

A manager calls them in the order of the stages, as often and as many side by side as it likes, on workers
that see the root, or share a remote store. They take no lock on the shot: each finds what others have made.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from flowsculpt import MachineError, MissingInputError, UsageError
from flowsculpt.api import plural, suggest
from flowsculpt.api.frames import FrameRange, Job, PipelineStage, Plan, Store

OF_PLUGINS = tuple(name for name, stage in PipelineStage.all().items() if stage.plugin)
"""The picture stages of plug-ins, in their order."""

BY_FRAMES = ("render", *OF_PLUGINS, "finish")
"""The stages whose frames several workers may share out."""


@dataclass(frozen=True)
class Part:
    """One of so many equal parts of the frames of a task, by its number from 0 on, as array jobs count."""

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Part:
        """Read `0/8`. Raises UsageError."""
        number, _, count = text.partition("/")
        if not (number.isdecimal() and count.isdecimal() and int(number) < int(count)):
            raise UsageError(
                f"--part {text}: not a part; write its number, counted from 0, and how many parts there are, "
                "such as 0/8 for the first of eight"
            )
        return cls(int(number), int(count))

    def of(self, frames: Sequence[int]) -> Sequence[int]:
        """Return the part of frames; none where there are fewer frames than parts before it."""
        first, end = (n * len(frames) // self.count for n in (self.number, self.number + 1))
        return frames[first:end]


def do(
    root: Path, plan_file: Path, tasks: Sequence[str], threads: int | None = None, part: Part | None = None
) -> int:
    """Do tasks of a plan in a root, one after the other until one fails; return its exit code, or 0.

    tasks    names of stages, `simulate`, of frames of a stage, `render:1-8`, with a shot `A010_cube/render`
    threads  by default those of the plan, and of this machine for some frames of a job
    part     the part to do of the frames that the tasks name

    Raises MissingInputError where the root or the plan is not there, UsageError for a file that is no plan
    and for a task that is not in it, MachineError where this worker has other versions of packages than the
    machine that planned, or the remote store does not take what was made.
    """
    from flowsculpt.api.frames import do_job

    plan_file = plan_file.absolute()
    plan = _plan(plan_file)
    jobs = list(_jobs(plan, plan_file, tasks, part))
    _require_versions(plan)
    _enter(root)
    codes = (do_job(str(plan_file), job, insist=True, threads=threads) for job in jobs)
    code = next(filter(None, codes), 0)
    _upload_rest(root)
    return code


def _require_versions(plan: Plan) -> None:
    """Raise MachineError where this worker would give its files other keys than the machine that planned."""
    here, sources = Plan.versions_here(), [request.source for request in plan.requests]
    shots = "".join(text for source in sources for _, text in (("", source.text), *source.beside))
    others = [
        f"{name} {here[name]} (planned with {version})"
        for name, version in plan.versions.items()
        if here.get(name, version) != version and (not name.startswith("plug-in ") or name[8:] in shots)
    ]
    if others:
        raise MachineError(
            f"{platform.node()} has {', '.join(others)}: its results would count as missing where the plan "
            "was made. "
            "Install the same version of flowsculpt and its packages on both, from requirements.lock"
        )


def _upload_rest(root: Path) -> None:
    """Upload what the remote store did not take at first: workers on other disks see it nowhere else."""
    store = Store(root)
    if unsent := store.upload_missed().unsent:
        raise MachineError(
            f"{store.url}: it did not accept {plural(unsent, 'file')}, which other workers would miss; "
            "run the task again once it answers; the files stay in this root"
        )


def _enter(root: Path) -> None:
    """Make the root the working folder. Where a remote store is named, it may be a new one."""
    try:
        if Store(root).url is not None:
            root.mkdir(parents=True, exist_ok=True)
        os.chdir(root)
    except OSError as error:
        raise MissingInputError(f"{root}: this worker does not see the root ({error.strerror})") from None


def _plan(file: Path) -> Plan:
    try:
        return Plan.thaw(file)
    except OSError as error:
        raise MissingInputError(
            f"{file}: this worker does not see the plan ({error.strerror}); flowsculpt export plan writes one"
        ) from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise UsageError(f"{file}: not a plan; flowsculpt export plan SHOT writes one") from None


def _jobs(plan: Plan, file: Path, tasks: Sequence[str], part: Part | None) -> Iterator[str]:
    """Yield the names of the plan's jobs, or of some frames of them, that tasks stand for."""
    for task in tasks:
        if any(job.name == task for job in plan.jobs):
            yield task
            continue
        chosen, frames = _named(plan, file, task)
        if part is not None and chosen[0].stage not in BY_FRAMES:
            raise UsageError(
                f"--part: {task} cannot be divided; only {' and '.join(BY_FRAMES)} are done in parts. Leave "
                "it out"
            )
        requests = {job.requests[0] for job in chosen}
        if not frames and part is None and (chosen[0].stage not in BY_FRAMES or len(requests) == len(chosen)):
            yield from (job.name for job in chosen)
            continue
        planned = sorted({number for job in chosen for number in job.frames})
        asked = FrameRange.parse(frames).numbers if frames else planned
        if others := [number for number in asked if number not in planned]:
            known = FrameRange.of(planned)
            raise UsageError(
                f"{task}: frames {FrameRange.of(others)} are not in {file.name}, which has {known}; "
                "export the plan again for more"
            )
        yield from _some_frames(chosen, asked if part is None else part.of(asked))


def _some_frames(jobs: Sequence[Job], frames: Sequence[int]) -> Iterator[str]:
    """Yield the names of those parts of jobs of one stage that make frames, in the order of these."""
    for place in dict.fromkeys(job.requests[0] for job in jobs):
        of_request = [job for job in jobs if job.requests[0] == place]
        known = {number for job in of_request for number in job.frames}
        if numbers := [number for number in frames if number in known]:
            yield f"{of_request[0].name}:{FrameRange(tuple(numbers))}"


def _named(plan: Plan, file: Path, task: str) -> tuple[list[Job], str]:
    """Return the jobs that a task names, and the frames that follow. Raises UsageError for other names."""
    words, _, frames = task.partition(":")
    shot, slash, stage = words.rpartition("/")
    shots = dict.fromkeys(request.name for request in plan.requests)
    if slash and shot not in shots:
        raise UsageError(f"{task}: {file.name} has no shot {shot!r}. {suggest(shot, shots)}")
    stages = dict.fromkeys(job.stage for job in plan.jobs)
    if stage not in stages:
        raise UsageError(f"{task}: {file.name} has no stage {stage!r}. {suggest(stage, stages)}")
    if frames and not slash and len(shots) > 1:
        raise UsageError(
            f"{task}: {file.name} has several shots; name the one whose frames these are: "
            f"{next(iter(shots))}/{task}"
        )
    of_stage = [job for job in plan.jobs if job.stage == stage]
    if not slash:
        return of_stage, frames
    return [job for job in of_stage if plan.requests[job.requests[0]].name == shot], frames
