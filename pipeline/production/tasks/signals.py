"""Signals that end a rendering process between two sample batches, so that its work can be kept."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def handled(handle: Callable[[int], None]) -> Iterator[None]:
    """Have `handle` called for SIGNALS. A signal that is ignored stays so, as in a shell's background."""

    def handler(number: int, frame: FrameType | None) -> None:
        handle(number)

    before = {number: signal.getsignal(number) for number in SIGNALS}
    ours = [number for number in SIGNALS if before[number] != signal.SIG_IGN]
    for number in ours:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, before[number])


@dataclass
class StopRequest:
    """Notes that a signal asked this process to end."""

    received: bool = False

    def receive(self, number: int) -> None:
        self.received = True

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal was received."""
        if self.received:
            raise KeyboardInterrupt


@contextmanager
def deferred_signals() -> Iterator[StopRequest]:
    """Note signals instead of obeying them; the process ends where it calls `check`."""
    stop = StopRequest()
    with handled(stop.receive):
        yield stop
