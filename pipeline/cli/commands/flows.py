"""The command `flows`: the flows and their parameters."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.console import Group
from rich.text import Text

from pipeline.cli.options import Common
from pipeline.cli.output import print_result, table
from pipeline.shot.documents.flow_documents import DOCUMENTS
from pipeline.shot.documents.reference import default_text, facts, markdown


def flows(
    common: Common,
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="One flow, with its parameters.")] = None,
    as_markdown: Annotated[
        bool, typer.Option("--markdown", help="The table of all flows as docs/flows.md has it.")
    ] = False,
) -> None:
    """List the flows, or the parameters of one with units and defaults.

    `flowsculpt flows vortex` lists the parameters of the flow `vortex`.
    """
    if name is not None:
        _report_one(facts(name), common.json)
        return
    flows = [facts(flow) for flow in DOCUMENTS]
    listing = table("flow", "is a", "what it does")
    for flow in flows:
        listing.add_row(flow["name"], flow["kind"], flow["description"])
    print_result(markdown() if as_markdown else listing, flows, common.json)


def _report_one(flow: dict[str, Any], as_json: bool) -> None:
    listing = table("parameter", "default", "unit", "what it is")
    for parameter in flow["parameters"]:
        choices = f": {', '.join(parameter['choices'])}" if parameter["choices"] else ""
        keyed = ", may be keyed" if parameter["keyed"] else ""
        listing.add_row(
            parameter["name"],
            default_text(parameter),
            parameter["unit"],
            f"{parameter['description']}{choices}{keyed}",
        )
    title = Text(f"{flow['name']}, a {flow['kind']}. {flow['description']}")
    print_result(Group(title, listing), flow, as_json)
