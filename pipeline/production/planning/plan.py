"""The plan: which jobs are needed, decided by keys, frozen to a file that Snakemake and the tasks read.

Planning walks back from what was asked for. A link that shows the right store entry needs nothing; an
entry in the store needs its link; anything else needs a job, and that job's inputs in turn. A plan thus
holds only necessary jobs, and none when all is done.
"""

from __future__ import annotations

import json
import os
import platform
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.frames import FrameRange
from pipeline.production.keys.digest import Key
from pipeline.production.planning.needs import UNMEASURED, Needs
from pipeline.production.store.paths import MARKS, PLANS
from pipeline.production.store.store import Store
from render.base.atomic_write import disk_errors

if TYPE_CHECKING:
    from pipeline.production.planning.profile import Share

BATCH = 256
"""Frames a process renders at most before it gives its memory back."""

FEWEST = 4
"""Frames that are not worth the start of a second process: one renders them on all cores."""

LAST = 64
"""Frames of a batch from which on batches become no smaller, while there are more of them than cores."""


FARMED = ("simulate", "render", "finish")
"""The tasks that a farm's nodes do, one after the other; the rest is too short to wait in a queue for."""


@dataclass(frozen=True)
class Job:
    """One job of the workflow.

    task     the function of `pipeline.production.tasks` that does it
    takes    the places among the plan's takes of those it works on: one, or for the film all
    frames   the numbers it makes, in the order in which it makes them
    inputs   files that it reads, and outputs, those that it shows: known while a plan is made
    urgency  which of those that could go go first: the highest
    after    the names of the jobs that make what it reads: known of a plan that was frozen
    """

    name: str
    task: str
    requests: tuple[int, ...]
    frames: tuple[int, ...]
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    threads: int = 1
    urgency: int = 0
    needs: Needs = UNMEASURED
    after: tuple[str, ...] = ()

    @property
    def stays(self) -> bool:
        """Whether it runs where the plan was made, even if the others go to a farm."""
        return self.task not in FARMED

    @property
    def rule(self) -> str:
        """The rule of the workflow that does it: one for all jobs of a task that are asked for alike."""
        late = f"_{-self.urgency}" if self.urgency < 0 else ""
        return f"{self.task}{late}" + ("" if self.needs.minutes is None else "_timed")

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Job:
        lists = {name: tuple(data[name]) for name in ("requests", "frames", "after")}
        return cls(
            data["name"],
            data["task"],
            threads=data["threads"],
            urgency=data["urgency"],
            needs=Needs(**data["needs"]),
            **lists,
        )


@dataclass(frozen=True)
class Link:
    """A file in the store that should be visible at `target`, relative to the root."""

    kind: str
    key: Key
    target: str


