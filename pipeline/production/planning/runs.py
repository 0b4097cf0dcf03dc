"""The runs of a root that it remembers: the plan of each, its event log, and Snakemake's messages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.planning.timings import LatestTimings
from flowsculpt.pipeline.production.request.lookup import QualityName
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.store.event_log import RUNS, EventLog, EventReader, logs_of
from flowsculpt.pipeline.production.store.history import History
from flowsculpt.pipeline.production.store.paths import DONE, EVENTS, LOGS, PLANS
from flowsculpt.render.base.root_files import remove_tree
from flowsculpt.render.base.serialise import from_plain
from flowsculpt.render.base.state_files import UNUSABLE, read_state


@dataclass(frozen=True)
class Runs:
    """The runs of a root, each by the name of its plan, which tells when it began.

    MOST  runs whose logs are kept
    """

    root: Path

    MOST: ClassVar[int] = RUNS

    @property
    def folder(self) -> Path:
        """The folder of their event logs."""
        return self.root / EVENTS

    @cached_property
    def timings(self) -> LatestTimings:
        """The time that frames took when they were last made."""
        return LatestTimings(self.root)

    def history(self) -> History:
        """Read the history of frames: which were made, failed, or are being made."""
        return History.of(self.root)

    def logged(self) -> list[str]:
        """Return the names of runs with an event log, the latest last."""
        return [log.stem for log in logs_of(self.root)]

    def planned(self) -> list[str]:
        """Return the names of runs with a plan, the latest last."""
        return sorted(path.stem for path in (self.root / PLANS).glob("*.json"))

    def reader(self, run: str) -> EventReader:
        """Return a reader of the events of a run."""
        return EventReader(self.folder / f"{run}.jsonl")

    def note_work(self, plan: Plan, what: str, cpu: float) -> None:
        """Write into the log of a plan's run that a process took so many CPU seconds for something."""
        EventLog(self.folder / plan.log_name, what).write("work", stage=what, cpu=round(cpu, 4))

    def requests(self, run: str) -> Iterator[RenderRequest]:
        """Yield the requests in the plan of a run, but those that this version cannot read."""
        plan = self.root / PLANS / f"{run}.json"
        for data in read_state(plan, lambda plan: list(plan["requests"])) or ():
            with suppress(*UNUSABLE, FlowsculptError):  # of an earlier version, or damaged
                if QualityName.of(data["quality_name"]).is_known:
                    yield from_plain(RenderRequest, data)

    def forget(self, keep: int) -> None:
        """Remove what is left of all but the last runs, MOST at least; Snakemake finds out what is done.

        Only the holder of the root's lock may call this.
        """
        for folder in (PLANS, EVENTS, LOGS):
            for path in sorted((self.root / folder).glob("2*"))[: -max(keep, self.MOST)]:
                remove_tree(path)
        for folder in (DONE, LOGS / "jobs"):
            for path in (self.root / folder).glob("*"):
                if path.name != "renders":  # by which keys Snakemake knows movies
                    remove_tree(path)
