"""Commands that begin the work: new, validate."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.make import Settings
from pipeline.cli.options import Common
from pipeline.cli.say import answer, complain
from pipeline.errors import FlowsculptError, UsageError
from pipeline.flow.python_file import python_flows
from pipeline.production.disk import disk_faults
from pipeline.production.workflow import NAME, SHOTS, edit_names, find_edit, find_shot, shot_names
from pipeline.shot import Film, Shot, read_film, read_shot

TEMPLATE = """\
title: {title}
intent: What this shot should show, in one sentence.

frames: 1-72
rate: 24

# What flows: a box, icosphere, rod, torus or sheet, or a model file: {{model: models/bunny.obj}}.
subject: {{solid: box, size: [2, 2, 2]}}

# Edges longer than this are split, those shorter than 40% of it collapse. `resample: off` compares.
resample: {{max_edge_length: 0.08}}

# Flows act one after another in each frame; under `sum:` they act at once. Keys are frames.
flows:
  - twist: {{axis: y, amount: {{ease: sine_in_out, keys: {{1: 0, 60: 90}}}}}}

look: clay
camera: {{azimuth: {{keys: {{1: -35, 72: -15}}}}, elevation: 14}}
lights: studio
stage: cyclorama
"""


def new(
    common: Common,
    name: Annotated[str, typer.Argument(help="The shot's name, as its file and its frames are called.")],
) -> None:
    """Begin a shot: write shots/NAME.yaml, ready to render and to be changed."""
    if not re.fullmatch(NAME, name) or name in ("film", "turntable"):
        raise UsageError(f"{name!r} cannot name a shot; use letters, digits, _ and -, as in A010_cube")
    path = SHOTS / f"{name}.yaml"
    if path.exists():
        raise UsageError(f"{path} is there already; choose another name or edit that file")
    if not common.dry_run:
        with disk_faults(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(TEMPLATE.format(title=name.replace("_", " ").replace("-", " ")))
    done = f"{path}: written. Look at it: flowsculpt render {name} -q preview"
    answer(f"{path}: would be written." if common.dry_run else done, {"path": str(path)}, common.json)


def validate(
    common: Common,
    shots: Annotated[
        list[str] | None, typer.Argument(metavar="SHOT…", help="Shots and edits; by default all.")
    ] = None,
    settings: Settings = None,
) -> None:
    """Read shot files and say everything that is wrong with them, by file, line and column."""
    failed: list[FlowsculptError] = []
    facts: list[dict[str, Any]] = []

    def check(name: str, read: Callable[[Path], Shot | Film], path: Callable[[], Path]) -> None:
        try:
            found = read(path())
            notes = (
                [flow.advice for flow in python_flows(found.motion.flow)] if isinstance(found, Shot) else []
            )
            facts.append({"file": name, "errors": [], "notes": notes})
        except FlowsculptError as error:
            failed.append(error)
            facts.append({"file": name, "errors": str(error).splitlines()})

    said = tuple(settings or ())
    edits = edit_names()
    for name in shots or [*shot_names(), *edits]:
        if name in edits:
            check(name, partial(read_film, settings=said), partial(find_edit, name))
        else:
            check(name, partial(read_shot, settings=said), partial(find_shot, name))
    complaints = dict.fromkeys(line for failure in failed for line in str(failure).splitlines())
    if complaints:
        complain("\n".join(complaints))
    good = [fact["file"] for fact in facts if not fact["errors"]]
    notes = [f"Note: {note}" for fact in facts for note in fact.get("notes", [])]
    summary = f"Good: {', '.join(good)}" if good else "No shot is good."
    answer("\n".join([summary, *notes]), facts, common.json)
    if failed:
        raise typer.Exit(max(failure.exit_code for failure in failed))
