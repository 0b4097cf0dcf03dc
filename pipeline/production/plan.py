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
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from pipeline.frames import FrameRange
from pipeline.production.disk import disk_faults
from pipeline.production.keys import Key
from pipeline.production.layout import PLANS
from pipeline.production.needs import UNMEASURED, Needs
from pipeline.production.store import Store
from render.engine import available_cores

BATCH = 32
"""Frames a process renders before it gives its memory back."""


FARMED = ("simulate", "render", "finish")
"""The tasks that a farm's nodes do, one after the other; the rest is too short to wait in a queue for."""


@dataclass(frozen=True)
class Job:
    """One rule of the workflow.

    task     the function of `pipeline.production.tasks` that does it
    takes    the places among the plan's takes of those it works on: one, or for the film all
    frames   the numbers it makes
    """

    name: str
    task: str
    takes: tuple[int, ...]
    frames: tuple[int, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    threads: int = 1
    needs: Needs = UNMEASURED

    @property
    def priority(self) -> int:
        """Simulations first: each is the work of one thread, and all the pictures of its shot wait for it."""
        return 1 if self.task == "simulate" else 0

    @property
    def stays(self) -> bool:
        """Whether it runs where the plan was made, even if the others go to a farm."""
        return self.task not in FARMED

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Job:
        lists = {name: tuple(data[name]) for name in ("takes", "frames", "inputs", "outputs")}
        needs = Needs(**data["needs"])
        return cls(data["name"], data["task"], threads=data["threads"], needs=needs, **lists)


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

    takes: tuple[dict[str, Any], ...]
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
        """Write the plan under `root`; returns the file, relative to `root`."""
        path = PLANS / f"{self.name}.json"
        self.write(root / path)
        return path

    def write(self, path: Path) -> None:
        """Write the plan to a file, which appears whole or not at all."""
        with disk_faults(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            draft = path.with_name(f".{path.stem}.tmp")
            draft.write_text(json.dumps(asdict(self)))
            draft.replace(path)

    @classmethod
    def thaw(cls, path: Path) -> Plan:
        data = json.loads(path.read_text())
        jobs = tuple(Job.from_data(job) for job in data["jobs"])
        return cls(
            takes=tuple(data["takes"]),
            film=data["film"],
            jobs=jobs,
            links=tuple(Link(**link) for link in data["links"]),
            targets=tuple(data["targets"]),
            notes=tuple(data["notes"]),
            name=data["name"],
            host=data["host"],
        )

    def job(self, name: str) -> Job:
        """The job of a name; `render:3,17` makes just those of the frames that jobs of the task make."""
        task, _, frames = name.partition(":")
        if not frames:
            return next(job for job in self.jobs if job.name == name)
        whole = next(job for job in self.jobs if job.task == task)
        numbers = tuple(FrameRange.parse(frames))
        return replace(whole, name=name, frames=numbers, inputs=(), outputs=(), threads=available_cores())


def batches(numbers: Sequence[int], cores: int, least: int = 1) -> list[tuple[int, ...]]:
    """Split frames into runs of neighbours, none longer than BATCH, enough of them to keep the cores busy,
    but none needlessly shorter than `least`."""
    size = max(1, min(BATCH, max(least, -(-len(numbers) // max(1, cores)))))
    return [tuple(numbers[i : i + size]) for i in range(0, len(numbers), size)]


def paths(places: Iterable[Path]) -> tuple[str, ...]:
    return tuple(place.as_posix() for place in places)
