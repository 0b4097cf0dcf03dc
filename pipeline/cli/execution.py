"""Execute plans for the user: progress bars, messages, and what became of it.

Plug-ins are called around runs and deliveries: the door `observer`.
"""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import typer
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text

from flowsculpt.pipeline.cli.options import Common
from flowsculpt.pipeline.cli.output import (
    ProgressLines,
    done_words,
    duration_words,
    err,
    print_error,
    print_result,
    print_warning,
    size_words,
)
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.production.execution.run import PATIENCE, Outcome, run
from flowsculpt.pipeline.production.planning.estimate import Estimate, Forecast, TimeLeft, estimate
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.request.render_request import FORMS
from flowsculpt.pipeline.production.stages import STAGES
from flowsculpt.pipeline.production.store.event_log import Event, EventReader, poll
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.base.plural import plural
from flowsculpt.render.base.remaining_kernels import compile_remaining_kernels, kernels_remain


class RunObserver:
    """Called around runs and deliveries. A plug-in's class overrides what it needs; the rest does nothing.

    An object of the class is made without arguments, once in a process. A FlowsculptError that a method
    raises ends the command with its message.
    """

    @staticmethod
    def of_plugins() -> list[RunObserver]:
        """Return the observers of all plug-ins, in the order in which they are called."""
        return list(plugins().objects("observer", RunObserver).values())

    def watch(self, common: Common, plan: Plan, preview: bool) -> AbstractContextManager[object]:
        """Return a context that is entered while `render` or `film` executes a plan at a terminal.

        common   the options that every command has, among them the root and the profile
        plan     the jobs, and the requests that they belong to
        preview  False where no previews are to be drawn
        """
        return nullcontext()

    def summary(self, common: Common, run: str) -> str:
        """Return a line for the report of a run that has ended, done or failed; an empty one for none.

        run  its name; its events are in the file RUN.jsonl of the folder `EVENTS`
        """
        return ""

    def delivered(self, common: Common, delivery: Mapping[str, Any]) -> None:
        """Take note of files of `deliver`, which are all there.

        delivery  what `deliver --json` prints: `deliverables`, each with `path`, `as`, `frames` and
                  `up_to_date`; `failed`, lines about frames that are shown as cards; and `seconds`
        """


POLL_SECONDS = 0.2

BACKGROUND_WORDS = (
    "Kernels that films rarely need are compiled in the background, at the lowest priority. "
    "Animatics are drawn once they are there."
)


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
            words = f"about {duration_words(_rounded(left))} left" if share < 1.0 else ""
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
def _forward_events(reader: EventReader, tell: Callable[[Event], None]) -> Iterator[None]:
    """Call a function with each event of a run."""

    def read() -> None:
        for event in reader.new():
            tell(event)

    try:
        with poll(POLL_SECONDS, read, print_warning):
            yield
    finally:
        read()


def _tell_of_slow_frame(event: Event) -> None:
    """Print why a frame is slow, where no bars say it."""
    if event["event"] == "slow":
        print_warning(_named_message(event))


def _named_message(event: Event) -> str:
    """Return an event's message, of a frame with its shot."""
    return f"{event['shot']} {event['message']}" if event["event"] == "slow" else str(event["message"])


def execute_and_report(
    common: Common,
    make_plan: Callable[[], Plan],
    draw: Callable[[], Sequence[Path]] | None = None,
    preview: bool | None = None,
) -> None:
    """Execute a plan and report the outcome; with --dry-run report the plan.

    draw        draws sheets and movies from the results, and returns their paths
    preview     whether plug-ins that watch the run may draw previews; None where none is to watch it
    """
    if common.dry_run:
        report_plan(common, make_plan())
        return
    started = time.monotonic()
    outcome = execute(common, make_plan, preview)
    sheets = [path.as_posix() for path in (draw() if draw else ())]
    seconds = time.monotonic() - started
    words = _achieved(outcome, seconds)
    if sheets:
        words += f"\nDrawn from it: {', '.join(sheets)}"
    if outcome.runs:
        lines = (observer.summary(common, outcome.runs[-1]) for observer in RunObserver.of_plugins())
        words = "\n".join([words, *filter(None, lines)])
    facts = {**_outcome_facts(outcome, seconds), **({"sheets": sheets} if draw else {})}
    print_result(words, facts, common.json)
    raise typer.Exit(outcome.exit_code)


