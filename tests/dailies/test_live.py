"""The live page hears of frames as they are made, edits the shot file, and draws at once what is dragged."""

from __future__ import annotations

import base64
import json
import socket
import threading
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.dailies.preview import live_server
from pipeline.dailies.preview.live_feed import LiveFeed
from pipeline.dailies.preview.live_server import serving
from pipeline.dailies.preview.live_session import LiveSession
from pipeline.dailies.preview.shot_editor import ShotEditor, edits_in
from pipeline.dailies.preview.sketch import Sketch
from pipeline.dailies.preview.staging import actions_of
from pipeline.dailies.preview.surface_stream import SurfaceStream
from pipeline.dailies.preview.trial_pictures import TrialPictures
from pipeline.errors import FlowsculptError
from pipeline.production.execution.project import Project
from pipeline.shot.yaml.edits import ValueEdit
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
        self.session = session = LiveSession(self._sketch, self.feed, self.stream, self._done, {self.shot})
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


def test_what_an_edit_left_alone_is_shown_as_it_was(follower: Follower) -> None:
    follower.until("Up")
    before = {n: follower.feed.picture(1, n) for n in range(1, 7)}
    follower.shot.write_text(TINY.replace("A box, twisted", "A box"))
    assert frames(follower.until("Up")) == [1, 2, 3, 4, 5, 6], "each once, for its camera stays too"
    assert all(follower.feed.picture(2, n) is before[n] for n in range(1, 7))
    follower.shot.write_text(TINY.replace("camera:", "look: glaze\ncamera:"))
    follower.until("Up")
    assert all(follower.feed.picture(3, n) != before[n] for n in range(1, 7))


def test_a_mistake_is_told_at_its_line_and_mended_by_the_next_save(follower: Follower) -> None:
    follower.until("Up")
    follower.shot.write_text(TINY.replace("twist", "twits"))
    told = follower.until("")
    assert told[-1]["trouble"] and ":6:" in told[-1]["words"] and "twist" in told[-1]["words"]
    follower.shot.write_text(TINY.replace("elevation: 14", "elevation: 30"))
    assert frames(follower.until("Up"))[:6] == [1, 2, 3, 4, 5, 6]


def test_a_save_ends_what_is_being_shown(follower: Follower) -> None:
    follower.until("Simulating")
    follower.shot.write_text(TINY.replace("elevation: 14", "elevation: 40"))
    messages = follower.until("Up")
    assert messages[-1]["event"] == "say" and follower.movies == 1
    assert follower.feed.picture(2, 6) is not None


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
        (413, page.post("edit", b"{" + b" " * 70_000 + b"}")),
        (400, page.post("edit", b"[]")),
        (400, page.post("edit", b'{"digest": NaN}')),
        (400, page.post("edit", deep)),
        (400, page.post("edit", b"\xff\xfe")),
        (422, page.post("edit", {"digest": 3, "edits": [ELEVATION]})),
        (422, page.post("edit", {"digest": digest, "edits": [{**ELEVATION, "value": {"a": {}}}]})),
        (422, page.post("follow", {"digest": digest, "edits": [ELEVATION], "frame": "x"})),
        (422, page.post("follow", good | {"frame": 3})),
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
    with socket.create_connection(place, timeout=PATIENCE) as client:
        client.sendall(f"{head}Content-Type: application/json\r\nContent-Length: 100\r\n\r\n{{".encode())
        assert client.recv(1000) == b""


def test_a_drag_shows_the_current_frame_at_once_and_writes_nothing(follower: Follower) -> None:
    follower.until("Up")
    editor = ShotEditor(follower.shot)
    pictures = TrialPictures(editor, follower.session)
    digest = editor.state()["digest"]

    def shown(*edits: dict[str, Any], frame: int = 4) -> dict[str, Any]:
        return pictures.picture(digest, edits_in(list(edits)), frame)

    def pixels(answer: dict[str, Any]) -> NDArray[Any]:
        return np.asarray(iio.imread(base64.b64decode(answer["picture"])), float)

    twist = {"kind": "set", "where": ["flows", 0, "twist", "amount", "keys", "4"], "value": 36}
    same = shown({**ELEVATION, "value": 14})
    assert pixels(same).shape == (136, 240, 3)
    full = follower.feed.picture(1, 4)
    assert full is not None
    small = np.asarray(iio.imread(full), float)[::2, ::2][:135]
    assert np.abs(pixels(same)[:135] - small).mean() < 4, "the picture of the frame, but small"
    assert np.abs(pixels(shown({**twist, "where": [*twist["where"][:-1], 4]})) - pixels(same)).mean() < 1
    higher = shown(ELEVATION)
    assert higher["camera"]["origin"][1] > same["camera"]["origin"][1] and "Small" in higher["words"]
    wrung = shown({**twist, "where": [*twist["where"][:-1], 4], "value": 10})
    assert "Approximate" in wrung["words"] and np.abs(pixels(wrung) - pixels(same)).mean() > 2
    for edit, words in (
        ({"kind": "set", "where": ["subject", "size"], "value": [1, 1, 1]}, "let go to see it"),
        ({**ELEVATION, "value": "high"}, "elevation"),
    ):
        with pytest.raises(FlowsculptError, match=words):
            shown(edit)
    with pytest.raises(FlowsculptError, match="frame 9 is not simulated yet"):
        shown(ELEVATION, frame=9)
    assert follower.shot.read_text() == TINY


def test_the_picture_of_a_drag_is_near_the_simulated_one(follower: Follower) -> None:
    follower.until("Up")
    editor = ShotEditor(follower.shot)
    state = editor.state()
    edits = [ValueEdit("set", ("flows", 0, "twist", "amount", "keys", 4), 10)]
    trial = TrialPictures(editor, follower.session).picture(state["digest"], edits, 4)
    before, picture = (
        follower.feed.picture(1, 4),
        np.asarray(iio.imread(base64.b64decode(trial["picture"])), float),
    )
    editor.edit(state["digest"], edits)
    follower.until("Up")
    after = follower.feed.picture(2, 4)
    assert before is not None and after is not None
    old, new = (np.asarray(iio.imread(jpeg), float)[::2, ::2][:135] for jpeg in (before, after))
    assert np.abs(picture[:135] - new).mean() < 0.6 * np.abs(old - new).mean()
