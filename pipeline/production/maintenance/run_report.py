"""Report where the time of a run went: its stages, the parts of rendering, and the rest.

Time is counted in core-seconds: a core that a job holds for a second. Those that no frame accounts for went
into starting processes, if a job held the core, or else into planning, Snakemake and waiting.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import MissingInputError
from pipeline.production.planning.timings import read_statistics
from pipeline.production.stages import STAGES
from pipeline.production.store.event_log import Event, EventReader, logs_of
from pipeline.production.store.paths import EVENTS

STARTING, WAITING = "starting", "waiting"
"""Core-seconds that no frame accounts for."""

_PARTS = {
    "preparing": "preparing",
    "building": "building scenes",
    "rendering": "light and auxiliary AOVs",
    "reading and writing": "reading and writing",
}
"""Parts of rendering, as statistics name them."""

LABELS = {
    **{name: stage.doing for name, stage in STAGES.items()},
    **{name: f"rendering: {part}" for name, part in _PARTS.items()},
    STARTING: "starting processes",
    WAITING: "planning, Snakemake, waiting",
}


@dataclass(frozen=True)
class RunReport:
    """The time of one run, by what it went into.

    seconds       by the clock
    core_seconds  by what they went into (see LABELS)
    frames        made, by stage
    """

    run: str
    seconds: float
    cores: int
    core_seconds: Mapping[str, float]
    frames: Mapping[str, int]

    @classmethod
    def of(cls, root: Path, run: str, cores: int) -> RunReport:
        """Return the report of a run; `cores` is used if its log does not name them."""
        events = list(EventReader(root / EVENTS / f"{run}.jsonl").new())
        cores = next((int(event["cores"]) for event in events if event["event"] == "run"), cores)
        times = [float(event["time"]) for event in events]
        seconds = max(times, default=0.0) - min(times, default=0.0)
        threads = {
            event["job"]: int(event.get("threads", 1)) for event in events if event["event"] == "begin"
        }
        made = [event for event in events if event["event"] == "frame"]
        spent: dict[str, float] = defaultdict(float)
        for event in made:
            taken = float(event["seconds"]) * threads.get(event["job"], 1)
            for what, share in _parts(root, event, taken).items():
                spent[what] += share
        spans = _held(events, max(times, default=0.0))
        held = sum((end - begin) * threads.get(job, 1) for job, begin, end in spans)
        spent[STARTING] = max(0.0, held - sum(spent.values()))
        spent[WAITING] = max(0.0, seconds * cores - sum(spent.values()))
        frames = Counter(str(event["stage"]) for event in made if not event["found"])
        return cls(run, seconds, cores, dict(spent), dict(frames))

    @property
    def shares(self) -> dict[str, float]:
        """Fractions of all core-seconds of the run, in the order of LABELS."""
        whole = max(self.seconds * self.cores, sum(self.core_seconds.values()), 1e-9)
        return {
            what: self.core_seconds[what] / whole for what in LABELS if self.core_seconds.get(what, 0.0) > 0.0
        }

    def as_data(self) -> dict[str, Any]:
        return {
            "run": self.run,
            "seconds": round(self.seconds, 3),
            "cores": self.cores,
            "core_seconds": {what: round(taken, 3) for what, taken in self.core_seconds.items()},
            "frames": dict(self.frames),
        }

    def in_brief(self) -> str:
        """Return the largest parts, in one line."""
        largest = sorted(self.shares.items(), key=lambda part: -part[1])[:4]
        return ", ".join(f"{LABELS[what]} {share:.0%}" for what, share in largest)


def named_run(root: Path, name: str | None) -> str:
    """Return a run by its name, or the last. Raises MissingInputError where there is none."""
    known = [log.stem for log in logs_of(root)]
    if name is None and known:
        return known[-1]
    if name in known:
        return str(name)
    if not known:
        raise MissingInputError(f"{root / EVENTS}: no run has left a log here; flowsculpt render makes one")
    raise MissingInputError(
        f"{root / EVENTS}: no run is called {name!r}; the last ones are {', '.join(known[-3:])}"
    )


def statistics_of(root: Path, event: Event) -> Path:
    """Return the statistics file of a rendered frame. Raises KeyError for logs that do not name it."""
    shot: str = event["shot"]
    place = Path(event["quality"]) / "statistics"
    homes = (root / "renders" / shot, root / "renders" / "turntable" / shot)
    files = [home / place / f"{shot}.{event['frame']:04d}.json" for home in homes]
    found = [file for file in files if file.exists()]
    return found[0] if found else files[0]


def _held(events: Iterable[Event], last: float) -> Iterator[tuple[str, float, float]]:
    """Yield job, begin and end of the times that jobs held their cores; a killed job, until the log ends."""
    begun: dict[str, float] = {}
    for event in events:
        if event["event"] == "begin":
            begun.setdefault(event["job"], float(event["time"]))
        elif event["event"] == "end" and event["job"] in begun:
            yield event["job"], begun.pop(event["job"]), float(event["time"])
    for job, begin in begun.items():
        yield job, begin, last


def _parts(root: Path, event: Event, taken: float) -> Mapping[str, float]:
    """Split the core-seconds of a frame: those of a rendered one by its statistics, if they are there."""
    stage = str(event["stage"])
    if stage != "render" or event["found"]:
        return {stage: taken}
    statistics = read_statistics(statistics_of(root, event)) if "quality" in event else None
    parts = statistics.seconds if statistics is not None else {}
    whole = sum(parts.values())
    if not whole:
        return {stage: taken}
    return {part if part in LABELS else "rendering": taken * s / whole for part, s in parts.items()}
