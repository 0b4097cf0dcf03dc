"""Long computations: their progress, reported to whoever asked for it, and compiled calls that Ctrl-C ends.

A flow is a mapping of points (P1) with no room for a callback, and a resampler is called by people who watch
nothing. So the callback lies in a context variable: `Progress.reported_to` sets it for the calls of its own
thread.

Python handles signals in the main thread, between two of its own instructions: never within a compiled call.
"""

from __future__ import annotations

import contextvars
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple, TypeVar

T = TypeVar("T")

SIGNAL_SECONDS = 0.2
"""Time between two looks for signals."""


class Progress(NamedTuple):
    """The state of one computation.

    activity  its name: of a flow, or of what the resampler does
    done      points that are done
    total     points in all; 0 where nobody knows them
    is_once   whether the result is kept: other frames do not compute it, and `total` is not of points
    """

    activity: str
    done: int
    total: int
    is_once: bool = False

    def report(self) -> None:
        """Report it, if somebody asked for it."""
        callback = _CALLBACK.get()
        if callback is not None:
            callback(self)

    @staticmethod
    @contextmanager
    def reported_to(callback: Callable[[Progress], object]) -> Iterator[None]:
        """Have computations within the context report their progress to a callback, some times a second."""
        token = _CALLBACK.set(callback)
        try:
            yield
        finally:
            _CALLBACK.reset(token)


_CALLBACK: ContextVar[Callable[[Progress], object] | None] = ContextVar("progress callback", default=None)


def interruptible(compute: Callable[[], T]) -> T:
    """Return `compute()`, run by a thread on which the main thread waits, free to handle signals.

    After an interrupt the thread is abandoned, and what it changes is in no known state: the process is to
    end. It ends without waiting for the thread. In other threads than the main one this is a plain call.
    """
    import numba  # takes time to import, and commands that compute nothing report progress too

    if threading.current_thread() is not threading.main_thread():
        return compute()
    results: list[T] = []
    errors: list[BaseException] = []
    context, threads = contextvars.copy_context(), numba.get_num_threads()

    def run() -> None:
        numba.set_num_threads(threads)  # each thread has its own number
        try:
            results.append(context.run(compute))
        except BaseException as error:  # the caller's to handle
            errors.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(SIGNAL_SECONDS)  # a signal that another thread receives wakes nobody
    if errors:
        raise errors[0]
    return results[0]
