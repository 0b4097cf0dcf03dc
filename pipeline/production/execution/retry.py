"""What a run does about jobs that did not end well: whether another round may help, and with how many cores.

A corrupt file was forgotten and a crashed variant is avoided: another round makes what is missing. A job that
something killed had too little memory, in all likelihood: the next round has half as many side by side. One
that hung is tried once more. What is wrong with a shot, a mesh or the disk no round mends.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from pipeline.production.store.event_log import Event

ROUNDS = 4
"""How often a run plans anew."""

TRIES = 2
"""How often a frame may hang."""

Place = tuple[object, ...]


@dataclass
class Remedies:
    """Those of one run, that has so many `cores`."""

    cores: int
    _rounds: int = 0
    _hung: Counter[Place] = field(default_factory=Counter)
    _given_up: list[Event] = field(default_factory=list)

    def help(self, events: Sequence[Event]) -> bool:
        """Whether another round may mend what a round with these events left undone."""
        self._rounds += 1
        found = any(event["event"] == "healed" for event in events)
        for event in events:
            if event["event"] == "hung":
                found |= self._may_try_again(event)
        killed = [event for event in events if event["event"] == "killed"]
        if killed and self.cores > 1:
            self.cores //= 2
            found = True
        else:
            self._given_up += [
                _told(each, "with nothing beside it. Is there memory enough?") for each in killed
            ]
        return found and self._rounds < ROUNDS

    @property
    def given_up(self) -> list[Event]:
        """What is beyond help, as failures."""
        return self._given_up

    def _may_try_again(self, event: Event) -> bool:
        place = (event.get("stage"), event.get("shot"), event.get("frame"))
        self._hung[place] += 1
        if self._hung[place] < TRIES:
            return True
        self._given_up.append(_told(event, "once more. If it is only slow, --timeout gives it longer."))
        return False


def _told(event: Event, more: str) -> Event:
    return {**event, "event": "fail", "message": f"{event['message']} {more}"}
