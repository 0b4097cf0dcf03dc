"""A server of the live page for browsers on this machine, and for the one page that knows its token.

The address holds a random token. A request must name this machine as its host and, to change anything, this
page as its origin; its body is JSON of bounded size, and so is its answer.
"""

from __future__ import annotations

import json
import queue
import re
import secrets
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any

from flowsculpt import FlowsculptError, MachineError, UsageError
from flowsculpt.api.files import PageFolder
from flowsculpt.pipeline.plugins.preview.live_session import LiveFeed, LiveSession
from flowsculpt.pipeline.plugins.preview.page_socket import answer_to, frame_of, messages
from flowsculpt.pipeline.plugins.preview.performer import Performer
from flowsculpt.pipeline.plugins.preview.shot_editor import (
    MOST_REQUEST_BYTES,
    ShotEditor,
    StaleError,
    edits_in,
    json_object,
    where_in,
)
from flowsculpt.pipeline.plugins.preview.trial_pictures import TrialPictures

ADDRESS = "127.0.0.1"

PAGE = PageFolder(files("flowsculpt.pipeline.plugins.preview") / "page")

FILES: dict[str, tuple[str, Callable[[], str]]] = {
    "": (
        "text/html; charset=utf-8",
        lambda: PAGE.linked("flowsculpt live", "page.css", ("page.js",), connect="'self'"),
    ),
    "page.css": ("text/css; charset=utf-8", lambda: PAGE.style),
    "page.js": ("text/javascript; charset=utf-8", lambda: PAGE.script),
}
"""Types and texts of the page's files, by their paths below the token."""

_PICTURE = re.compile(r"frames/(\d{1,9})/(\d{1,9})\.jpg(?:\?\d+)?")

TOKEN_BYTES = 24  # random bytes of the token in the address

Action = Callable[[Mapping[str, Any]], dict[str, Any]]
"""Answers a request of the page, from JSON to JSON. Raises FlowsculptError."""

HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""Headers of every answer: the page runs its own scripts alone, and pages of other sites show none of it."""

KEEP_ALIVE = 5.0
"""Seconds between comments in a stream without messages, by which a closed page is noticed."""

PATIENCE = 10.0  # seconds that a browser has to send its request, and to take each part of the answer

MOST_CONNECTIONS = 64
"""Connections that are served at once: each open page has one, and six more while it loads pictures."""


@contextmanager
def serving(feed: LiveFeed, port: int = 0, actions: Mapping[str, Action] | None = None) -> Iterator[str]:
    """Serve the page until the end of the context, and yield its address. Port 0 is any free one.

    actions  answers by the names of requests, such as `edit`

    Raises MachineError if the port is taken.
    """
    try:
        server = _Server((ADDRESS, port), partial(_Handler, feed, actions or {}))
    except OSError as error:
        raise MachineError(
            f"port {port} of this machine cannot be used ({error.strerror}); leave --port out for a free one"
        ) from error
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://{ADDRESS}:{server.server_port}/{server.token}/"
    finally:
        server.shutdown()
        server.server_close()


class _Server(ThreadingHTTPServer):
    """A thread for each connection, which has one request and PATIENCE seconds to send it."""

    daemon_threads = True
    request_queue_size = MOST_CONNECTIONS

    def __init__(self, *arguments: Any) -> None:
        self.token = secrets.token_urlsafe(TOKEN_BYTES)
        self.waiting: dict[socket.socket, float] = {}
        self._open = threading.BoundedSemaphore(MOST_CONNECTIONS)
        super().__init__(*arguments)

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Refuse connections beyond the most."""
        return self._open.acquire(blocking=False)

    def process_request(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request(request, client_address)
        except RuntimeError:  # the system starts no more threads now
            self._open.release()
            self.shutdown_request(request)

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
    disable_nagle_algorithm = True  # an event must not wait until the one before it is acknowledged

    def __init__(
        self, feed: LiveFeed, actions: Mapping[str, Action], request: Any, client_address: Any, server: Any
    ) -> None:
        self._feed, self._actions = feed, actions
        super().__init__(request, client_address, server)

    def setup(self) -> None:
        self.request.settimeout(PATIENCE)
        super().setup()

    def do_GET(self) -> None:
        name = self._below_token()
        if name is None:
            return
        self.server.waiting.pop(self.connection, None)
        if name in FILES:
            kind, text = FILES[name]
            self._send(text().encode(), kind)
        elif name == "events":
            self._stream()
        elif name == "inputs" and "perform" in self._actions and "Sec-WebSocket-Key" in self.headers:
            self._hear(self._actions["perform"])
        elif name == "sound.wav":
            self._send(self._feed.sound(), "audio/wav")
        elif (match := _PICTURE.fullmatch(name)) and (
            picture := self._feed.picture(int(match[1]), int(match[2]))
        ):
            self._send(picture, "image/jpeg")
        else:
            self.send_error(404)

    def do_POST(self) -> None:
        name = self._below_token()
        if name is None:
            return
        if self.headers.get("Origin") not in self._origins():
            self.send_error(403, "only the page itself may make changes")
        elif name not in self._actions:
            self.send_error(404)
        elif (asked := self._body()) is not None:
            self.server.waiting.pop(self.connection, None)
            self._answer(self._actions[name], asked)

    def _below_token(self) -> str | None:
        """Return the path below the token; None where the request is refused, which it is then told."""
        if not self._is_local():
            self.send_error(403, "this page is for browsers on this machine")
            return None
        token, slash, name = self.path.removeprefix("/").partition("/")
        if not slash or not secrets.compare_digest(token.encode(), self.server.token.encode()):
            self.send_error(404, "open the address that flowsculpt has printed")
            return None
        return name

    def _is_local(self) -> bool:
        """Tell whether a request names this machine and comes from our page, or from nobody else's.

        Scripts of a site whose name was bound to this machine name another host.
        """
        site = self.headers.get("Sec-Fetch-Site", "none")
        is_page = self.path.count("/") == 2 and self.path.endswith("/")
        hosts = [origin.removeprefix("http://") for origin in self._origins()]
        return self.headers.get("Host") in hosts and (site in ("none", "same-origin") or is_page)

    def _origins(self) -> list[str]:
        return [f"http://{host}:{self.server.server_port}" for host in (ADDRESS, "localhost")]

    def _body(self) -> dict[str, Any] | None:
        """Return the JSON object of a request; None where it is refused, which it is then told."""
        length = self.headers.get("Content-Length", "")
        if self.headers.get_content_type() != "application/json":
            self.send_error(415, "a request is JSON")
        elif not re.fullmatch(r"\d{1,9}", length):
            self.send_error(411)
        elif int(length) > MOST_REQUEST_BYTES:
            self.send_error(413, f"a request has at most {MOST_REQUEST_BYTES} bytes")
        else:
            try:
                return json_object(self.rfile.read(int(length)))
            except UsageError as error:
                self.send_error(400, str(error))
        return None

    def _answer(self, action: Action, asked: Mapping[str, Any]) -> None:
        try:
            status, answer = 200, action(asked)
        except FlowsculptError as error:
            status = 409 if isinstance(error, StaleError) else 507 if isinstance(error, MachineError) else 422
            answer = {"error": str(error)}
        except OSError as error:
            status, answer = (
                507,
                {"error": str(MachineError.of_path(Path(error.filename or "."), error, "used"))},
            )
        self._send(json.dumps(answer, allow_nan=False).encode(), "application/json", status)

    def log_message(self, *arguments: object) -> None:
        """Log nothing."""

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Refuse a request, and drop what is still to come of it.

        Closing a connection with unread bytes resets it: a browser that was still sending would report a
        lost connection, not the reason.
        """
        super().send_error(code, message, explain)
        with suppress(OSError):
            self.connection.shutdown(socket.SHUT_WR)
            while self.rfile.read1(1 << 16):
                pass

    def end_headers(self) -> None:
        for name, value in HEADERS.items():
            self.send_header(name, value)
        super().end_headers()

    def _send(self, content: bytes, kind: str, status: int = 200) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def _hear(self, act: Action) -> None:
        """Do what the page asks over a connection that stays open, and answer with refusals alone."""
        if self.headers.get("Origin") not in self._origins():
            self.send_error(403, "only the page itself may make changes")
            return
        self.protocol_version = "HTTP/1.1"  # others know no such connection
        self.send_response(101)
        self.send_header("Upgrade", "websocket")
        self.send_header("Connection", "Upgrade")
        self.send_header("Sec-WebSocket-Accept", answer_to(self.headers["Sec-WebSocket-Key"]))
        self.end_headers()
        self.request.settimeout(None)
        with suppress(OSError):
            for message in messages(self.rfile, MOST_REQUEST_BYTES):
                try:
                    act(json_object(message))
                except FlowsculptError as error:
                    self.wfile.write(frame_of(str(error)))

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


def actions_of(
    editor: ShotEditor, session: LiveSession, performer: Performer | None = None
) -> dict[str, Action]:
    """Return the page's requests by name. Each may name the `frame` that the page shows."""

    pictures = TrialPictures(editor, session)

    def state(asked: Mapping[str, Any]) -> dict[str, Any]:
        _note_frame(session, asked)
        return editor.state()

    def edited(asked: Mapping[str, Any], write: Callable[[str], dict[str, Any]]) -> dict[str, Any]:
        """Write an edit of the text that the page shows, and end the rest of a drag."""
        _note_frame(session, asked)
        try:
            return write(_text(asked, "digest"))
        finally:
            session.resume()

    def edit(asked: Mapping[str, Any]) -> dict[str, Any]:
        edits, gesture = edits_in(asked.get("edits")), _text(asked, "gesture", "")
        return edited(asked, lambda digest: editor.edit(digest, edits, gesture))

    def prepare(asked: Mapping[str, Any]) -> dict[str, Any]:
        pictures.prepare(where_in(asked.get("where")), _frame(asked))
        return {}

    def follow(asked: Mapping[str, Any]) -> dict[str, Any]:
        return pictures.picture(_text(asked, "digest"), edits_in(asked.get("edits")), _frame(asked))

    undo, redo = partial(edited, write=editor.undo), partial(edited, write=editor.redo)
    acts: dict[str, Action] = {"state": state, "edit": edit, "undo": undo, "redo": redo}
    acts |= {"prepare": prepare, "follow": follow}
    return acts | ({"perform": performer.act} if performer else {})


def _frame(asked: Mapping[str, Any]) -> int:
    frame = asked.get("frame")
    if not isinstance(frame, int):
        raise UsageError("frame must be a number")
    return frame


def _note_frame(session: LiveSession, asked: Mapping[str, Any]) -> None:
    frame = asked.get("frame")
    if isinstance(frame, int):
        session.focus = frame


def _text(asked: Mapping[str, Any], name: str, default: str | None = None) -> str:
    value = asked.get(name, default)
    if not isinstance(value, str) or len(value) > 100:
        raise UsageError(f"{name} must be text of at most 100 characters")
    return value
