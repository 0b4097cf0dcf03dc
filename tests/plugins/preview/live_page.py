"""Somebody at the live page of a shot, in a browser."""

from __future__ import annotations

import re
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from playwright.sync_api import Browser, FloatRect
from playwright.sync_api import Page as Tab

from flowsculpt.pipeline.plugins.preview.live_server import actions_of, serving
from flowsculpt.pipeline.plugins.preview.live_session import READY, LiveFeed, LiveSession
from flowsculpt.pipeline.plugins.preview.performer import Performer
from flowsculpt.pipeline.plugins.preview.shot_editor import ShotEditor
from flowsculpt.pipeline.plugins.preview.sketch import Sketch
from flowsculpt.pipeline.plugins.preview.surface_stream import SurfaceStream
from flowsculpt.pipeline.production.execution.project import Project
from tests.chromium import LIMIT, wait_for
from tests.page_flaws import findings
from tests.plugins.preview.live_follower import save_whole

NAME = "T010_tiny"
CURRENT = "page.film.isCurrent && page.film.arrived.size === page.film.take.last"
SHOWN = (
    f"document.getElementById('state').textContent === '{READY}'"
    " && page.film.arrived.size === page.film.take?.last"
)


@dataclass
class Follower:
    """Somebody at the page, and the shot that they work on."""

    tab: Tab
    shot: Path
    performer: Performer

    def wait(self, condition: str) -> None:
        wait_for(self.tab, condition)

    def save(self, text: str) -> None:
        """Save the shot as an editor does."""
        save_whole(self.shot, text)

    def wait_for_text(self, pattern: str) -> re.Match[str]:
        """Wait until the shot file matches a pattern."""
        limit = time.monotonic() + LIMIT
        while time.monotonic() < limit:
            if found := re.search(pattern, self.shot.read_text()):
                return found
            self.tab.wait_for_timeout(20)
        raise AssertionError(f"{pattern} is not in\n{self.shot.read_text()}")

    @property
    def frame(self) -> int:
        return int(self.tab.input_value("#frame"))

    def at(self, frame: int) -> None:
        self.tab.evaluate(f"page.film.transport.jump({frame})")

    def box(self, selector: str) -> FloatRect:
        """Return where an element is, in pixels of the window, perhaps once a new state has replaced it."""
        limit = time.monotonic() + LIMIT
        while time.monotonic() < limit:
            if box := self.tab.locator(selector).first.bounding_box():
                return box
            self.tab.wait_for_timeout(20)
        raise AssertionError(f"{selector} is not shown")

    def drag(self, selector: str, dx: float, dy: float, follows: str = "", at: float = 0.5) -> None:
        """Drag something, and while it is held wait until the page shows what follows from it.

        at  where it is held, as a fraction of its width and height
        """
        box = self.box(selector)
        x, y = box["x"] + box["width"] * at, box["y"] + box["height"] * at
        self.tab.mouse.move(x, y)
        self.tab.mouse.down()
        for share in (0.4, 1.0):
            self.tab.mouse.move(x + share * dx, y + share * dy)
        if follows:
            self.wait(f"document.getElementById('tag').textContent.startsWith('{follows}')")
        self.tab.mouse.up()

    @property
    def trouble(self) -> str:
        return self.tab.inner_text("#trouble")

    def violations(self) -> list[tuple[str, str, str]]:
        """Return the rules of accessibility that axe finds broken, and how."""
        return findings(self.tab)


@contextmanager
def live_page(browser: Browser, root: Path, text: str) -> Iterator[Follower]:
    """Open the page of a shot and show all its frames; the page may complain of refusals only."""
    shot = root / "shots" / f"{NAME}.yaml"
    shot.parent.mkdir(exist_ok=True)
    shot.write_text(text)

    is_over = threading.Event()

    def sketch() -> Sketch:
        if is_over.is_set():
            sys.exit()  # the thread that follows the shot
        return Sketch(Project(root, 2).request(shot, "draft", None, variant="none"))

    def follow() -> None:
        with suppress(SystemExit):
            session.follow()

    feed, complaints = LiveFeed(), []
    with SurfaceStream(Project(root, 2).store) as stream:
        session = LiveSession(sketch, feed, stream, lambda ready: None, {shot})
        editor = ShotEditor(shot)
        performer = Performer(editor, session)
        feed.sound = performer.sound
        with serving(feed, 0, actions_of(editor, session, performer)) as address:
            following = threading.Thread(target=follow, daemon=True)
            following.start()
            context = browser.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
            context.set_default_timeout(1000 * LIMIT)
            tab = context.new_page()
            tab.on("console", lambda message: complaints.append(message.text))
            tab.on("pageerror", lambda error: complaints.append(str(error)))
            tab.goto(address)
            made = Follower(tab, shot, performer)
            made.wait(SHOWN)
            yield made
            performer.end()
            is_over.set()
            made.save(f"{shot.read_text()}# the end\n")
            following.join()  # it reads no surface after they are gone
            context.close()
    refusals = [each for each in complaints if "status of 409" not in each and "status of 422" not in each]
    assert refusals == []
