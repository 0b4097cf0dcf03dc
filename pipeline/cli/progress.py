"""Progress bars: of a run by its event log, and of work in this process."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from types import TracebackType

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from pipeline.cli.output import err
from pipeline.production.planning.plan import Plan
from pipeline.production.stages import STAGES
from pipeline.production.store.event_log import Event, EventReader, poll

POLL_SECONDS = 0.2


def _progress(*more: ProgressColumn) -> Progress:
    """Return bars on standard error: frames done of all, time elapsed and time left."""
    return Progress(
        TextColumn("{task.description:>16}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        *more,
        console=err,
    )


@contextmanager
def progress_bars(wanted: bool) -> Iterator[Callable[[str, int], Callable[[], None]]]:
    """Yield a function that adds a bar, by name and total, and returns what advances it by one.

    Nothing is drawn unless `wanted`.
    """
    if not wanted:
        yield lambda name, total: lambda: None
        return
    with _progress() as progress:
        yield lambda name, total: partial(progress.advance, progress.add_task(name, total=total))


class StageBars:
    """A context manager that draws a bar for each stage of a plan while it is executed.

    reader  of the run's event log
    """

    def __init__(self, plan: Plan, reader: EventReader) -> None:
        self._reader = reader
        totals = plan.frame_counts()
        self._progress = _progress(TextColumn("{task.fields[now]}", style="dim"))
        self._tasks: dict[str, TaskID] = {
            name: self._progress.add_task(stage.doing, total=totals[name], start=False, now="")
            for name, stage in STAGES.items()
            if totals[name]
        }
        self._settled: Counter[str] = Counter()
        self._under_way: dict[tuple[str, object], dict[object, float]] = {}
        self._ends = ExitStack()

    def __enter__(self) -> StageBars:
        self._progress.start()
        self._ends.callback(self._progress.stop)
        self._ends.callback(self._read)
        self._ends.enter_context(poll(POLL_SECONDS, self._read))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ends.close()

    def _read(self) -> None:
        for event in self._reader.new():
            self._show(event)

    def _show(self, event: Event) -> None:
        stage, what = event.get("stage", ""), event["event"]
        if what in ("healed", "hung", "killed"):
            err.print(event["message"], style="yellow", markup=False, highlight=False)
        if stage not in self._tasks:
            return
        under_way = self._under_way.setdefault((stage, event["job"]), {})
        frame = event.get("frame")
        if what == "begin":
            self._progress.start_task(self._tasks[stage])
            under_way.clear()
        elif what == "start":
            under_way[frame] = 0.0
        elif what == "pass":
            under_way[frame] = event["done"] / event["most"]
        elif what in ("frame", "fail"):
            under_way.pop(frame, None)
            self._settled[stage] += what == "frame"
        self._draw(stage)

    def _draw(self, stage: str) -> None:
        """Draw the bar of a stage: finished frames and parts of running ones, which are named beside it."""
        now = {
            frame: share
            for (of, _), frames in self._under_way.items()
            if of == stage
            for frame, share in frames.items()
        }
        self._progress.update(
            self._tasks[stage], completed=self._settled[stage] + sum(now.values()), now=_named(now)
        )


def _named(now: Mapping[object, float]) -> str:
    """`frames 12 (75%), 40`"""
    parts = [f"{frame} ({share:.0%})" if share else f"{frame}" for frame, share in now.items()]
    return f"frame{'s' * (len(parts) > 1)} {', '.join(parts)}" if parts else ""
