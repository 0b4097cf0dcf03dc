"""What a plan will take: time by what frames took here before, disk space by how large they became."""

from __future__ import annotations

import shutil
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.production.planning.plan import Job, Plan
from pipeline.production.planning.timings import OF_MOTION, Measured, Sample
from pipeline.production.request.turntable import Turntable


@dataclass(frozen=True)
class Estimate:
    """Of a plan.

    seconds       by the clock on so many cores, which nothing else uses
    cores
    core_seconds  by stage
    unmeasured    stages of which nothing was measured here, and which it leaves out
    by            what rendering was estimated by, to be told; nothing where nothing is rendered
    bytes         that the store grows by; None where the size of a file is not known
    free          bytes of the disk
    """

    seconds: float
    cores: int
    core_seconds: Mapping[str, float]
    unmeasured: tuple[str, ...]
    by: str
    bytes: float | None
    free: int

    @property
    def fits(self) -> bool:
        """Whether the disk holds it, as far as that is known."""
        return self.bytes is None or self.bytes < self.free

    def as_data(self) -> dict[str, Any]:
        return {
            "seconds": round(self.seconds, 1),
            "cores": self.cores,
            "core_seconds": {stage: round(taken, 1) for stage, taken in self.core_seconds.items()},
            "unmeasured": list(self.unmeasured),
            "by": self.by,
            "bytes": None if self.bytes is None else round(self.bytes),
            "free_bytes": self.free,
        }


def estimate(plan: Plan, root: Path, cores: int) -> Estimate:
    """What carrying out a plan will take, as far as it was measured under `root`."""
    measured = Measured(root)
    by_stage: dict[str, float] = defaultdict(float)
    chains: dict[int, float] = defaultdict(float)
    unmeasured: dict[str, None] = {}
    samples: dict[str, Sample] = {}
    size: float | None = 0.0
    for job in plan.jobs:
        shot, quality = _about(plan, job)
        sample = measured.seconds(job.stage, shot, quality)
        if sample is None:
            unmeasured[job.stage] = None
        else:
            samples[job.stage] = sample
            taken = sample.seconds * len(job.frames)
            by_stage[job.stage] += taken
            if job.stage in OF_MOTION:
                chains[job.requests[0]] += taken
        each = measured.bytes(job.stage, shot, quality)
        size = None if size is None or each is None else size + each * len(job.frames)
    return Estimate(
        seconds=_clock(by_stage, chains, cores),
        cores=cores,
        core_seconds=dict(by_stage),
        unmeasured=tuple(unmeasured),
        by=_told(samples.get("render")),
        bytes=size,
        free=shutil.disk_usage(next(f for f in (root, *root.parents) if f.exists())).free,
    )


def _clock(by_stage: Mapping[str, float], chains: Mapping[int, float], cores: int) -> float:
    """Shots are simulated side by side, each by one core; films are cut by one; all else is dealt out."""
    motion, film = sum(chains.values()), by_stage.get("film", 0.0)
    rest = sum(by_stage.values()) - motion - film
    return max(max(chains.values(), default=0.0), motion / cores) + rest / cores + film


def _about(plan: Plan, job: Job) -> tuple[str, str]:
    """The shot, as its folder is called, and the quality that a job is for."""
    data = plan.requests[job.requests[0]]
    name, turn = Path(data["source"]["path"]).stem, data["turntable"]
    if turn and job.stage not in OF_MOTION:
        table = Turntable(**turn)
        name = name if table.of_file else f"{name}.{table.at:04d}"
        name = f"{name}/{table.look}" if table.look else name
    return name, data["quality_name"]


def _told(sample: Sample | None) -> str:
    return "" if sample is None else f"{sample.frames} frames of {sample.of}"
