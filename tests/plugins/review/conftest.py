"""Shared fixtures of the review page: a browser, and a page of numbered pictures."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser
from playwright.sync_api import Page as Tab

from tests.chromium import LIMIT
from tests.plugins.review.looker import Looker, Opened
from tests.plugins.review.studio import furnish
from tests.simulated_show import NAME, Desk


@pytest.fixture(scope="session")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Desk:
    """A studio with numbered pictures, and the page of them written."""
    root = tmp_path_factory.mktemp("review")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        made = furnish(root)
        code, words = made.command("review", NAME)
    assert code == 0, words
    return made


@pytest.fixture(scope="module")
def layered(desk: Desk, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A page with the layers of frames 1, 12 and 24; it goes again, for the studio is shared."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(desk.root)
        code, said = desk.command("review", NAME, "--layers", "3", "--name", "layered", "-q", "draft")
    assert code == 0 and "layers of 9 frames" in said
    yield desk.page("layered")
    shutil.rmtree(desk.page("layered").parent)


@pytest.fixture(scope="module")
def tab(browser: Browser) -> Iterator[Tab]:
    context = browser.new_context(viewport={"width": 1200, "height": 720}, reduced_motion="reduce")
    context.set_default_timeout(1000 * LIMIT)
    yield context.new_page()
    context.close()


@pytest.fixture
def opened(tab: Tab, desk: Desk, tmp_path: Path) -> Iterator[Opened]:
    """Opens the page; at the end nothing may have been complained of, and nothing asked of a network."""
    complaints: list[str] = []
    asked: list[str] = []
    listeners: dict[str, Callable[[Any], None]] = {
        "console": lambda m: complaints.append(m.text) if m.type in ("error", "warning") else None,
        "pageerror": lambda error: complaints.append(str(error)),
        "request": lambda request: asked.append(request.url),
    }
    for name, listener in listeners.items():
        tab.on(name, listener)  # type: ignore[call-overload]

    def open_page(page: Path | None = None, **said: object) -> Looker:
        words = "&".join(f"{name}={value}" for name, value in {"a": "T010_tiny · draft", **said}.items())
        tab.goto("about:blank")
        tab.goto(f"{(page or desk.page()).as_uri()}#{words}")
        looker = Looker(tab, tmp_path)
        looker.wait("window.review")
        looker.settled()
        return looker

    yield open_page
    assert tab.evaluate("window.attacked") is None, "titles and messages are text"
    for name, listener in listeners.items():
        tab.remove_listener(name, listener)
    readback = ("GPU stall", "willReadFrequently")  # of canvases
    assert [each for each in complaints if not any(words in each for words in readback)] == []
    assert [url for url in asked if not url.startswith(("file:", "blob:", "data:", "about:"))] == []


@pytest.fixture
def page(desk: Desk, tmp_path: Path) -> Callable[..., Path]:
    """Copies the page, so that it begins without kept notes; `notes` are those it was written with."""

    def copied(*notes: dict[str, Any]) -> Path:
        folder = Path(shutil.copytree(desk.page().parent, tmp_path / "page"))
        data = json.loads((folder / "data.js").read_text().removeprefix("window.reviewData = ").rstrip(";\n"))
        said = json.dumps({**data, "page": str(tmp_path), "notes": list(notes)}).replace("<", "\\u003c")
        (folder / "data.js").write_text(f"window.reviewData = {said};")
        return folder / "index.html"

    return copied
