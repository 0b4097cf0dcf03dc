"""The server of the live page: whom it serves, and clients that misbehave."""

from __future__ import annotations

import contextlib
import errno
import itertools
import json
import re
import socket
import struct
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from flowsculpt.pipeline.errors import MachineError, UsageError
from flowsculpt.pipeline.plugins.preview import live_server
from flowsculpt.pipeline.plugins.preview.live_server import serving
from flowsculpt.pipeline.plugins.preview.live_session import LiveFeed
from flowsculpt.pipeline.plugins.preview.page_socket import answer_to

PATIENCE = 60.0


def test_browsers_on_this_machine_are_served_and_no_others() -> None:
    feed = LiveFeed()
    request = feed.begin("A", 1, 2, 24.0, (8, 4))
    feed.show(request, 1, b"picture")
    with serving(feed) as address:
        assert fetched(address + "frames/1/1.jpg?1") == b"picture"
        assert b"page.js" in fetched(address)
        token, origin = address.split("/")[3], address.rsplit("/", 2)[0]
        assert len(token) == 32
        for path in (
            "/",
            "/events",
            "/frames/1/1.jpg",
            "/page.html",
            f"/{token}",
            f"/{token[:-1]}/",
            f"/{token}x/",
        ):
            assert code_of(origin + path, {}) == 404, "without the token there is nothing"
        for path, host, code in (
            ("frames/1/2.jpg", None, 404),
            ("page/../server.py", None, 404),
            ("frames/1/1.jpg", "evil.example", 403),
            ("frames/1/1.jpg", "localhost:1", 403),
            ("frames/1/1.jpg", "localhost.evil.example", 403),
            ("..%2f..%2fetc/passwd", None, 404),
        ):
            assert code_of(address + path, {"Host": host} if host else {}) == code
        with pytest.raises(MachineError, match="leave --port out"), serving(feed, port_of(address)):
            pass


def port_of(address: str) -> int:
    return int(address.split(":")[2].split("/")[0])


def code_of(url: str, headers: dict[str, str]) -> int:
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers)) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as refused:
        refused.close()
        return refused.code


def test_a_page_of_another_site_may_link_to_the_page_but_neither_show_nor_hear_it() -> None:
    with serving(LiveFeed()) as address:
        assert code_of(address, {"Sec-Fetch-Site": "cross-site"}) == 200
        for path in ("page.js", "events", "frames/1/1.jpg"):
            assert code_of(address + path, {"Sec-Fetch-Site": "cross-site"}) == 403
        with urllib.request.urlopen(address) as answer:
            assert "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]


def connected(address: str) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port_of(address)), timeout=PATIENCE)


def is_cut_off(client: socket.socket) -> bool:
    """Tell whether a server closes a connection next, without an answer."""
    with contextlib.suppress(ConnectionError):
        return client.recv(100) == b""
    return True


