"""Progress of a plan while it is executed: a bar for each stage, and messages about its frames."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text

from pipeline.cli.output import ProgressLines, done_words, duration, err, print_warning
from pipeline.production.planning.estimate import TimeLeft
from pipeline.production.planning.plan import Plan
from pipeline.production.stages import STAGES
from pipeline.production.store.event_log import Event, EventReader, poll

POLL_SECONDS = 0.2


class StageBars:
    """A bar for each stage of a plan while it is executed, and one for all of it, with the time left.

    root    where earlier runs left their timings
    reader  of the run's event log
    """

    def __init__(self, plan: Plan, root: Path, reader: EventReader) -> None:
        self._reader = reader
        totals = plan.frame_counts()
        self._progress = _bars() if err.is_terminal else ProgressLines(err)
        self._tasks: dict[str, TaskID] = {
            name: self._progress.add_task(stage.doing, total=totals[name], start=False, now="")
            for name, stage in STAGES.items()
            if totals[name]
        }
        self._whole = self._progress.add_task("in all", total=1.0, start=False, now="", is_share=True)
        self._time_left = TimeLeft(plan, root)
        self._settled: Counter[str] = Counter()
        self._under_way: dict[tuple[str, object], dict[object, _FrameInWork]] = {}

    @contextmanager
    def drawn(self) -> Iterator[None]:
        """Draw the bars, and once more at the end."""
        with self._progress:
            try:
                with poll(POLL_SECONDS, self._read, print_warning):
                    yield
            finally:
                self._read()

    def _read(self) -> None:
        for event in self._reader.new():
            self._time_left.note(event)
            self._show(event)
        self._draw_whole()

    def _show(self, event: Event) -> None:
        stage, what = event.get("stage", ""), event["event"]
        if what in ("healed", "hung", "killed", "slow"):
            print_warning(_named_message(event))
        if stage not in self._tasks:
            return
        under_way = self._under_way.setdefault((stage, event["job"]), {})
        frame = event.get("frame")
        if what == "begin":
            self._progress.start_task(self._whole)
            self._progress.start_task(self._tasks[stage])
            under_way.clear()
        elif what == "start":
            under_way[frame] = _FrameInWork()
        elif what == "pass":
            under_way[frame] = _FrameInWork(event["done"] / event["most"])
        elif what == "progress":
            under_way[frame] = _FrameInWork(event["share"], event["activity"])
        elif what in ("frame", "fail"):
            under_way.pop(frame, None)
            self._settled[stage] += what == "frame"
        self._draw(stage)

    def _draw(self, stage: str) -> None:
        """Draw the bar of a stage: finished frames and parts of running ones, which are named beside it."""
        now = {
            frame: work
            for (of, _), frames in self._under_way.items()
            if of == stage
            for frame, work in frames.items()
        }
        completed = self._settled[stage] + sum(work.share for work in now.values())
        self._progress.update(self._tasks[stage], completed=completed, now=_named(now))

    def _draw_whole(self) -> None:
        """Draw the bar of the whole run, from its first frame on."""
        parts: defaultdict[str, float] = defaultdict(float)
        for (_, job), frames in self._under_way.items():
            parts[str(job)] += sum(work.share for work in frames.values())
        share = self._time_left.share(parts)
        if share is not None:
            left = self._time_left.seconds(share)
            words = f"about {duration(_rounded(left))} left" if share < 1.0 else ""
            self._progress.update(self._whole, completed=share, now=words)


def _rounded(seconds: float) -> float:
    """Return seconds as finely as an estimate is worth telling: by 5, and from two minutes on by a minute."""
    step = 5.0 if seconds < 120.0 else 60.0
    return max(step, step * round(seconds / step))


def _bars() -> Progress:
    return Progress(
        TextColumn("{task.description:>17}", markup=False),
        BarColumn(),
        _DoneColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[now]}", style="dim", markup=False),
        console=err,
    )


class _DoneColumn(ProgressColumn):
    """Shows how many frames are done of all; of the whole run, the share in percent."""

    def render(self, task: Task) -> Text:
        return Text(done_words(task, "/"), style="progress.download")


class _FrameInWork(NamedTuple):
    """A frame that is not done yet: its share that is, 0 to 1, and what is computed of it, if known."""

    share: float = 0.0
    activity: str = ""

    def __str__(self) -> str:
        """`75%, curl_noise`"""
        return ", ".join(filter(None, (f"{self.share:.0%}" if self.share else "", self.activity)))


def _named(now: Mapping[object, _FrameInWork]) -> str:
    """`frames 12 (75%), 40`"""
    parts = [f"{frame} ({work})" if str(work) else f"{frame}" for frame, work in now.items()]
    return f"frame{'s' * (len(parts) > 1)} {', '.join(parts)}" if parts else ""


@contextmanager
def slow_frames_told(reader: EventReader) -> Iterator[None]:
    """Print why frames are slow while no bars are drawn."""

    def read() -> None:
        for event in reader.new():
            if event["event"] == "slow":
                print_warning(_named_message(event))

    try:
        with poll(POLL_SECONDS, read, print_warning):
            yield
    finally:
        read()


def _named_message(event: Event) -> str:
    """Return an event's message, of a frame with its shot."""
    return f"{event['shot']} {event['message']}" if event["event"] == "slow" else str(event["message"])
