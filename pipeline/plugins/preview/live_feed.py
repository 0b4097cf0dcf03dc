"""Pictures and messages for live pages."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import dataclass, field
from typing import Any

Message = dict[str, Any]

LATEST = 2
"""Takes whose pictures are kept: the page shows the last one while the next is drawn."""


@dataclass(eq=False)
class LiveFeed:
    """Pictures and messages for browsers; safe to use from several threads.

    session  identifies this process, for a page that stayed open after another one ended

    A *take* is one state of the shot file; takes are numbered. Each of its pictures may come twice: the
    second time from the camera that was framed by the whole shot.
    """

    session: int = field(default_factory=time.time_ns)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _subscribers: list[queue.SimpleQueue[Message]] = field(default_factory=list)
    _pictures: dict[tuple[int, int], bytes] = field(default_factory=dict)
    _drawn: dict[tuple[int, int], int] = field(default_factory=dict)
    _cameras: dict[tuple[int, int], Message] = field(default_factory=dict)
    _begun: Message = field(default_factory=dict)
    _said: Message = field(default_factory=dict)

    def begin(self, shot: str, first: int, last: int, fps: float, size: tuple[int, int]) -> int:
        """Begin a take and return its number."""
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
                self._cameras.pop(place, None)
            self._send(self._begun)
            return int(take)

    def show(self, take: int, frame: int, jpeg: bytes, camera: Message | None = None) -> None:
        """Show a picture; `camera` is what the page projects points by."""
        with self._lock:
            place = take, frame
            if camera is not None:
                self._cameras[place] = camera
            self._pictures[place] = jpeg
            self._drawn[place] = self._drawn.get(place, 0) + 1
            self._send(self._frame(place))

    def say(self, words: str, trouble: bool = False) -> None:
        """Show a message: what is going on, or, as `trouble`, what is wrong."""
        with self._lock:
            self._said = {"event": "say", "words": words, "trouble": trouble}
            self._send(self._said)

    def picture(self, take: int, frame: int) -> bytes | None:
        """Return a JPEG that was shown; None if there is none, or it is of a take long ago."""
        with self._lock:
            return self._pictures.get((take, frame))

    def subscribe(self) -> queue.SimpleQueue[Message]:
        """Return a queue with all that the page shows now, to which every later message is added."""
        messages: queue.SimpleQueue[Message] = queue.SimpleQueue()
        with self._lock:
            shown = [self._frame(place) for place in self._pictures if place[0] == self._begun.get("take")]
            for message in (self._begun, *shown, self._said):
                if message:
                    messages.put(message)
            self._subscribers.append(messages)
        return messages

    def unsubscribe(self, messages: queue.SimpleQueue[Message]) -> None:
        """End the messages to a queue of `subscribe`."""
        with self._lock:
            self._subscribers.remove(messages)

    def _frame(self, place: tuple[int, int]) -> Message:
        message = {"event": "frame", "take": place[0], "frame": place[1], "drawn": self._drawn[place]}
        return {**message, "camera": self._cameras[place]} if place in self._cameras else message

    def _send(self, message: Message) -> None:
        for messages in self._subscribers:
            messages.put(message)
