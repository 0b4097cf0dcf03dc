"""The live page hears of frames as they are made, edits the shot file, and draws at once what is dragged."""

from __future__ import annotations

import contextlib
import json
import socket
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.plugins.preview import live_server
from flowsculpt.pipeline.plugins.preview.live_server import actions_of, serving
from flowsculpt.pipeline.plugins.preview.live_session import LiveFeed, LiveSession
from flowsculpt.pipeline.plugins.preview.shot_editor import MOST_REQUEST_BYTES, ShotEditor
from flowsculpt.pipeline.plugins.preview.surface_stream import SurfaceStream
from flowsculpt.pipeline.production.execution.project import Project
from tests.conftest import TINY
from tests.plugins.preview.live_follower import NAME, PATIENCE, Follower


@pytest.fixture
def follower(tmp_path: Path) -> Iterator[Follower]:
    made = Follower(tmp_path, TINY)
    yield made
    made.stream.__exit__(None, None, None)


def frames(messages: list[dict[str, Any]]) -> list[int]:
    return [message["frame"] for message in messages if message["event"] == "frame"]


def test_every_frame_comes_while_the_next_is_simulated_and_again_from_the_right_camera(
    follower: Follower,
) -> None:
    messages = follower.until("Up")
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


@pytest.mark.slow
def test_what_an_edit_left_alone_is_shown_as_it_was(follower: Follower) -> None:
    follower.until("Up")
    before = {n: follower.feed.picture(1, n) for n in range(1, 7)}
    follower.save(TINY.replace("A box, twisted", "A box"))
    assert frames(follower.until("Up")) == [1, 2, 3, 4, 5, 6], "each once, for its camera stays too"
    assert all(follower.feed.picture(2, n) is before[n] for n in range(1, 7))
    follower.save(TINY.replace("camera:", "look: glaze\ncamera:"))
    follower.until("Up")
    assert all(follower.feed.picture(3, n) != before[n] for n in range(1, 7))


@pytest.mark.slow
def test_a_mistake_is_told_at_its_line_and_mended_by_the_next_save(follower: Follower) -> None:
    follower.until("Up")
    follower.save(TINY.replace("twist", "twits"))
    told = follower.until("")
    assert told[-1]["trouble"] and ":6:" in told[-1]["words"] and "twist" in told[-1]["words"]
    follower.save(TINY.replace("elevation: 14", "elevation: 30"))
    assert frames(follower.until("Up"))[:6] == [1, 2, 3, 4, 5, 6]


def test_a_save_ends_what_is_being_shown(tmp_path: Path) -> None:
    follower = Follower(tmp_path, TINY.replace("frames: 1-6", "frames: 1-4000"))
    follower.until("Simulating")
    follower.save(TINY.replace("elevation: 14", "elevation: 40"))
    messages = follower.until("Up")
    assert messages[-1]["event"] == "say" and follower.movies == 1
    assert follower.feed.picture(2, 6) is not None
    follower.stream.__exit__(None, None, None)


class Page:
    """A page that posts requests, as a browser does."""

    def __init__(self, address: str) -> None:
        self.address, self.origin = address, address.rsplit("/", 2)[0]

    def post(self, name: str, body: bytes | dict[str, Any], **headers: str) -> tuple[int, dict[str, Any]]:
        content = body if isinstance(body, bytes) else json.dumps(body).encode()
        usual = {"Origin": self.origin, "Content-Type": "application/json"}
        given = {**usual, **{key.replace("_", "-"): value for key, value in headers.items()}}
        request = urllib.request.Request(self.address + name, data=content, headers=given)
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
                return answer.status, json.load(answer)
        except urllib.error.HTTPError as refused:
            with refused:
                text = refused.read()
            return refused.code, json.loads(text) if text.startswith(b"{") else {}


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    shot = tmp_path / f"{NAME}.yaml"
    shot.write_text(TINY)
    feed = LiveFeed()
    with SurfaceStream(Project(tmp_path, 2).store) as stream:
        session = LiveSession(lambda: pytest.fail("not followed"), feed, stream, lambda ready: None, {shot})
        with serving(feed, 0, actions_of(ShotEditor(shot), session)) as address:
            yield Page(address)


