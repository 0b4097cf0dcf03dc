"""The command `flows`: the flows and their parameters."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from pipeline.cli.options import Common
from pipeline.cli.output import out, print_result, table
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
    elif as_markdown or common.json:
        print_result("" if common.json else markdown(), [facts(flow) for flow in DOCUMENTS], common.json)
    else:
        listing = table("flow", "is a", "what it does")
        for flow in map(facts, DOCUMENTS):
            listing.add_row(flow["name"], flow["kind"], flow["description"])
        out.print(listing)


def _report_one(flow: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_result("", flow, as_json=True)
        return
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
    out.print(f"{flow['name']}, a {flow['kind']}. {flow['description']}", markup=False)
    out.print(listing)
