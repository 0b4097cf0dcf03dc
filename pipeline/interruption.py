"""Long compiled calls that Ctrl-C ends at once.

Python handles signals in the main thread, between two of its own instructions: never within a compiled call.
"""

from __future__ import annotations

import contextvars
import threading
from collections.abc import Callable
from typing import TypeVar

import numba

T = TypeVar("T")

SIGNAL_SECONDS = 0.2
"""Time between two looks for signals."""


def interruptible(compute: Callable[[], T]) -> T:
    """Return `compute()`, run by a thread on which the main thread waits, free to handle signals.

    After an interrupt the thread is abandoned, and what it changes is in no known state: the process is to
    end. It ends without waiting for the thread. In other threads than the main one this is a plain call.
    """
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
