"""Somebody at the review page, for tests in a browser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page as Tab

from flowsculpt.render.post.image import read_png
from tests.chromium import wait_for
from tests.page_flaws import findings
from tests.plugins.review.studio import number_in


@dataclass(frozen=True)
class Looker:
    """Somebody at the page."""

    tab: Tab
    scratch: Path

    def press(self, *keys: str) -> None:
        for key in keys:
            self.tab.keyboard.press(key)

    def ask(self, expression: str, given: Any = None) -> Any:
        return self.tab.evaluate(expression, given)

    @property
    def frame(self) -> int:
        """The frame number that the page shows."""
        return int(self.tab.input_value("#frame"))

    def wait(self, condition: str) -> None:
        wait_for(self.tab, condition)

    def settled(self) -> None:
        """Wait until the pictures that are to be shown are there."""
        self.wait("[review.a, review.b].every((s) => review.cache.isSettled(s.url(review.transport.frame)))")

    def seen(self, selector: str = "#stage") -> NDArray[np.uint8]:
        """(H, W, 3): an element as the display has it."""
        file = self.scratch / "seen.png"
        self.tab.locator(selector).screenshot(path=str(file))
        return read_png(file)[..., :3]

    def picture(self) -> NDArray[np.uint8]:
        """The picture alone, without what is around it."""
        self.settled()
        at = {name: round(value) for name, value in self.ask("review.stage.places()[0]").items()}
        return self.seen()[at["y"] : at["y"] + at["height"], at["x"] : at["x"] + at["width"]]

    @property
    def number(self) -> int:
        """The frame's number as the picture itself tells it."""
        return number_in(self.picture())

    def findings(self) -> list[tuple[str, Any, str]]:
        """What axe finds on the page as it is now: rule, element and remedy."""
        return findings(self.tab)


Opened = Callable[..., Looker]


def written(look: Looker, words: str, *, key: str = "a") -> None:
    look.press(key)
    look.tab.keyboard.type(words)
    look.press("Control+Enter")


def drawn(look: Looker, *points: tuple[float, float]) -> None:
    """Drag over the picture, at shares of its width and height."""
    box, place = look.tab.locator("#stage").bounding_box(), look.ask("review.stage.places()[0]")
    assert box is not None
    at = [
        (box["x"] + place["x"] + x * place["width"], box["y"] + place["y"] + y * place["height"])
        for x, y in points
    ]
    look.tab.mouse.move(*at[0])
    look.tab.mouse.down()
    for point in at[1:]:
        look.tab.mouse.move(*point)
    look.tab.mouse.up()


def notes_of(look: Looker) -> list[dict[str, Any]]:
    return list(look.ask("review.notes.all"))


def downloaded(look: Looker, key: str) -> Path:
    with look.tab.expect_download() as download:
        look.press(key)
    path = look.scratch / download.value.suggested_filename
    download.value.save_as(path)
    return path
