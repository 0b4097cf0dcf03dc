"""The live page: its pictures and messages, and a server for browsers on this machine alone."""

from __future__ import annotations

import json
import queue
import re
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any

from pipeline.errors import MachineError

ADDRESS = "127.0.0.1"

PAGE = {
    "/": ("page.html", "text/html; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
}

_PICTURE = re.compile(r"/frames/(\d{1,9})/(\d{1,9})\.jpg(?:\?\d+)?")

HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
}
"""Headers of every answer: the page runs its own scripts alone, and pages of other sites show none of it."""

KEEP_ALIVE = 5.0
"""Seconds between comments in a stream without messages, by which a closed page is noticed."""

PATIENCE = 10.0
"""Seconds that a browser has to send its request, and to take each part of the answer."""

MOST_CONNECTIONS = 64
"""Connections that are served at once: each open page has one, and six more while it loads pictures."""


@contextmanager
def serving(feed: LiveFeed, port: int = 0) -> Iterator[str]:
    """Serve the page until the end of the context, and yield its address. Port 0 is any free one.

    Raises MachineError if the port is taken.
    """
    try:
        server = _Server((ADDRESS, port), partial(_Handler, feed))
    except OSError as error:
        raise MachineError(
            f"port {port} of this machine cannot be used ({error.strerror}); leave --port out for a free one"
        ) from error
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://{ADDRESS}:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()


class _Server(ThreadingHTTPServer):
    """A thread for each connection, of which each has one request and PATIENCE seconds to send it."""

    daemon_threads = True
    request_queue_size = MOST_CONNECTIONS

    def __init__(self, *arguments: Any) -> None:
        self.waiting: dict[socket.socket, float] = {}
        self._open = threading.BoundedSemaphore(MOST_CONNECTIONS)
        super().__init__(*arguments)

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Refuse connections beyond the most."""
        return self._open.acquire(blocking=False)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        self.waiting[request] = time.monotonic() + PATIENCE
        try:
            super().process_request_thread(request, client_address)
        finally:
            self.waiting.pop(request, None)
            self._open.release()

    def service_actions(self) -> None:
        """Close connections whose request takes too long; called twice a second."""
        now = time.monotonic()
        for connection, limit in list(self.waiting.items()):
            if now > limit:
                with suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore browsers that close a connection early."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def __init__(self, feed: LiveFeed, request: Any, client_address: Any, server: Any) -> None:
        self._feed = feed
        super().__init__(request, client_address, server)

    def setup(self) -> None:
        self.request.settimeout(PATIENCE)
        super().setup()

    def do_GET(self) -> None:
        self.server.waiting.pop(self.connection, None)
        if not self._is_local():
            self.send_error(403, "this page is for browsers on this machine")
        elif self.path in PAGE:
            name, kind = PAGE[self.path]
            self._send(files(__package__).joinpath("page", name).read_bytes(), kind)
        elif self.path == "/events":
            self._stream()
        elif (picture := self._picture()) is not None:
            self._send(picture, "image/jpeg")
        else:
            self.send_error(404)

    def _picture(self) -> bytes | None:
        """Return the requested picture, if there is one."""
        match = _PICTURE.fullmatch(self.path)
        return None if match is None else self._feed.picture(int(match[1]), int(match[2]))

    def log_message(self, *arguments: object) -> None:
        """Log nothing."""

    def _is_local(self) -> bool:
        """Tell whether a request names this machine and comes from our page, or from nobody else's.

        Scripts of a site whose name was bound to this machine name another host.
        """
        host = self.headers.get("Host", "").rsplit(":", 1)[0]
        site = self.headers.get("Sec-Fetch-Site", "none")
        return host in (ADDRESS, "localhost") and (site in ("none", "same-origin") or self.path == "/")

    def end_headers(self) -> None:
        for name, value in HEADERS.items():
            self.send_header(name, value)
        super().end_headers()

    def _send(self, content: bytes, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def _stream(self) -> None:
        """Send events until the page is closed."""
        self.send_response(200)
        self.send_header("Content-Type", "text/event-stream")
        self.end_headers()
        messages = self._feed.subscribe()
        try:
            while True:
                try:
                    words = f"data: {json.dumps(messages.get(timeout=KEEP_ALIVE))}\n\n"
                except queue.Empty:
                    words = ": keep-alive\n\n"
                self.wfile.write(words.encode())
        except OSError:
            return
        finally:
            self._feed.unsubscribe(messages)


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
            self._send(self._begun)
            return int(take)

    def show(self, take: int, frame: int, jpeg: bytes) -> None:
        """Show a picture."""
        with self._lock:
            place = take, frame
            self._pictures[place] = jpeg
            self._drawn[place] = self._drawn.get(place, 0) + 1
            self._send(self._frame(place))

    def say(self, words: str, trouble: bool = False) -> None:
        """Show a message: what is going on, or, as `trouble`, what is wrong."""
        with self._lock:
            self._said = {"event": "say", "words": words, "trouble": trouble}
            self._send(self._said)

    def picture(self, take: int, frame: int) -> bytes | None:
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
        with self._lock:
            self._subscribers.remove(messages)

    def _frame(self, place: tuple[int, int]) -> Message:
        return {"event": "frame", "take": place[0], "frame": place[1], "drawn": self._drawn[place]}

    def _send(self, message: Message) -> None:
        for messages in self._subscribers:
            messages.put(message)
