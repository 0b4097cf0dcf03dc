"""Progress of long computations, reported to whoever asked for it.

A flow is a mapping of points (P1) with no room for a callback, and a resampler is called by people who watch
nothing. So the callback lies in a context variable: `reporting_to` sets it for the calls of its own thread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple


class Progress(NamedTuple):
    """The state of one computation.

    activity  its name: of a flow, or of what the resampler does
    done      points that are done
    total     points in all; 0 where nobody knows them
    """

    activity: str
    done: int
    total: int


ProgressCallback = Callable[[Progress], None]

_CALLBACK: ContextVar[ProgressCallback | None] = ContextVar("progress callback", default=None)


@contextmanager
def reporting_to(callback: ProgressCallback) -> Iterator[None]:
    """Have what is computed within the context report its progress, some times a second, to a callback."""
    token = _CALLBACK.set(callback)
    try:
        yield
    finally:
        _CALLBACK.reset(token)


def report_progress(activity: str, done: int, total: int = 0) -> None:
    """Report progress, if somebody asked for it."""
    callback = _CALLBACK.get()
    if callback is not None:
        callback(Progress(activity, done, total))
