"""The page in a browser: what one clicks becomes the choice that `breed --from-page` reads."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from flowsculpt.pipeline.plugins.breed.generation_page import PageChild, next_name, page_text, read_choice
from tests.page_flaws import flaws

RECORD = {"name": "cube_1", "generation": 1, "seed": 4, "change": 0.3, "parents": [{}], "children": []}


def pictures(shade: int) -> np.ndarray:
    return np.full((9, 18, 32, 3), shade, np.uint8)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A generation of four children, with its page."""
    monkeypatch.chdir(tmp_path)
    made = tmp_path / "bred" / "cube_1"
    made.mkdir(parents=True)
    names = [f"cube_1_0{k}" for k in range(1, 5)]
    record = {**RECORD, "children": [{"name": name} for name in names]}
    (made / "generation.json").write_text(json.dumps(record))
    children = [
        PageChild(name, ("a <b>twist</b>",), "A twist.", pictures(60 * k)) for k, name in enumerate(names)
    ]
    (made / "index.html").write_text(page_text(record, "bred/cube_1", children, [("cube", pictures(9))]))
    return made


def test_favourites_and_parents_that_are_clicked_become_a_choice(browser: Browser, folder: Path) -> None:
    tab = browser.new_page()
    complaints: list[str] = []
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.on(
        "request", lambda request: complaints.append(request.url) if request.url.startswith("http") else None
    )
    tab.goto(f"file://{folder}/index.html")
    assert tab.locator("#copy").is_disabled()
    cards = tab.locator("article")
    assert cards.count() == 4 and "<b>twist</b>" in cards.nth(0).inner_text()
    for child in (1, 3, 4):  # of three parents the first one yields
        cards.nth(child - 1).locator(".choose").click()
    cards.nth(1).locator("img").click()
    tab.fill("#name", "very calm; rm *")
    tab.fill("#seed", "12")
    command = shlex.split(tab.inner_text("#command"))
    tab.close()
    assert command[:3] == ["flowsculpt", "breed", "--from-page"] and len(command) == 4 and not complaints
    choice = read_choice(command[3])
    assert choice.parents == (Path("bred/cube_1/cube_1_03.yaml"), Path("bred/cube_1/cube_1_04.yaml"))
    assert choice.favourites == ("cube_1_02",)
    assert (choice.change, choice.seed, choice.name) == (0.3, 12, "very_calm_rm_")


def test_a_child_shows_its_last_picture_and_plays_whole_ones_under_the_pointer(
    browser: Browser, folder: Path
) -> None:
    tab = browser.new_page()
    tab.goto(f"file://{folder}/index.html")
    film = "document.querySelector('article .film')"
    place = f"getComputedStyle({film}).objectPosition"
    shown = f"{film}.getAnimations().map((each) => each.effect.getTiming().duration)"
    assert (tab.evaluate(place), tab.evaluate(shown)) == ("0px 100%", [])
    tab.locator("article").first.hover()
    (duration,) = tab.evaluate(shown)
    found = set()
    for share in np.linspace(0.0, 0.99, 40):
        now = f"{film}.getAnimations()[0].currentTime = {share * duration}"
        found.add(tab.evaluate(f"(() => {{ {now}; return {place}; }})()"))
    tab.close()
    assert found == {f"0px {100 * k / 8:g}%" for k in range(9)}


def test_the_page_is_used_in_light_and_dark_on_a_phone_and_by_keys_alone(
    browser: Browser, folder: Path
) -> None:
    tab = browser.new_page(offline=True)
    tab.goto(f"file://{folder}/index.html")
    assert flaws(tab) == []
    tab.keyboard.press("2")
    assert tab.locator("article.favourite").count() == 1
    tab.close()


def test_generations_are_counted_by_their_names() -> None:
    assert [next_name(name) for name in ("cube_1", "cube_9", "calm")] == ["cube_2", "cube_10", "calm_2"]