@dataclass(frozen=True)
class Plan:
    """What one run does. `takes` and `film` are plain data from which the tasks rebuild theirs; `notes` are
    lines that the user is to be told; `host` is where it was made."""

    requests: tuple[dict[str, Any], ...]
    film: dict[str, Any] | None
    jobs: tuple[Job, ...]
    links: tuple[Link, ...]
    targets: tuple[str, ...]
    notes: tuple[str, ...] = ()
    name: str = field(default_factory=lambda: time.strftime("%Y%m%d-%H%M%S-") + str(os.getpid()))
    host: str = field(default_factory=platform.node)

    def restore_links(self, store: Store) -> int:
        """Show again what the store holds but a folder has lost; returns how many links were made."""
        lost = [link for link in self.links if not store.shows(link.kind, link.key, Path(link.target))]
        for link in lost:
            store.link(link.kind, link.key, Path(link.target))
        return len(lost)

    @property
    def last_jobs(self) -> list[Job]:
        """Those that no other waits for, of a plan that was frozen."""
        waited_for = {name for job in self.jobs for name in job.after}
        return [job for job in self.jobs if job.name not in waited_for]

    def mark(self, job: Job) -> Path:
        """The file, relative to the root, by which Snakemake sees that a job is done."""
        return MARKS / self.name / job.rule / job.name

    @property
    def log_name(self) -> str:
        """What the event log is called that this host writes while the plan runs."""
        here = platform.node()
        return f"{self.name}.jsonl" if here == self.host else f"{self.name}.{here}.jsonl"

    @property
    def raw_places(self) -> list[Path]:
        """Where the raw pictures of the frames asked for are shown."""
        frames = [Path(target) for target in self.targets if Path(target).parent.name == "frames"]
        return [frame.parents[1] / "raw" / frame.name for frame in frames]

    def freeze(self, root: Path) -> Path:
        """Write the plan under `root`; returns the file, relative to `root`.

        Which job needs which stands in it, and none of the files that they hand on to one another: those are
        known by key. So plans stay small, and Snakemake has one file a job to look after, not one a frame.
        """
        path = PLANS / f"{self.name}.json"
        self.write(root / path)
        return path

    def write(self, path: Path) -> None:
        """Write the plan to a file, which appears whole or not at all."""
        with disk_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            draft = path.with_name(f".{path.stem}.tmp")
            draft.write_text(json.dumps(self._as_data()))
            draft.replace(path)

    def _as_data(self) -> dict[str, Any]:
        maker = {output: job.name for job in self.jobs for output in job.outputs}
        jobs = []
        for job in self.jobs:
            after = dict.fromkeys(maker[file] for file in job.inputs if file in maker)
            jobs.append({**asdict(replace(job, inputs=(), outputs=())), "after": list(after)})
        return {
            "name": self.name,
            "host": self.host,
            "requests": self.requests,
            "film": self.film,
            "jobs": jobs,
            "notes": self.notes,
        }

    @classmethod
    def thaw(cls, path: Path) -> Plan:
        """What Snakemake and the tasks need of a frozen plan: its jobs; its links are restored by then."""
        data = json.loads(path.read_text())
        jobs = tuple(Job.from_data(job) for job in data["jobs"])
        return cls(
            requests=tuple(data["requests"]),
            film=data["film"],
            jobs=jobs,
            links=(),
            targets=(),
            notes=tuple(data["notes"]),
            name=data["name"],
            host=data["host"],
        )

    def job(self, name: str) -> Job:
        """The job of a name; `render:3,17` makes just those of the frames that jobs of the task make."""
        task, _, frames = name.partition(":")
        if not frames:
            return next(job for job in self.jobs if job.name == name)
        from render.mitsuba.engine import available_cores  # what else is in it takes time to import

        whole = next(job for job in self.jobs if job.task == task)
        numbers = tuple(FrameRange.parse(frames))
        return replace(whole, name=name, frames=numbers, threads=available_cores())


def batches(numbers: Sequence[int], cores: int, least: int = FEWEST) -> list[tuple[int, ...]]:
    """Split frames into batches, none longer than BATCH, enough of them to keep the cores busy, but none
    needlessly shorter than `least`.

    They are runs of neighbours, long ones first, for each costs a process the time to start, and shorter ones
    towards the end, so that no core waits long for another (guided self-scheduling: Polychronopoulos & Kuck,
    1987). But where frames come in another order than theirs, as coarse first, they are dealt out, so that
    all cores work on the first ones first.
    """
    cores = max(1, cores)
    share = -(-len(numbers) // cores)
    if list(numbers) == sorted(numbers):
        return list(_guided(numbers, cores, max(least, min(LAST, share))))
    size = min(BATCH, max(least, share))
    hands = [numbers[i : i + size * cores] for i in range(0, len(numbers), size * cores)]
    dealt = (tuple(hand[i::cores]) for hand in hands for i in range(cores))
    return [batch for batch in dealt if batch]


def _guided(numbers: Sequence[int], cores: int, least: int) -> Iterator[tuple[int, ...]]:
    """Batches of half of each core's share of what is left."""
    begun = 0
    while begun < len(numbers):
        size = min(BATCH, max(least, (len(numbers) - begun) // (2 * cores)))
        yield tuple(numbers[begun : begun + size])
        begun += size


def dealt_out(jobs: Sequence[Job], cores: int, share: Share | None = None) -> list[Job]:
    """Jobs, the simulations and the renders each as broad as lets all of their kind go side by side; those
    that go to a farm as broad as `share` says."""
    if share is not None:
        return [replace(job, threads=job.threads if job.stays else share.threads) for job in jobs]
    many = Counter(job.task for job in jobs)
    broad = {task: max(1, cores // many[task]) for task in ("simulate", "render") if many[task]}
    return [replace(job, threads=broad.get(job.task, job.threads)) for job in jobs]
