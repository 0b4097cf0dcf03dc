"""The command `validate`: check shot files."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.options import Common, Settings
from pipeline.cli.output import answer, complain
from pipeline.errors import FlowsculptError
from pipeline.flow.python_file import python_flows
from pipeline.production.request.lookup import edit_names, find_edit, find_shot, shot_names
from pipeline.shot import Film, Shot, read_film, read_shot


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
