"""Output for the user: results on standard output, everything else on standard error.

Progress is bars where they can move, and lines of text in logs and pipes.
"""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import timedelta
from functools import partial
from typing import Any

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from flowsculpt.pipeline.production.store.event_log import poll
from flowsculpt.render.base.plural import plural
from flowsculpt.render.base.render_errors import readable

LINE_SECONDS = 10.0
"""Time between two lines, and before the first: what is done sooner says nothing."""


class ProgressLines(Progress):
    """Tasks of which a line each is printed every LINE_SECONDS while they are under way."""

    def __init__(self, console: Console) -> None:
        super().__init__(disable=True, console=console)
        self._polling, self._began = ExitStack(), time.monotonic()

    def start(self) -> None:
        self._began = time.monotonic()
        self._polling.enter_context(poll(LINE_SECONDS, self._print, lambda message: None))

    def stop(self) -> None:
        self._polling.close()

    def _print(self) -> None:
        unfinished = [task for task in self.tasks if task.started and not task.finished]
        begun = [task for task in unfinished if task.completed or task.fields.get("now")]
        for task in begun or unfinished[:1]:
            self.console.print(_line(task, time.monotonic() - self._began), soft_wrap=True)


def _line(task: Task, seconds: float) -> str:
    """`simulating: 12 of 72 after 0:00:40, frame 13 (45%, curl_noise)`"""
    now, elapsed = task.fields.get("now"), timedelta(seconds=round(seconds))
    line = f"{task.description}: {done_words(task, ' of ')} after {elapsed}"
    return f"{line}, {now}" if now else line


def done_words(task: Task, of: str) -> str:
    """Return how many frames are done of all, or the share in percent where a task counts that."""
    if task.fields.get("is_share"):
        return f"{task.completed:.0%}"
    return f"{int(task.completed)}{of}{task.total or 0:.0f}"


class _Console(Console):
    """A console that cuts nothing where no terminal shows it: programs read the tables that a pipe gets."""

    @property
    def options(self) -> ConsoleOptions:
        options = super().options
        width = (options.max_width or 80) if self.file.isatty() else sys.maxsize  # COLUMNS may be 0
        return options.update(width=width)


out = _Console(highlight=False, emoji=False, soft_wrap=True, markup=False)  # names of files may hold [red]
err = _Console(stderr=True, highlight=False, emoji=False, soft_wrap=True, markup=False)


def print_result(words: str | RenderableType, facts: Any, as_json: bool) -> None:
    """Print the result of a command: words or a table for people, or facts as JSON for programs."""
    if as_json or isinstance(words, str):
        typer.echo(json.dumps(facts, indent=2) if as_json else words)
    else:
        out.print(words)


def print_error(words: str) -> None:
    """Print an error to standard error, in red on terminals."""
    err.print(words, style="red")


def print_warning(words: str) -> None:
    """Print a warning to standard error, in yellow on terminals."""
    err.print(words, style="yellow")


class _StoreMessages(logging.Handler):
    """Prints what the remote store logs: warnings, and what it fetches."""

    def emit(self, record: logging.LogRecord) -> None:
        (print_warning if record.levelno >= logging.WARNING else err.print)(record.getMessage())


def tell_of_store(progress: bool) -> None:
    """Print the warnings of the remote store from now on, and if `progress` is wanted, what it fetches."""
    from flowsculpt.pipeline.production.store.remote_store import LOG

    LOG.handlers = [_StoreMessages()]
    LOG.setLevel(logging.INFO if progress else logging.WARNING)
    LOG.propagate = False


class _ReadableTable(Table):
    """A table whose texts cannot command the terminal, whoever wrote them."""

    def add_row(self, *cells: RenderableType | None, **settings: Any) -> None:
        shown = (readable(cell) if isinstance(cell, str) else cell for cell in cells)
        super().add_row(*shown, **settings)


def empty_table(*headings: str) -> Table:
    """Return an empty table with these columns."""
    empty = _ReadableTable(box=None, pad_edge=False)
    for heading in headings:
        empty.add_column(heading, overflow="fold")
    return empty


def duration_words(seconds: float) -> str:
    """Return a duration in words: `40 s`, `12 min`, `3 h 05 min`, `2 days 4 h`."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    if minutes < 90:
        return f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    if hours < 48:
        return f"{hours} h {minutes:02d} min"
    days, hours = divmod(hours, 24)
    return f"{plural(days, 'day')} {hours} h"


def size_words(count: float) -> str:
    """Return a number of bytes in words: `512 bytes`, `980 kB`, `1.2 GB`."""
    for unit, factor in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= factor:
            return f"{count / factor:.3g} {unit}"
    return plural(round(count), "byte")


class ProgressBar:
    """A bar of `progress_bars`. Calling it advances it by one."""

    def __init__(self, progress: Progress, name: str, total: int) -> None:
        self.progress, self._task = progress, progress.add_task(name, total=total, now="")

    def __call__(self) -> None:
        self.progress.advance(self._task)

    def show(self, done: float, now: str = "") -> None:
        """Show how much of the total is done, and what is under way, beside the bar."""
        self.progress.update(self._task, completed=done, now=now)


@contextmanager
def progress_bars(wanted: bool) -> Iterator[Callable[[str, int], ProgressBar]]:
    """Yield a function that adds a bar to standard error, by name and total, and returns it.

    A bar shows the count and the total, time elapsed and time left. If standard error is not a terminal,
    lines of text replace it. Nothing is drawn unless `wanted`.
    """
    columns = (
        TextColumn("{task.description:>16}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[now]}", style="dim", markup=False),
    )
    drawn = err.is_terminal or not wanted
    with Progress(*columns, console=err, disable=not wanted) if drawn else ProgressLines(err) as progress:
        yield partial(ProgressBar, progress)