def report_plan(
    common: Common,
    plan: Plan,
    lines: Sequence[str] = (),
    facts: Mapping[str, Any] = MappingProxyType({}),
    nothing: str = "Nothing to be done.",
) -> None:
    """Report what a plan would do, how long it takes and how much disk it needs.

    lines    what is said before it
    facts    what is added to the answer in JSON
    nothing  what is said where there is nothing to do
    """
    report_notes(plan, set())
    store = Store(common.root)
    forecast = Forecast.of(plan, store)
    expected = estimate(forecast.plan, common.root, common.cores)
    if not expected.fits:
        print_warning(
            f"the run needs about {size_words(expected.bytes or 0.0)}, and the disk has "
            f"{size_words(expected.free)} left; free some space, or choose another disk with --root"
        )
    words = [*lines, forecast_words(forecast, expected) if plan.jobs else nothing]
    if plan.spared:
        words.append(f"Shared, and done once: {count_words(plan.spared)}.")
    if fetched := len(plan.remote_names(store)):
        words.append(f"{plural(fetched, 'file')} would be fetched from {store.url}.")
    counts = forecast.plan.frame_counts()
    jobs = [{"job": job.name, "task": job.stage, "frames": list(job.frames)} for job in forecast.plan.jobs]
    told = {
        "jobs": jobs,
        "unframed": {stage: list(n) for stage, n in forecast.unframed.items()},
        "to_be_made": {stage: counts[stage] for stage in STAGES if counts[stage]},
        "targets": list(plan.targets),
        "shared": dict(plan.spared),
        "estimate": expected.as_data(),
        "fetched": fetched,
        **facts,
    }
    print_result("\n".join(words), told, common.json)


def execute(
    common: Common,
    make_plan: Callable[[], Plan],
    preview: bool | None = None,
    teller: Callable[[Plan], Callable[[Event], None]] | None = None,
) -> Outcome:
    """Execute a plan with progress bars, report warnings and failures, and return the outcome with its plan.

    make_plan  returns the plan; called again after a round that made what later jobs depend on
    preview    whether plug-ins that watch the run may draw previews; None where none is to watch it
    teller     returns, for each plan that is executed, what is called with its events in place of bars
    """

    @contextmanager
    def watch(plan: Plan, reader: EventReader) -> Iterator[None]:
        if teller is not None or not common.progress:
            with _forward_events(reader, teller(plan) if teller else _tell_of_slow_frame):
                yield
            return
        with StageBars(plan, common.root, reader).drawn(), ExitStack() as watching:
            if preview is not None:
                for observer in RunObserver.of_plugins():
                    watching.enter_context(observer.watch(common, plan, preview))
            yield

    if common.profile.is_local and kernels_remain():
        if compile_remaining_kernels() and common.progress:
            err.print(BACKGROUND_WORDS)
        preview = None if preview is None else False  # they would wait, and delay the first frame
    reported: set[str] = set()

    def planned() -> Plan:
        plan = make_plan()
        report_notes(plan, reported)
        return plan

    patience = common.patience or PATIENCE
    outcome = run(planned, common.root, common.cores, watch, common.profile, patience, common.wait)
    remote = Store(common.root).remote
    for message in outcome.warnings:
        if remote is None or message not in remote.told:  # by this process, and printed
            print_warning(message)
    for failure in outcome.failures:
        print_error(_failure(failure))
    return outcome


