"""The command `report`: where the time of a run went."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Group

from pipeline.cli.options import Common
from pipeline.cli.output import duration, print_result, table
from pipeline.production.maintenance.run_report import LABELS, RunReport, named_run
from render.base.plural import plural


def report(
    common: Common,
    run: Annotated[
        str | None,
        typer.Argument(
            metavar="RUN", help="The name of its log in .flowsculpt/events. Default: the last run."
        ),
    ] = None,
) -> None:
    """Show where the time of a run went, stage by stage, and how much no frame accounts for.

    `flowsculpt report` shows the last run of this root; `flowsculpt report --json` the same as numbers.
    """
    spending = RunReport.of(common.root, named_run(common.root, run), common.cores)
    title = f"{spending.run}: {duration(spending.seconds)} on {plural(spending.cores, 'core')}"
    listing = table("", "of the cores", "core-seconds", "frames")
    for column in listing.columns[1:]:
        column.justify = "right"
    for what, share in spending.shares.items():
        frames = str(spending.frames.get(what, ""))
        listing.add_row(LABELS[what], f"{share:.1%}", f"{spending.core_seconds[what]:.1f}", frames)
    print_result(Group(title, listing), spending.as_data(), common.json)
