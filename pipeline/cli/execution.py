"""Execute plans for the user: progress bars, messages, and what became of it."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import typer

from pipeline.cli.options import Common
from pipeline.cli.output import answer, complain, duration, err, size, warn
from pipeline.cli.progress import Bars
from pipeline.production.execution.run import Outcome, run
from pipeline.production.execution.watchdog import PATIENCE
from pipeline.production.keys.stages import STAGES
from pipeline.production.maintenance.run_report import Spending
from pipeline.production.planning.estimate import Estimate, estimate
from pipeline.production.planning.plan import Plan
from pipeline.production.request.render_request import FORMS


def make(
    common: Common, make_plan: Callable[[], Plan], draw: Callable[[], Sequence[Path]] | None = None
) -> None:
    """Plan, run, and say what became of it.

    draw  makes more of what is there after the run, and says where that is
    """
    if common.dry_run:
        tell_plan(common, make_plan())
        return
    started = time.monotonic()
    outcome = carried_out(common, make_plan)
    sheets = [path.as_posix() for path in (draw() if draw else ())]
    seconds = time.monotonic() - started
    words = _achieved(outcome, seconds)
    if sheets:
        words += f"\nDrawn of it: {', '.join(sheets)}"
    if outcome.runs:
        spending = Spending.of(common.root, outcome.runs[-1], common.cores)
        words += f"\nWhere the time went: {spending.in_brief()}. flowsculpt report says more."
    facts = {**_outcome_facts(outcome, seconds), **({"sheets": sheets} if draw else {})}
    answer(words, facts, common.json)
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)


def tell_plan(common: Common, plan: Plan) -> None:
    """What would be done, how long it would take and how large it would be."""
    _tell_notes(plan, set())
    expected = estimate(plan, common.root, common.cores)
    if not expected.fits:
        warn(_too_large(expected))
    words = _intended(plan) + (f"\n{expected_words(expected)}" if plan.jobs else "")
    answer(words, {**_plan_facts(plan), "estimate": expected.as_data()}, common.json)


def carried_out(common: Common, make_plan: Callable[[], Plan]) -> Outcome:
    """Plan and run, with bars, and tell what failed."""
    watch = (
        (lambda plan, reader: Bars(plan, reader, err))
        if common.progress
        else lambda plan, reader: nullcontext()
    )
    told: set[str] = set()

    def planned() -> Plan:
        plan = make_plan()
        _tell_notes(plan, told)
        return plan

    outcome = run(planned, common.root, common.cores, watch, common.profile, common.patience or PATIENCE)
    for message in outcome.warnings:
        warn(message)
    for failure in outcome.failures:
        complain(_failure(failure))
    return outcome


def _tell_notes(plan: Plan, told: set[str]) -> None:
    """Those not told yet."""
    for note in plan.notes:
        if note not in told:
            warn(note)
            told.add(note)


def _intended(plan: Plan) -> str:
    if not plan.jobs:
        return "Nothing to be done."
    counts: Counter[str] = Counter()
    for job in plan.jobs:
        counts[job.task] += len(job.frames)
    stages = ", ".join(f"{STAGES[task].doing} {counts[task]} frames" for task in STAGES if counts[task])
    return f"To be done: {stages}."


def expected_words(expected: Estimate) -> str:
    """Time and space, as far as they are known."""
    told = []
    if expected.core_seconds:
        by = f", by {expected.by}" if expected.by else ""
        told.append(f"It takes about {duration(expected.seconds)} on {expected.cores} cores{by}.")
    if expected.unmeasured:
        stages = ", ".join(dict.fromkeys(STAGES[stage].doing for stage in expected.unmeasured))
        told.append(f"How long {stages} takes is not known: none was done here yet.")
    if expected.bytes:
        told.append(f"It needs {size(expected.bytes)} of the {size(expected.free)} that are free.")
    return " ".join(told)


def _too_large(expected: Estimate) -> str:
    return (
        f"what is to be made needs about {size(expected.bytes or 0.0)}, and the disk has "
        f"{size(expected.free)} left; free some space, or choose another disk with --root"
    )


def _achieved(outcome: Outcome, seconds: float) -> str:
    films = [target for target in outcome.plan.targets if target.endswith(".mp4")]
    films = films or _folders(outcome.plan.targets)
    if outcome.unfinished:
        return f"Not finished after {seconds:.0f} s; what is done stays done."
    shown = ", ".join(films) or f"{len(outcome.plan.targets)} files"
    if not outcome.events:
        again = f" ({outcome.restored} links restored)" if outcome.restored else ""
        return f"Nothing to be done{again}: {shown}"
    return f"Done in {seconds:.0f} s ({outcome.made('render')} frames rendered): {shown}"


def _folders(targets: Sequence[str]) -> list[str]:
    """Where stills lie, where they are what was asked for."""
    stills = [Path(target) for target in targets if Path(target).parent.name in FORMS]
    if len(stills) == 1:
        return [stills[0].as_posix()]
    return list(dict.fromkeys(f"{still.parent.as_posix()}/" for still in stills))


def _failure(event: dict[str, Any]) -> str:
    frame = event.get("frame")
    message = str(event["message"]).removeprefix(f"frame {frame}: ")
    return f"{event['shot']} frame {frame}: {message}" if frame is not None else f"{event['shot']}: {message}"


def _plan_facts(plan: Plan) -> dict[str, Any]:
    jobs = [{"job": job.name, "task": job.task, "frames": list(job.frames)} for job in plan.jobs]
    return {"jobs": jobs, "targets": list(plan.targets)}


def _outcome_facts(outcome: Outcome, seconds: float) -> dict[str, Any]:
    return {
        "done": not outcome.unfinished,
        "seconds": round(seconds, 2),
        "runs": list(outcome.runs),
        "made": {stage: outcome.made(stage) for stage in STAGES if outcome.made(stage)},
        "links_restored": outcome.restored,
        "warnings": [*outcome.plan.notes, *outcome.warnings],
        "failed": [
            {name: failure.get(name) for name in ("shot", "stage", "frame", "message")}
            for failure in outcome.failures
        ],
        "targets": list(outcome.plan.targets),
    }