@pytest.mark.slow
def test_slow_clients_are_cut_off_and_others_served(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(live_server, "PATIENCE", 1.0)
    with serving(LiveFeed()) as address:
        slow = [connected(address) for _ in range(live_server.MOST_CONNECTIONS)]
        for number, client in enumerate(slow):
            with contextlib.suppress(ConnectionError):  # its time is over already
                client.sendall(b"GET / HTTP/1.1\r\n"[: number % 17])
        assert all(map(is_cut_off, slow)), "each had its time"
        monkeypatch.undo()
        assert b"page.js" in fetched(address)
    assert capfd.readouterr().err == "", "nothing is printed over the command's progress"
    for client in slow:
        client.close()


@pytest.mark.slow
def test_clients_that_say_too_much_or_are_too_many_are_refused(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(live_server, "PATIENCE", 600.0)
    with serving(LiveFeed()) as address:
        for words in (
            b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\n\r\n",
            b"GET / HTTP/1.1\r\n" + b"A: " + b"a" * 100_000 + b"\r\n\r\n",
            b"GET / HTTP/1.1\r\n" + b"A: a\r\n" * 1000 + b"\r\n",
            b"\x16\x03\x01\x00\xff\r\n\r\n",
            b"POST / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n",
        ):
            with connected(address) as client, contextlib.suppress(ConnectionError):
                client.sendall(words)
                assert re.search(rb"^HTTP/1.0 [45]|Error code: 4", client.recv(10_000)), words[:20]
        assert b"page.js" in fetched(address)
        with contextlib.ExitStack() as stack:
            for _ in range(live_server.MOST_CONNECTIONS):
                stack.enter_context(connected(address))
            assert is_cut_off(stack.enter_context(connected(address)))
    assert capfd.readouterr().err == ""


@pytest.mark.slow
@pytest.mark.parametrize("words", ["", "GET /", "POST /{path}edit HTTP/1.1\r\nHost: {host}\r\n", "{request}"])
def test_connections_that_are_reset_at_any_moment_end_nothing(
    words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with serving(LiveFeed(), 0, {"edit": lambda asked: {"a": "b" * 2_000_000}}) as address:
        host, path = f"127.0.0.1:{port_of(address)}", address.split("/", 3)[3]
        head = f"POST /{path}edit HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n"
        body = "Content-Type: application/json\r\nContent-Length: 2\r\n\r\n{}"
        for _ in range(30):
            with connected(address) as client:
                client.sendall(words.format(path=path, host=host, request=head + body).encode())
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        assert b"page.js" in fetched(address)
    assert capfd.readouterr().err == ""


def test_an_action_that_the_disk_refuses_is_answered_with_its_reason() -> None:
    def edit(asked: object) -> dict[str, Any]:
        raise OSError(errno.EIO, "", "shots/a.yaml")

    with serving(LiveFeed(), 0, {"edit": edit}) as address:
        origin = address.rsplit("/", 2)[0]
        headers = {"Content-Type": "application/json", "Origin": origin}
        asked = urllib.request.Request(address + "edit", b"{}", headers)
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(asked)
        with refused.value as answer:
            assert answer.code == 507
            assert json.load(answer)["error"].startswith(
                "shots/a.yaml: cannot be used: the disk reports an error"
            )


@pytest.mark.slow
def test_a_page_that_reads_nothing_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_server, "PATIENCE", 0.5)
    feed = LiveFeed()
    take = feed.begin("A", 1, 2, 24.0, (8, 4))
    with serving(feed) as address, contextlib.ExitStack() as stack:
        path, port = address.split("/", 3)[3], port_of(address)
        request = f"GET /{path}events HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode()
        while not feed._subscribers:  # a busy machine may take longer to ask
            client = stack.enter_context(connected(address))
            with contextlib.suppress(ConnectionError):
                client.sendall(request)
                while not feed._subscribers and client.recv(10):
                    pass
        limit = time.monotonic() + PATIENCE
        for frame in itertools.count():
            feed.say("word " * 100_000)
            feed.show(take, frame % 2 + 1, b"picture")
            time.sleep(0.1)
            if not feed._subscribers:
                break
            assert time.monotonic() < limit


def test_a_page_hears_of_all_that_it_missed_and_of_what_comes() -> None:
    feed = LiveFeed()
    request = feed.begin("A", 1, 2, 24.0, (8, 4))
    feed.show(request, 1, b"picture")
    with serving(feed) as address, urllib.request.urlopen(address + "events", timeout=PATIENCE) as stream:
        assert next_message(stream)["shot"] == "A"
        assert next_message(stream) == {"event": "frame", "take": 1, "frame": 1, "drawn": 1}
        feed.show(request, 2, b"another")
        assert next_message(stream)["frame"] == 2


def test_pictures_of_the_last_take_stay_until_the_next_but_one() -> None:
    feed = LiveFeed()
    for request in (1, 2, 3):
        feed.begin("A", 1, 2, 24.0, (8, 4))
        feed.show(request, 1, bytes([request]))
    assert [feed.picture(request, 1) for request in (1, 2, 3)] == [None, b"\x02", b"\x03"]


def test_what_a_page_sends_over_its_open_connection_is_done_and_refusals_are_answered() -> None:
    heard: list[int] = []

    def act(asked: Mapping[str, Any]) -> dict[str, Any]:
        if asked["text"] == "no":
            raise UsageError("'no' is wrong")
        heard.append(len(asked["text"]))
        return {}

    with serving(LiveFeed(), 0, {"perform": act}) as address:
        origin = address.rsplit("/", 2)[0]
        with opened(address, origin) as page:
            assert b" 101 " in page.recv(1000)
            for length in (1, 200, 70_000):
                page.sendall(masked(json.dumps({"text": "a" * length}).encode()))
            first, rest = b'{"text":', b'"parts"}'
            page.sendall(masked(first, head=0x01) + masked(b"", head=0x89) + masked(rest, head=0x80))
            page.sendall(masked(b'{"text": "no"}'))
            assert page.recv(1000) == b"\x81\x0d'no' is wrong"
            assert heard == [1, 200, 70_000, 5]
            page.sendall(b"\x81\x02{}")  # only a browser masks what it sends
            assert page.recv(1000) == b""
        with opened(address, "http://evil.example") as other:
            assert b" 403 " in other.recv(1000)
    with serving(LiveFeed()) as address, opened(address, address.rsplit("/", 2)[0]) as page:
        assert b" 404 " in page.recv(1000), "a page that cannot perform has no such connection"


@contextlib.contextmanager
def opened(address: str, origin: str) -> Iterator[socket.socket]:
    """Ask for a connection over which a page sends messages."""
    with connected(address) as client:
        head = f"GET /{address.split('/', 3)[3]}inputs HTTP/1.1\r\nHost: 127.0.0.1:{port_of(address)}\r\n"
        head += (
            f"Origin: {origin}\r\nUpgrade: websocket\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        )
        client.sendall(head.encode())
        yield client


def masked(content: bytes, head: int = 0x81) -> bytes:
    """Return a frame as a browser sends it. head: the first byte, by default that of a whole text"""
    size = len(content)
    length = bytes([0x80 | size]) if size <= 125 else bytes([0x80 | 127]) + size.to_bytes(8)
    length = bytes([0x80 | 126]) + size.to_bytes(2) if 125 < size < 1 << 16 else length
    mask = b"\x12\x34\x56\x78"
    return bytes([head]) + length + mask + bytes(byte ^ mask[i % 4] for i, byte in enumerate(content))


def test_the_answer_to_a_key_is_that_of_the_standard() -> None:
    assert answer_to("dGhlIHNhbXBsZSBub25jZQ==") == "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=", "RFC 6455, 1.3"


def fetched(address: str) -> bytes:
    with urllib.request.urlopen(address) as answer:
        return bytes(answer.read())


def next_message(stream: Any) -> dict[str, Any]:
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        line = stream.readline().decode()
        if line.startswith("data: "):
            return dict(json.loads(line.removeprefix("data: ")))
    raise TimeoutError