ELEVATION = {"kind": "set", "where": ["camera", "elevation"], "value": 30}


def test_the_page_reads_edits_undoes_and_redoes(page: Page, tmp_path: Path) -> None:
    code, state = page.post("state", {})
    assert code == 200 and state["first"] == 1 and state["last"] == 6
    code, after = page.post("edit", {"digest": state["digest"], "edits": [ELEVATION]})
    assert code == 200 and after["can_undo"]
    assert (tmp_path / f"{NAME}.yaml").read_text() == TINY.replace("elevation: 14", "elevation: 30")
    assert page.post("edit", {"digest": state["digest"], "edits": [ELEVATION]})[0] == 409
    code, before = page.post("undo", {"digest": after["digest"]})
    assert (code, before["digest"]) == (200, state["digest"])
    assert page.post("redo", {"digest": before["digest"]})[1]["digest"] == after["digest"]


def test_requests_that_no_page_of_ours_makes_change_nothing(page: Page, tmp_path: Path) -> None:
    digest = page.post("state", {})[1]["digest"]
    good: dict[str, Any] = {"digest": digest, "edits": [ELEVATION]}
    elsewhere = Page(page.address.replace(page.address.split("/")[3], "x" * 32))
    elsewhere.origin = page.origin
    deep = b'{"edits":' + b"[" * 30_000 + b"]" * 30_000 + b"}"
    for code, answer in (
        (404, elsewhere.post("edit", good)),
        (404, page.post("exec", good)),
        (403, page.post("edit", good, Origin="http://evil.example")),
        (403, page.post("edit", good, Origin="null")),
        (403, page.post("edit", good, Origin=page.origin + ".evil.example")),
        (403, page.post("edit", good, Host="evil.example")),
        (403, page.post("edit", good, Sec_Fetch_Site="cross-site")),
        (415, page.post("edit", good, Content_Type="text/plain")),
        (415, page.post("edit", good, Content_Type="application/x-www-form-urlencoded")),
        (413, page.post("edit", b"{" + b" " * 8 * MOST_REQUEST_BYTES + b"}")),
        (400, page.post("edit", b"[]")),
        (400, page.post("edit", b'{"digest": NaN}')),
        (400, page.post("edit", deep)),
        (400, page.post("edit", b"\xff\xfe")),
        (422, page.post("edit", {"digest": 3, "edits": [ELEVATION]})),
        (422, page.post("edit", {"digest": digest, "edits": [{**ELEVATION, "value": {"a": {}}}]})),
        (422, page.post("follow", {"digest": digest, "edits": [ELEVATION], "frame": "x"})),
        (422, page.post("follow", good | {"frame": 3})),
        (422, page.post("prepare", {"where": [], "frame": 3})),
        (422, page.post("prepare", {"where": ["flows", {}], "frame": 3})),
        (422, page.post("prepare", {"where": ["flows"]})),
    ):
        assert answer[0] == code, answer
        assert "Traceback" not in str(answer[1])
    assert (tmp_path / f"{NAME}.yaml").read_text() == TINY


def test_a_request_that_announces_more_than_it_sends_is_cut_off(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_server, "PATIENCE", 0.5)
    token = page.address.split("/")[3]
    head = f"POST /{token}/edit HTTP/1.1\r\nHost: {page.origin[7:]}\r\nOrigin: {page.origin}\r\n"
    place = ("127.0.0.1", urllib.parse.urlsplit(page.address).port)
    with socket.create_connection(place, timeout=PATIENCE) as client, contextlib.suppress(ConnectionError):
        client.sendall(f"{head}Content-Type: application/json\r\nContent-Length: 100\r\n\r\n{{".encode())
        assert client.recv(1000) == b""
