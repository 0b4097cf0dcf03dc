"""The command that says where a run's time went: report."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from pipeline.cli.options import Common
from pipeline.cli.output import answer, duration, out
from pipeline.production.maintenance.run_report import WORDS, Spending, named_run


def report(
    common: Common,
    run: Annotated[
        str | None,
        typer.Argument(metavar="RUN", help="Its log in .flowsculpt/events; by default the last."),
    ] = None,
) -> None:
    """Say where the time of a run went: stage by stage, and what no frame accounts for."""
    spending = Spending.of(common.root, named_run(common.root, run), common.cores)
    if common.json:
        answer("", spending.as_data(), as_json=True)
        return
    out.print(f"{spending.run}: {duration(spending.seconds)} on {spending.cores} cores")
    table = Table(box=None, pad_edge=False)
    for heading in ("", "of the cores", "seconds of a core", "frames"):
        table.add_column(heading, justify="right" if heading else "left")
    for what, share in spending.shares.items():
        frames = str(spending.frames.get(what, ""))
        table.add_row(WORDS[what], f"{share:.1%}", f"{spending.spent[what]:.1f}", frames)
    out.print(table)
