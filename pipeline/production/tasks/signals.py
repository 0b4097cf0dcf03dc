"""Signals that end a rendering process: it stops between two passes, so that what these found can be kept."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def heard(handle: Callable[[int], None]) -> Iterator[None]:
    """Have `handle` called for SIGNALS for a while; what is ignored stays so, as in a shell's background."""

    def handler(number: int, frame: FrameType | None) -> None:
        handle(number)

    before = {number: signal.getsignal(number) for number in SIGNALS}
    mine = [number for number in SIGNALS if before[number] != signal.SIG_IGN]
    for number in mine:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number in mine:
            signal.signal(number, before[number])


@dataclass
class Stop:
    """Whether this process was asked to end."""

    asked: bool = False

    def ask(self, number: int) -> None:
        self.asked = True

    def heed(self) -> None:
        """Raises KeyboardInterrupt where it was."""
        if self.asked:
            raise KeyboardInterrupt


@contextmanager
def stopping() -> Iterator[Stop]:
    """From here on signals are noted, and heeded where the process says so."""
    stop = Stop()
    with heard(stop.ask):
        yield stop
