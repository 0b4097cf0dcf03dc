"""Serving the page to browsers on this machine, and to no others."""

from __future__ import annotations

import json
import queue
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any

from pipeline.dailies.live.feed import LiveFeed
from pipeline.errors import MachineError

HERE = "127.0.0.1"

PAGE = {
    "/": ("page.html", "text/html; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
}

_PICTURE = re.compile(r"/frames/(\d{1,9})/(\d{1,9})\.jpg(?:\?\d+)?")

SIGN_OF_LIFE = 5.0
"""Seconds between words to a page that hears nothing else, so that a closed one is noticed."""


@contextmanager
def serving(screen: LiveFeed, port: int = 0) -> Iterator[str]:
    """Serve the page until the end of the context; its address. Port 0 is any that is free.

    Raises MachineError where the port is taken.
    """
    try:
        server = _Server((HERE, port), partial(_Handler, screen))
    except OSError as error:
        raise MachineError(
            f"port {port} of this machine cannot be had ({error.strerror}); leave --port out for a free one"
        ) from error
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://{HERE}:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that leaves in the middle is no error of ours."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def __init__(self, screen: LiveFeed, request: Any, client_address: Any, server: Any) -> None:
        self._screen = screen
        super().__init__(request, client_address, server)

    def do_GET(self) -> None:
        if not self._is_asked_here():
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
        """The one that is asked for, where it is there."""
        found = _PICTURE.fullmatch(self.path)
        return None if found is None else self._screen.picture(int(found[1]), int(found[2]))

    def log_message(self, *arguments: object) -> None:
        """Requests are nobody's concern."""

    def _is_asked_here(self) -> bool:
        """Another site's script may find the port, but by another name for it."""
        host = self.headers.get("Host", "").rsplit(":", 1)[0]
        return host in (HERE, "localhost")

    def _send(self, content: bytes, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def _stream(self) -> None:
        """Server-sent events, until the page is closed."""
        self.send_response(200)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        heard = self._screen.listen()
        try:
            while True:
                try:
                    words = f"data: {json.dumps(heard.get(timeout=SIGN_OF_LIFE))}\n\n"
                except queue.Empty:
                    words = ": here\n\n"
                self.wfile.write(words.encode())
        except OSError:
            return
        finally:
            self._screen.leave(heard)
