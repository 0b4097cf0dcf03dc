"""The live page in a browser: frames as they come, and a shot that is staged there."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.conftest import TINY
from tests.page_flaws import flaws
from tests.plugins.preview.live_page import CURRENT, SHOWN, Follower, live_page

VORTEX = "  - vortex: {axis: z, centre: [0.5, 0.25, 0], radius: 0.6, strength: 1} # stirred\n"
SHOT = TINY.replace("flows:\n", f"flows: # two\n{VORTEX}")


@pytest.fixture
def follower(browser: Browser, tmp_path: Path) -> Iterator[Follower]:
    with live_page(browser, tmp_path, SHOT) as made:
        yield made


def test_frames_are_shown_and_stepped_by_keys(follower: Follower) -> None:
    for key, frame in (("End", 6), ("ArrowLeft", 5), ("ArrowRight", 6), ("ArrowRight", 6), ("Home", 1)):
        follower.tab.keyboard.press(key)
        assert follower.frame == frame
    assert f"/frames/1/{follower.frame}.jpg" in str(follower.tab.evaluate("page.film.shown.source"))
    inside = follower.tab.evaluate(
        "(() => { const at = (s) => document.querySelector(s).getBoundingClientRect();"
        " return at('#picture').bottom <= at('footer').top && at('#picture').right <= at('#panel').left"
        " && at('#picture').width > 500; })()"
    )
    assert inside, "nothing of the picture is covered"
    follower.tab.keyboard.press(" ")
    follower.wait("page.film.at > 2")


def test_a_save_is_seen_and_a_mistake_told_until_it_is_mended(follower: Follower) -> None:
    follower.save(SHOT.replace("elevation: 14", "elevation: fourteen"))
    follower.wait("!document.getElementById('trouble').hidden")
    assert ":8:" in follower.trouble
    follower.save(SHOT.replace("elevation: 14", "elevation: 40"))
    follower.wait(f"document.getElementById('trouble').hidden && page.film.take.take > 1 && {CURRENT}")
    follower.wait("page.shot.get(['camera', 'elevation']).value === 40")


def test_the_page_is_used_in_light_and_dark_on_a_phone_and_by_keys_alone(follower: Follower) -> None:
    assert flaws(follower.tab, 90) == []


def test_the_film_plays_backwards_and_in_a_loop_and_the_camera_turns_by_keys(follower: Follower) -> None:
    tab = follower.tab
    for key in ("Home", "ArrowRight", "i", "ArrowRight", "o"):
        tab.keyboard.press(key)
    assert tab.inner_text("#range") == "Loop 2–3"
    tab.evaluate(
        "(() => { window.went = []; const { transport } = page.film, go = transport.go.bind(transport);"
        "transport.go = (frame) => { went.push(frame); go(frame); }; })()"
    )
    tab.keyboard.press("j")
    follower.wait("went.length > 5")
    tab.keyboard.press("k")
    assert tab.evaluate("went.slice(0, 4)") == [2, 3, 2, 3]
    tab.focus("#help-button")
    tab.keyboard.press("Tab")
    assert tab.evaluate("document.activeElement.id") == "picture"
    tab.keyboard.press("ArrowRight")
    follower.wait_for_text(r"azimuth: -33\.5, elevation: 14\b")
    follower.wait(CURRENT)


def test_axe_finds_nothing_serious(follower: Follower) -> None:
    follower.at(4)
    follower.tab.click(".curve .open")
    for look in ("", "?"):
        if look:
            follower.tab.keyboard.press(look)
        assert follower.violations() == []


def test_numbers_are_set_by_slider_and_field_and_undone_with_their_comments(follower: Follower) -> None:
    tab, row = follower.tab, '[data-path="flows.0.vortex.radius"]'
    tab.locator(f"{row} input[type=text]").fill("0.9")
    tab.keyboard.press("Enter")
    follower.wait_for_text(r"radius: 0\.9, strength: 1\} # stirred")
    tab.locator(f"{row} input[type=range]").focus()
    tab.keyboard.press("ArrowRight")
    follower.wait_for_text(r"radius: 0\.9[1-9]\d*,")
    row = '[data-path="camera.elevation"] input[type=text]'
    tab.locator(row).focus()
    tab.keyboard.press("ArrowUp")
    tab.keyboard.press("ArrowUp")
    follower.wait_for_text(r"elevation: 1[5-9]")
    tab.locator(row).blur()
    tab.click('[data-group="look"] summary')
    tab.select_option('[data-path="look"] select', "glaze")
    follower.wait_for_text("look: glaze")
    follower.wait(f"{SHOWN} && page.shot.state.can_undo")
    for _ in range(4):
        tab.keyboard.press("Control+z")
    follower.wait("!page.shot.state.can_undo")
    assert follower.shot.read_text() == SHOT
    tab.click("#redo")
    follower.wait_for_text(r"radius: 0\.9,")
    follower.wait(CURRENT)


def test_what_is_typed_stays_while_the_page_takes_a_new_state(follower: Follower) -> None:
    tab, field = follower.tab, '[data-path="flows.0.vortex.radius"] input[type=text]'
    tab.locator(field).fill("0.7")
    tab.evaluate("page.shot.refresh()")
    assert tab.input_value(field) == "0.7"
    tab.keyboard.press("Enter")
    follower.wait_for_text(r"radius: 0\.7,")
    follower.wait(CURRENT)


def test_keys_are_moved_added_removed_and_eased_in_the_timeline(follower: Follower) -> None:
    tab, curve = follower.tab, '[data-curve="flows.1.twist.amount"]'
    tab.click(f"{curve} .open")
    follower.drag(f'{curve} [data-focus="flows.1.twist.amount 1 0"]', 0, 30, "Approximate")
    number = float(follower.wait_for_text(r"4: (?!36,)([\d.]+), 6: 60")[1])
    assert 5 < number < 36
    tab.focus(f'{curve} [data-focus="flows.1.twist.amount 1 0"]')
    tab.keyboard.press("ArrowLeft")
    follower.wait_for_text(rf"keys: \{{1: 0, 3: {number:g}, 6: 60\}}")
    follower.wait("document.activeElement.getAttribute('aria-label') === 'Key at frame 3'")
    tab.keyboard.press("ArrowUp")
    follower.wait_for_text(rf"3: (?!{number:g},)[\d.]+, 6: 60")
    tab.select_option(f"{curve} .settings select >> nth=0", "bezier")
    follower.wait_for_text(r"3: \{value: [\d.]+, ease: bezier\}")
    follower.wait(f"document.querySelector('{curve} .grip')")
    follower.drag(f"{curve} .grip", 20, -15)
    follower.wait_for_text(r"ease: bezier, right: \[[\d.]+, [-\d.]+\]\}")
    follower.at(5)
    tab.keyboard.press("s")
    follower.wait_for_text(r"5: [\d.]+, 6: 60\}")
    follower.wait("page.timeline.rows[0].keys.length === 4")
    tab.focus(f'{curve} [data-focus="flows.1.twist.amount 2 0"]')
    tab.keyboard.press("Delete")
    follower.wait_for_text(r"\]\}, 6: 60\}")
    follower.at(3)
    tab.click('[data-path="camera.elevation"] .key')
    follower.wait_for_text(r"elevation: \{keys: \{3: 14\}\}")
    follower.wait("page.timeline.rows.length === 2")


def test_the_camera_and_the_flows_are_dragged_in_the_picture(follower: Follower) -> None:
    follower.at(4)
    follower.wait(CURRENT)
    follower.drag("#picture", 40, 30, "Drawn small", at=0.15)
    follower.wait_for_text(r"azimuth: -44, elevation: 24\.5")
    follower.wait(f"{SHOWN} && page.film.take.take > 1")
    centre = '[data-focus="flows.0.vortex.centre"]'
    follower.drag(f"{centre} .spot", 0, -40, "Approximate")
    y = float(follower.wait_for_text(r"centre: \[[-\d.]+, (?!0\.25)([-\d.]+), [-\d.]+\]")[1])
    assert y > 0.3, "upwards"
    follower.wait(f"{SHOWN} && page.film.take.take > 2")
    follower.tab.focus('[data-focus="flows.0.vortex.radius"]')
    follower.tab.keyboard.press("ArrowUp")
    follower.wait_for_text(r"radius: 0\.63")
    follower.wait("page.shot.get(['flows', 0, 'vortex', 'radius']).value === 0.63")
    follower.tab.focus('[data-focus="flows.0.vortex.axis"]')
    follower.tab.keyboard.press("Shift+ArrowRight")
    follower.wait_for_text(r"axis: \[[-\d., ]+\]")
    follower.wait(f"{SHOWN} && page.shot.state.can_undo")
    follower.tab.mouse.wheel(0, 0)
    follower.tab.hover("#picture")
    follower.tab.mouse.wheel(0, 200)
    follower.wait_for_text(r"dolly: 1\.2")


def test_each_refusal_is_one_message_and_nothing_is_lost(follower: Follower) -> None:
    tab, field = follower.tab, '[data-path="flows.0.vortex.radius"] input[type=text]'
    tab.locator(field).fill("-1")
    tab.keyboard.press("Enter")
    follower.wait("!document.getElementById('trouble').hidden")
    assert re.search(
        r":6:\d+: flows\.0\.vortex\.radius: -1 is out of range; it must be above 0$", follower.trouble
    )
    assert follower.shot.read_text() == SHOT and tab.input_value(field) == "0.6"
    radius = "{kind: 'set', where: ['flows', 0, 'vortex', 'radius'], value: 0.7}"
    tab.evaluate(f"void page.shot.edit([{radius}], '', '0'.repeat(64))")  # a text that is no longer there
    follower.wait("document.getElementById('trouble').textContent.includes('has changed in the meantime')")
    assert follower.shot.read_text() == SHOT
    tab.locator(field).fill("0.7")
    tab.keyboard.press("Enter")
    follower.wait_for_text(r"radius: 0\.7,")
    follower.wait("document.getElementById('trouble').hidden")
