"""The live page in a browser: frames as they come, stepping, and mistakes told."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import pytest
from playwright.sync_api import Browser
from playwright.sync_api import Page as Tab

from pipeline.dailies.preview.live_server import LiveFeed, serving
from pipeline.dailies.preview.live_session import LiveSession
from pipeline.dailies.preview.sketch import Sketch
from pipeline.dailies.preview.surface_stream import SurfaceStream
from pipeline.production.execution.project import Project
from tests.conftest import TINY
from tests.dailies.review.chromium import wait_for

NAME = "T010_tiny"
SHOWN = "document.getElementById('state').textContent.startsWith('Save')"


@dataclass
class Follower:
    """Somebody at the page, and the shot that they work on."""

    tab: Tab
    shot: Path

    def wait(self, condition: str) -> None:
        wait_for(self.tab, condition, 60.0)

    @property
    def frame(self) -> int:
        return int(self.tab.inner_text("#frame"))


@pytest.fixture
def follower(browser: Browser, tmp_path: Path) -> Iterator[Follower]:
    shot = tmp_path / "shots" / f"{NAME}.yaml"
    shot.parent.mkdir()
    shot.write_text(TINY)

    def sketch() -> Sketch:
        return Sketch(Project(tmp_path, 2).request(shot, "draft", None, variant="none"))

    feed, complaints = LiveFeed(), []
    with SurfaceStream(Project(tmp_path, 2).store) as stream, serving(feed) as address:
        session = LiveSession(sketch, feed, stream, lambda ready: None, {shot})
        threading.Thread(target=session.follow, daemon=True).start()
        context = browser.new_context(viewport={"width": 900, "height": 640}, reduced_motion="reduce")
        tab = context.new_page()
        tab.on("console", lambda message: complaints.append(message.text))
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        tab.goto(address)
        yield Follower(tab, shot)
        context.close()
    assert complaints == []


def test_frames_are_shown_and_stepped_by_keys(follower: Follower) -> None:
    follower.wait(SHOWN)
    follower.wait("pictures.size === 6")
    for key, frame in (("End", 6), ("ArrowLeft", 5), ("ArrowRight", 6), ("ArrowRight", 6), ("Home", 1)):
        follower.tab.keyboard.press(key)
        assert follower.frame == frame
    assert f"/frames/1/{follower.frame}.jpg" in str(follower.tab.get_attribute("#picture", "src"))
    inside = follower.tab.evaluate(
        "(() => { const at = (s) => document.querySelector(s).getBoundingClientRect();"
        " return at('#picture').bottom <= at('footer').top && at('#picture').width > 500; })()"
    )
    assert inside, "nothing of the picture is covered"
    follower.tab.keyboard.press(" ")
    follower.wait("at > 2")


def test_a_save_is_seen_and_a_mistake_told_until_it_is_mended(follower: Follower) -> None:
    follower.wait(SHOWN)
    follower.shot.write_text(TINY.replace("elevation: 14", "elevation: fourteen"))
    follower.wait("!document.getElementById('trouble').hidden")
    assert ":7:" in follower.tab.inner_text("#trouble")
    follower.shot.write_text(TINY.replace("elevation: 14", "elevation: 40"))
    follower.wait("document.getElementById('trouble').hidden && take.take > 1 && arrived.size === 6")


def test_axe_finds_nothing_serious(follower: Follower) -> None:
    axe = (files("axe_playwright_python") / "axe.min.js").read_text(encoding="utf-8")
    follower.wait(SHOWN)
    follower.tab.evaluate(f"(() => {{ {axe} }})()")
    found = follower.tab.evaluate("axe.run(document, {resultTypes: ['violations'], preload: false})")
    bad = [(each["id"], each["nodes"][0]["failureSummary"]) for each in found["violations"]]
    assert bad == []
