"""Decide whether another round may mend a run, and with how many cores.

After a corrupt file was evicted or a crashed variant is avoided, another round makes what is missing. A
killed job had too little memory, in all likelihood: the next round has half as many side by side. One that
hung is tried once more. What is wrong with a shot, a mesh or the disk no round mends.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from pipeline.production.store.event_log import Event

ROUNDS = 4
"""The most times that a run plans again."""

TRIES = 2
"""The most times that a frame may hang."""

_Frame = tuple[object, ...]


@dataclass
class RetryPolicy:
    """The retries of one run.

    cores     cores of the next round
    failures  events of what is beyond help, as failures
    """

    cores: int
    failures: list[Event] = field(default_factory=list)
    _rounds: int = 0
    _hung: Counter[_Frame] = field(default_factory=Counter)

    def allows(self, events: Sequence[Event]) -> bool:
        """Tell whether another round may mend what a round with these events left undone."""
        self._rounds += 1
        may_help = any(event["event"] == "healed" for event in events)
        for event in events:
            if event["event"] == "hung":
                may_help |= self._may_try_again(event)
        killed = [event for event in events if event["event"] == "killed"]
        if killed and self.cores > 1:
            self.cores //= 2
            may_help = True
        else:
            self.failures += [_failure(e, "with nothing beside it. Is there memory enough?") for e in killed]
        return may_help and self._rounds < ROUNDS

    def _may_try_again(self, event: Event) -> bool:
        frame = (event.get("stage"), event.get("shot"), event.get("frame"))
        self._hung[frame] += 1
        if self._hung[frame] < TRIES:
            return True
        self.failures.append(_failure(event, "once more. If it is only slow, --timeout gives it longer."))
        return False


def _failure(event: Event, more: str) -> Event:
    return {**event, "event": "fail", "message": f"{event['message']} {more}"}
