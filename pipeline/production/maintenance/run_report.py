"""Where a run's time went, by its event log: the stages, what rendering is made of, and the rest.

A core that a job holds for a second is a second of a core. Those that no frame accounts for went into
starting processes, where a job held the core, or into planning, Snakemake and waiting, where none did.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import MissingInputError
from pipeline.production.keys.stages import STAGES
from pipeline.production.planning.timings import read_statistics
from pipeline.production.store.event_log import Event, EventReader, logs_of
from pipeline.production.store.paths import EVENTS

STARTING, WAITING = "starting", "waiting"
"""What no frame accounts for."""

_PARTS = {
    "preparing": "preparing",
    "building": "building scenes",
    "rendering": "light and guides",
    "reading and writing": "reading and writing",
}
"""What a renderer's seconds are told by."""

WORDS = {
    **{name: stage.doing for name, stage in STAGES.items()},
    **{name: f"rendering: {part}" for name, part in _PARTS.items()},
    STARTING: "starting processes",
    WAITING: "planning, Snakemake, waiting",
}


@dataclass(frozen=True)
class Spending:
    """Of one run.

    seconds  by the clock
    cores    that it had
    spent    seconds of a core, by what they went into (see WORDS)
    frames   made, by stage
    """

    run: str
    seconds: float
    cores: int
    spent: Mapping[str, float]
    frames: Mapping[str, int]

    @classmethod
    def of(cls, root: Path, run: str, cores: int) -> Spending:
        """`cores` counts where the log, being older, does not say how many there were."""
        events = list(EventReader(root / EVENTS / f"{run}.jsonl").new())
        told = [event for event in events if event["event"] == "run"]
        cores = int(told[0]["cores"]) if told else cores
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
        held = sum(
            (end - begin) * threads.get(job, 1) for job, begin, end in _turns(events, max(times, default=0.0))
        )
        spent[STARTING] = max(0.0, held - sum(spent.values()))
        spent[WAITING] = max(0.0, seconds * cores - sum(spent.values()))
        frames = Counter(str(event["stage"]) for event in made if not event["found"])
        return cls(run, seconds, cores, dict(spent), dict(frames))

    @property
    def shares(self) -> dict[str, float]:
        """Of all that the cores had to give, in the order of WORDS."""
        whole = max(self.seconds * self.cores, sum(self.spent.values()), 1e-9)
        return {what: self.spent[what] / whole for what in WORDS if self.spent.get(what, 0.0) > 0.0}

    def as_data(self) -> dict[str, Any]:
        return {
            "run": self.run,
            "seconds": round(self.seconds, 3),
            "cores": self.cores,
            "core_seconds": {what: round(taken, 3) for what, taken in self.spent.items()},
            "frames": dict(self.frames),
        }

    def in_brief(self) -> str:
        """One line: the largest parts."""
        largest = sorted(self.shares.items(), key=lambda part: -part[1])[:4]
        return ", ".join(f"{WORDS[what]} {share:.0%}" for what, share in largest)


def runs(root: Path) -> list[str]:
    """The runs that left an event log, the latest last."""
    return [log.stem for log in logs_of(root)]


def named_run(root: Path, name: str | None) -> str:
    """A run by its name, or the last. Raises MissingInputError where there is none."""
    known = runs(root)
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
    """Where it is told what rendering a frame took. Raises KeyError for logs that do not say."""
    shot: str = event["shot"]
    place = Path(event["quality"]) / "statistics"
    homes = (root / "renders" / shot, root / "renders" / "turntable" / shot)
    files = [home / place / f"{shot}.{event['frame']:04d}.json" for home in homes]
    found = [file for file in files if file.exists()]
    return found[0] if found else files[0]


def _turns(events: Iterable[Event], last: float) -> Iterator[tuple[str, float, float]]:
    """When which job held its cores; one that was killed did so until the log ends."""
    begun: dict[str, float] = {}
    for event in events:
        if event["event"] == "begin":
            begun.setdefault(event["job"], float(event["time"]))
        elif event["event"] == "end" and event["job"] in begun:
            yield event["job"], begun.pop(event["job"]), float(event["time"])
    for job, begin in begun.items():
        yield job, begin, last


def _parts(root: Path, event: Event, taken: float) -> Mapping[str, float]:
    """What a frame's seconds went into: of a rendered one as its statistics say, where they are there."""
    stage = str(event["stage"])
    if stage != "render" or event["found"]:
        return {stage: taken}
    statistics = read_statistics(statistics_of(root, event)) if "quality" in event else None
    parts = statistics.seconds if statistics is not None else {}
    whole = sum(parts.values())
    if not whole:
        return {stage: taken}
    return {part if part in WORDS else "rendering": taken * s / whole for part, s in parts.items()}
