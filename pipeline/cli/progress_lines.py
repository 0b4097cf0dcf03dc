"""Progress as lines of text, for logs and pipes, which can show no bars that move."""

from __future__ import annotations

import time
from contextlib import ExitStack
from datetime import timedelta

from rich.console import Console
from rich.progress import Progress, Task

from pipeline.production.store.event_log import poll

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
