"""What the page shows at present, and whoever wants to hear of changes."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import dataclass, field
from typing import Any

Message = dict[str, Any]

LATEST = 2
"""Takes whose pictures are kept: while the next one comes, the page still shows the last."""


@dataclass(eq=False)
class LiveFeed:
    """Safe to use from several threads.

    session  tells it from another process's, to which an open page may have come back

    A *take* is what one text of the shot makes; they are numbered. Of its pictures each may come twice, the
    second time from the camera that has seen the whole shot.
    """

    session: int = field(default_factory=time.time_ns)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _heard_by: list[queue.SimpleQueue[Message]] = field(default_factory=list)
    _pictures: dict[tuple[int, int], bytes] = field(default_factory=dict)
    _drawn: dict[tuple[int, int], int] = field(default_factory=dict)
    _begun: Message = field(default_factory=dict)
    _said: Message = field(default_factory=dict)

    def begin(self, shot: str, first: int, last: int, fps: float, size: tuple[int, int]) -> int:
        """A new take; its number."""
        with self._lock:
            take = self._begun.get("take", 0) + 1
            self._begun = {
                "event": "begin",
                "session": self.session,
                "take": take,
                "shot": shot,
                "first": first,
                "last": last,
                "fps": fps,
                "size": list(size),
            }
            for place in [place for place in self._pictures if place[0] <= take - LATEST]:
                del self._pictures[place], self._drawn[place]
            self._tell(self._begun)
            return int(take)

    def show(self, take: int, frame: int, jpeg: bytes) -> None:
        with self._lock:
            place = take, frame
            self._pictures[place] = jpeg
            self._drawn[place] = self._drawn.get(place, 0) + 1
            self._tell(self._frame(place))

    def say(self, words: str, trouble: bool = False) -> None:
        """What is going on, or wrong."""
        with self._lock:
            self._said = {"event": "say", "words": words, "trouble": trouble}
            self._tell(self._said)

    def picture(self, take: int, frame: int) -> bytes | None:
        with self._lock:
            return self._pictures.get((take, frame))

    def listen(self) -> queue.SimpleQueue[Message]:
        """Everything so far, and then what comes."""
        heard: queue.SimpleQueue[Message] = queue.SimpleQueue()
        with self._lock:
            shown = [self._frame(place) for place in self._pictures if place[0] == self._begun.get("take")]
            for message in (self._begun, *shown, self._said):
                if message:
                    heard.put(message)
            self._heard_by.append(heard)
        return heard

    def leave(self, heard: queue.SimpleQueue[Message]) -> None:
        with self._lock:
            self._heard_by.remove(heard)

    def _frame(self, place: tuple[int, int]) -> Message:
        return {"event": "frame", "take": place[0], "frame": place[1], "drawn": self._drawn[place]}

    def _tell(self, message: Message) -> None:
        for heard in self._heard_by:
            heard.put(message)
