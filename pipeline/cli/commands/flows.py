"""The command that tells which flows there are."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.table import Table

from pipeline.cli.options import Common
from pipeline.cli.output import answer, out
from pipeline.shot.documents.flow_catalogue import DOCUMENTS, default_text, facts, markdown


def flows(
    common: Common,
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="One flow, with its parameters.")] = None,
    as_markdown: Annotated[
        bool, typer.Option("--markdown", help="The table of all flows as docs/flows.md has it.")
    ] = False,
) -> None:
    """List the flows of the catalogue; of one, its parameters with their units and defaults."""
    if as_markdown:
        answer(markdown(), [facts(flow) for flow in DOCUMENTS], common.json)
    elif name is None:
        _tell_all([facts(flow) for flow in DOCUMENTS], common.json)
    else:
        _tell(facts(name), common.json)


def _tell_all(told: list[dict[str, Any]], as_json: bool) -> None:
    if as_json:
        answer("", told, as_json=True)
        return
    table = _table("flow", "is a", "what it does")
    for fact in told:
        table.add_row(fact["name"], fact["kind"], fact["sense"])
    out.print(table)


def _tell(fact: dict[str, Any], as_json: bool) -> None:
    if as_json:
        answer("", fact, as_json=True)
        return
    table = _table("parameter", "default", "unit", "what it is")
    for parameter in fact["parameters"]:
        choices = f": {', '.join(parameter['choices'])}" if parameter["choices"] else ""
        keyed = ", may be keyed" if parameter["keyed"] else ""
        table.add_row(
            parameter["name"],
            default_text(parameter),
            parameter["unit"],
            f"{parameter['sense']}{choices}{keyed}",
        )
    out.print(f"{fact['name']}, a {fact['kind']}. {fact['sense']}", markup=False)
    out.print(table)


def _table(*headings: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in headings:
        table.add_column(heading)
    return table
