"""An S3 server on this machine, and a proxy before it that fails as networks and servers do."""

from __future__ import annotations

import http.client
import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from moto.server import ThreadedMotoServer

BUCKET = "films"

CREDENTIALS = {
    "AWS_ACCESS_KEY_ID": "AKIATESTTESTTEST",
    "AWS_SECRET_ACCESS_KEY": "a-secret-that-nobody-may-see",
    "AWS_DEFAULT_REGION": "us-east-1",
}

_COUNTING = threading.Condition()

MEETING_SECONDS = 60.0
"""Seconds after which a request waits for no others: they are asked one after another."""


@dataclass
class Proxy:
    """A proxy before an S3 server.

    fault    what it does to requests: None, `refuse`, `error`, `hang`, or to the content of objects that are
             read: `cut`, `alter`
    seconds  what every request takes longer
    together requests after the first are answered once so many have been here at once
    requests the method and the path of each request so far
    at_once  requests that are answered now, and most_at_once the most of them so far
    """

    url: str
    fault: str | None = None
    seconds: float = 0.0
    together: int = 0
    requests: list[tuple[str, str]] = field(default_factory=list)
    at_once: int = 0
    most_at_once: int = 0

    def expect(self, together: int) -> None:
        """Count again from here, and have requests wait for each other."""
        self.requests.clear()
        self.together, self.most_at_once = together, 0

    @contextmanager
    def answering(self) -> Iterator[None]:
        """Count a request while it is answered."""
        with _COUNTING:
            self.at_once += 1
            self.most_at_once = max(self.most_at_once, self.at_once)
            _COUNTING.notify_all()
            if len(self.requests) > 1 and not _COUNTING.wait_for(
                lambda: self.most_at_once >= self.together, MEETING_SECONDS
            ):
                self.together = 0
        try:
            yield
        finally:
            with _COUNTING:
                self.at_once -= 1


@contextmanager
def serving() -> Iterator[Proxy]:
    """Run both, with a bucket, until the block ends."""
    server = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    logging.getLogger("werkzeug").setLevel(logging.WARNING)
    server.start()
    host, port = server.get_host_and_port()

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        timeout = 300

        def handle_request(self) -> None:
            proxy.requests.append((self.command, self.path))
            with proxy.answering():
                self._pass_on()

        def _pass_on(self) -> None:
            time.sleep(proxy.seconds)
            body = self._body()
            fault = proxy.fault
            if fault == "hang":
                time.sleep(2.0)
            if fault in ("refuse", "hang"):
                self.close_connection = True
                return
            if fault == "error":
                self._answer(503, [], b"")
                return
            connection = http.client.HTTPConnection(host, port)
            headers = {name: value for name, value in self.headers.items() if name != "Expect"}
            connection.request(self.command, self.path, body, headers)
            answer = connection.getresponse()
            content = answer.read()
            connection.close()
            is_object = self.command == "GET" and "list-type" not in self.path
            if is_object and fault == "alter":
                content = content[:-1] + bytes([content[-1] ^ 1])
            said = [(n, v) for n, v in answer.getheaders() if not n.lower().startswith("x-amz-checksum")]
            self._answer(answer.status, said, content, cut=is_object and fault == "cut")

        def _body(self) -> bytes:
            if "chunked" not in self.headers.get("Transfer-Encoding", ""):
                return self.rfile.read(int(self.headers.get("Content-Length", 0)))
            body = b""
            while size := int(self.rfile.readline().split(b";")[0], 16):
                body += self.rfile.read(size)
                self.rfile.readline()
            self.rfile.readline()
            return body

        def _answer(
            self, status: int, headers: list[tuple[str, str]], content: bytes, cut: bool = False
        ) -> None:
            self.send_response(status)
            length = str(len(content))
            for name, value in headers:
                if name.lower() in ("content-length", "transfer-encoding", "connection", "date", "server"):
                    length = value if name.lower() == "content-length" else length  # a HEAD has no content
                    continue
                self.send_header(name, value)
            self.send_header("Content-Length", length)
            self.end_headers()
            self.wfile.write(content[: len(content) // 2] if cut else content)
            self.close_connection = cut

        do_GET = do_PUT = do_POST = do_HEAD = do_DELETE = handle_request  # noqa: N815

        def log_message(self, *_: object) -> None:
            pass

    front = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    front.daemon_threads = True
    proxy = Proxy(f"http://127.0.0.1:{front.server_address[1]}")
    threading.Thread(target=front.serve_forever, daemon=True).start()
    connection = http.client.HTTPConnection(host, port)
    connection.request("PUT", f"/{BUCKET}")
    assert connection.getresponse().status == 200
    connection.close()
    try:
        yield proxy
    finally:
        front.shutdown()
        front.server_close()
        server.stop()
