"""The live page hears of frames as they are made, and of those alone that an edit changed."""

from __future__ import annotations

import contextlib
import itertools
import json
import re
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pipeline.dailies.preview import live_server
from pipeline.dailies.preview.live_server import LiveFeed, serving
from pipeline.dailies.preview.live_session import LiveSession
from pipeline.dailies.preview.sketch import Sketch
from pipeline.dailies.preview.surface_stream import SurfaceStream
from pipeline.errors import MachineError
from pipeline.production.execution.project import Project
from tests.conftest import TINY

NAME = "T010_tiny"
PATIENCE = 60.0


class Follower:
    """Someone who follows a tiny shot while it is worked on."""

    def __init__(self, root: Path) -> None:
        self.root, self.shot = root, root / "shots" / f"{NAME}.yaml"
        self.shot.parent.mkdir()
        self.shot.write_text(TINY)
        self.feed, self.stream = LiveFeed(), SurfaceStream(Project(root, 2).store)
        self.movies = 0
        session = LiveSession(self._sketch, self.feed, self.stream, self._done, {self.shot})
        self.heard = self.feed.subscribe()
        threading.Thread(target=session.follow, daemon=True).start()

    def until(self, words: str) -> list[dict[str, Any]]:
        """All that is heard until something is said that begins with these words."""
        messages = []
        while not (messages and messages[-1].get("words", "").startswith(words)):
            messages.append(self.heard.get(timeout=PATIENCE))
        return messages

    def _sketch(self) -> Sketch:
        return Sketch(Project(self.root, 2).request(self.shot, "draft", None, variant="none"))

    def _done(self, ready: object) -> None:
        self.movies += 1


@pytest.fixture
def follower(tmp_path: Path) -> Iterator[Follower]:
    made = Follower(tmp_path)
    yield made
    made.stream.__exit__(None, None, None)


def frames(messages: list[dict[str, Any]]) -> list[int]:
    return [message["frame"] for message in messages if message["event"] == "frame"]


def test_every_frame_comes_while_the_next_is_simulated_and_again_from_the_right_camera(
    follower: Follower,
) -> None:
    messages = follower.until("Save")
    assert messages[0].pop("session") == follower.feed.session
    assert messages[0] == {
        "event": "begin",
        "take": 1,
        "shot": NAME,
        "first": 1,
        "last": 6,
        "fps": 24.0,
        "size": [480, 270],
    }
    assert frames(messages) == [1, 2, 3, 4, 5, 6] * 2 and follower.movies == 1
    jpeg = follower.feed.picture(1, 3)
    assert jpeg is not None and jpeg[:3] == b"\xff\xd8\xff"
    late = follower.feed.subscribe()
    assert [late.get()["event"] for _ in range(8)] == ["begin", *["frame"] * 6, "say"]


def test_what_an_edit_left_alone_is_shown_as_it_was(follower: Follower) -> None:
    follower.until("Save")
    before = {n: follower.feed.picture(1, n) for n in range(1, 7)}
    follower.shot.write_text(TINY.replace("A box, twisted", "A box"))
    assert frames(follower.until("Save")) == [1, 2, 3, 4, 5, 6], "each once, for its camera stays too"
    assert all(follower.feed.picture(2, n) is before[n] for n in range(1, 7))
    follower.shot.write_text(TINY.replace("camera:", "look: glaze\ncamera:"))
    follower.until("Save")
    assert all(follower.feed.picture(3, n) != before[n] for n in range(1, 7))


def test_a_mistake_is_told_at_its_line_and_mended_by_the_next_save(follower: Follower) -> None:
    follower.until("Save")
    follower.shot.write_text(TINY.replace("twist", "twits"))
    told = follower.until("")
    assert told[-1]["trouble"] and ":6:" in told[-1]["words"] and "twist" in told[-1]["words"]
    follower.shot.write_text(TINY.replace("elevation: 14", "elevation: 30"))
    assert frames(follower.until("Save"))[:6] == [1, 2, 3, 4, 5, 6]


def test_a_save_ends_what_is_being_shown(follower: Follower) -> None:
    follower.until("Simulating")
    follower.shot.write_text(TINY.replace("elevation: 14", "elevation: 40"))
    messages = follower.until("Save")
    assert messages[-1]["event"] == "say" and follower.movies == 1
    assert follower.feed.picture(2, 6) is not None


def test_browsers_on_this_machine_are_served_and_no_others() -> None:
    feed = LiveFeed()
    request = feed.begin("A", 1, 2, 24.0, (8, 4))
    feed.show(request, 1, b"picture")
    with serving(feed) as address:
        assert fetched(address + "frames/1/1.jpg?1") == b"picture"
        assert b"page.js" in fetched(address)
        for path, host, code in (
            ("frames/1/2.jpg", None, 404),
            ("page/../server.py", None, 404),
            ("frames/1/1.jpg", "evil.example", 403),
            ("frames/1/1.jpg", "localhost.evil.example", 403),
            ("..%2f..%2fetc/passwd", None, 404),
        ):
            assert code_of(address + path, {"Host": host} if host else {}) == code
        with pytest.raises(MachineError, match="leave --port out"), serving(feed, int(address[17:-1])):
            pass


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
    return socket.create_connection(("127.0.0.1", int(address[17:-1])), timeout=PATIENCE)


def test_clients_that_are_slow_or_say_too_much_are_cut_off_and_others_served(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(live_server, "PATIENCE", 1.0)
    feed = LiveFeed()
    with serving(feed) as address:
        slow = [connected(address) for _ in range(live_server.MOST_CONNECTIONS)]
        for number, client in enumerate(slow):
            client.sendall(b"GET / HTTP/1.1\r\n"[: number % 17])
        time.sleep(0.5)
        with connected(address) as one_more:
            assert one_more.recv(100) == b"", "there are too many"
        assert all(client.recv(100) == b"" for client in slow), "each had its time"
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
    assert capfd.readouterr().err == "", "nothing is printed over the command's progress"
    for client in slow:
        client.close()


def test_a_page_that_reads_nothing_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_server, "PATIENCE", 0.5)
    feed = LiveFeed()
    take = feed.begin("A", 1, 2, 24.0, (8, 4))
    with serving(feed) as address, connected(address) as client:
        client.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        client.recv(10)
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
