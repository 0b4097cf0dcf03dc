"""The command `validate`: check shot files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Annotated

import typer
from rich.console import Group
from rich.table import Table

from flowsculpt.api import Progress
from flowsculpt.api.commands import (
    empty_table,
    print_error,
    print_result,
    print_warning,
    progress_bars,
    size_words,
)
from flowsculpt.api.frames import Show
from flowsculpt.api.options import Common, shared_option
from flowsculpt.pipeline.plugins.authoring.kept_verdicts import Verdicts
from flowsculpt.pipeline.plugins.authoring.verdict import Verdict


def validate(
    common: Common,
    shots: Annotated[
        list[str] | None, typer.Argument(metavar="SHOT", help="Shots and edits. Default: all.")
    ] = None,
    settings: Annotated[list[str] | None, shared_option("settings")] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Check unchanged files again, too.")] = False,
) -> None:
    """Check shot files and the scenes they describe; report every mistake by file, line and column.

    `flowsculpt validate` checks all shots and edits in shots/; `flowsculpt validate A010_cube --set
    resample.max_edge_length=0.1` checks one shot with another value.

    Models are loaded, and the first frame is computed: repairs, vertices and memory are listed.
    Warnings flag shots that render but probably look wrong: edges that are coarse for the subject, a camera
    inside of it, flows that act elsewhere or take minutes a frame. Of finished frames, the light is looked
    at too.

    What is found is kept, and said again at once while nothing has changed that decides it: the files that a
    shot reads, settings, code, plug-ins, packages, the machine. `--fresh` checks again.
    """
    edits, given = Show().edits(), tuple(settings or ())
    for warning in () if shots else Show().misnamed().values():
        print_warning(warning)
    names = shots or [*Show().shots(), *edits]
    if not names:
        Show().require_shots()
    found, verdicts = Verdicts(common, given, fresh), list[Verdict]()
    with progress_bars(common.progress) as bar:
        advance = bar("checking", len(names))
        for name in names:
            with Progress.reported_to(_Bars(bar).receive):
                verdicts.append(found.of_edit(name) if name in edits else found.of_shot(name))
            advance()
    _report(common, verdicts)
    raise typer.Exit(max(verdict.exit_code for verdict in verdicts))


class _Bars:
    """Bars of the long computations of flows, such as fits."""

    def __init__(self, bar: Callable[[str, int], Callable[[], None]]) -> None:
        self._bar = bar
        self._bars: dict[str, tuple[Callable[[], None], int]] = {}

    def receive(self, progress: Progress) -> None:
        """Draw what is counted up to few: points that a flow moves are not."""
        activity, done, total, _ = progress
        if 0 < total < 1000:
            advance, before = self._bars.get(activity) or (self._bar(activity, total), 0)
            for _ in range(done - before):
                advance()
            self._bars[activity] = advance, done


def _report(common: Common, verdicts: list[Verdict]) -> None:
    """Print errors and warnings, then which files are good, and the first frames of the shots."""
    errors = dict.fromkeys(line for verdict in verdicts for line in verdict.errors)
    warnings = dict.fromkeys(line for verdict in verdicts for line in verdict.warnings)
    if errors:
        print_error("\n".join(errors))
    if warnings:
        print_warning("\n".join(warnings))
    good = [verdict.name for verdict in verdicts if not verdict.errors and not verdict.warnings]
    doubtful = [verdict.name for verdict in verdicts if verdict.warnings and not verdict.errors]
    lines = [f"Good: {', '.join(good)}"] if good else []
    lines += [f"With warnings: {', '.join(doubtful)}"] if doubtful else []
    notes = [f"Note: {note}" for verdict in verdicts for note in verdict.notes]
    words = "\n".join([*(lines or ["No shot is good."]), *notes])
    print_result(
        Group(words, *_first_frames(verdicts)), [verdict.as_data() for verdict in verdicts], common.json
    )


def _first_frames(verdicts: list[Verdict]) -> Iterator[Table]:
    """Yield a table of first frames where there are any."""
    rows = empty_table("shot", "subject", "units", "vertices", "memory")
    for verdict in verdicts:
        for name, first in verdict.firsts.items():
            subject = f"{name}: {first['subject']}" if name else first["subject"]
            facts = f"{first['extent']:.3g}", f"{first['vertices']:,}", size_words(first["memory"])
            rows.add_row(verdict.name, subject, *facts)
    if rows.row_count:
        yield rows