def report_notes(plan: Plan, reported: set[str]) -> None:
    """Print notes of a plan that are not yet reported."""
    for note in plan.notes:
        if note not in reported:
            print_warning(note)
            reported.add(note)


def count_words(counts: Mapping[str, int]) -> str:
    """Return frames by stage in words: `simulating 3 frames, rendering 2 frames`."""
    return ", ".join(
        f"{STAGES[name].doing} {plural(counts[name], 'frame')}" for name in STAGES if counts.get(name)
    )


def forecast_words(forecast: Forecast, expected: Estimate) -> str:
    """Return in words what a run makes, and the time and the disk space that it takes."""
    lines = [f"To be done: {count_words(forecast.certain)}."]
    if forecast.unframed:
        perhaps = {stage: len(numbers) for stage, numbers in forecast.unframed.items()}
        lines.append(f"Perhaps also {count_words(perhaps)}: their cameras are framed first, and may stay.")
    return "\n".join([*lines, estimate_words(expected, "at most" if forecast.unframed else "about")])


def estimate_words(expected: Estimate, about: str = "about") -> str:
    """Return time and disk space in words, as far as they are known."""
    told = []
    if expected.core_seconds:
        by = f", by {expected.by}" if expected.by else ""
        told.append(
            f"It takes {about} {duration_words(expected.seconds)} on {plural(expected.cores, 'core')}{by}."
        )
    if expected.unmeasured:
        stages = ", ".join(dict.fromkeys(STAGES[stage].doing for stage in expected.unmeasured))
        told.append(f"How long {stages} takes is not known: none was done here yet.")
    if expected.bytes:
        told.append(
            f"It needs {size_words(expected.bytes)} of the {size_words(expected.free)} that are free."
        )
    return " ".join(told)


def _achieved(outcome: Outcome, seconds: float) -> str:
    films = [target for target in outcome.plan.targets if target.endswith(".mp4")]
    films = films or _folders(outcome.plan.targets)
    if outcome.unfinished:
        return f"Not finished after {seconds:.0f} s; what is done stays done."
    shown = ", ".join(films) or plural(len(outcome.plan.targets), "file")
    fetched = [f"{plural(outcome.fetched, 'file')} fetched"] if outcome.fetched else []
    if not outcome.events:
        again = [*fetched, *([f"{plural(outcome.restored, 'link')} restored"] if outcome.restored else [])]
        done = f" ({', '.join(again)})" if again else ""
        return f"Nothing to be done{done}: {shown}"
    did = ", ".join([f"{plural(outcome.made('render'), 'frame')} rendered", *fetched])
    return f"Done in {seconds:.0f} s ({did}): {shown}"


def _folders(targets: Sequence[str]) -> list[str]:
    """Return the folders of stills, or the file of a single one."""
    stills = [Path(target) for target in targets if Path(target).parent.name in FORMS]
    if len(stills) == 1:
        return [stills[0].as_posix()]
    return list(dict.fromkeys(f"{still.parent.as_posix()}/" for still in stills))


def _failure(event: dict[str, Any]) -> str:
    frame = event.get("frame")
    message = str(event["message"]).removeprefix(f"frame {frame}: ")
    shot = event.get("shot") or event["job"]  # a job that was killed before its first frame has only a name
    return f"{shot} frame {frame}: {message}" if frame is not None else f"{shot}: {message}"


def _outcome_facts(outcome: Outcome, seconds: float) -> dict[str, Any]:
    return {
        "done": not outcome.unfinished,
        "seconds": round(seconds, 2),
        "runs": list(outcome.runs),
        "made": outcome.made_by_stage(),
        "links_restored": outcome.restored,
        "fetched": outcome.fetched,
        "warnings": [*outcome.plan.notes, *outcome.warnings],
        "failed": [
            {name: failure.get(name) for name in ("shot", "stage", "frame", "message")}
            for failure in outcome.failures
        ],
        "targets": list(outcome.plan.targets),
    }
