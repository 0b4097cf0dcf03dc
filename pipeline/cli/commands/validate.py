"""The command `validate`: check shot files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pipeline.cli.options import Common, Settings, shots_argument
from pipeline.cli.output import exit_with, print_error, print_result
from pipeline.errors import FlowsculptError
from pipeline.flow.flow import python_flows
from pipeline.production.request.lookup import edit_names, find_edit, find_shot, shot_names
from pipeline.shot import read_film, read_shot


def validate(
    common: Common,
    shots: Annotated[list[str] | None, shots_argument("Shots and edits. Default: all.")] = None,
    settings: Settings = None,
) -> None:
    """Check shot files and report every error by file, line and column.

    `flowsculpt validate` checks all shots and edits in shots/; `flowsculpt validate A010_cube --set
    resample.max_edge_length=0.1` checks one shot with another value.
    """
    edits, given = edit_names(), tuple(settings or ())
    errors: list[FlowsculptError] = []
    facts: list[dict[str, Any]] = []
    for name in shots or [*shot_names(), *edits]:
        try:
            is_edit = name in edits
            notes = _notes(find_edit(name) if is_edit else find_shot(name), is_edit, given)
            facts.append({"file": name, "errors": [], "notes": notes})
        except FlowsculptError as error:
            errors.append(error)
            facts.append({"file": name, "errors": str(error).splitlines()})
    lines = dict.fromkeys(line for error in errors for line in str(error).splitlines())
    if lines:
        print_error("\n".join(lines))
    good = [fact["file"] for fact in facts if not fact["errors"]]
    notes = [f"Note: {note}" for fact in facts for note in fact.get("notes", [])]
    summary = f"Good: {', '.join(good)}" if good else "No shot is good."
    print_result("\n".join([summary, *notes]), facts, common.json)
    exit_with(max((error.exit_code for error in errors), default=0))


def _notes(path: Path, is_edit: bool, settings: tuple[str, ...]) -> list[str]:
    """Read a shot or an edit; return advice about the shot's Python flows. Raises ShotError."""
    if is_edit:
        read_film(path, settings=settings)
        return []
    return [flow.advice for flow in python_flows(read_shot(path, settings=settings).motion.flow)]
