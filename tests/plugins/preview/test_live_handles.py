"""The live page of several subjects: handles of composed flows, drags of all subjects, and small windows."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from tests.needed_plugins import needs_plugins
from tests.plugins.preview.live_page import CURRENT, SHOWN, Follower, live_page

pytestmark = needs_plugins("points")


SHOT = """\
title: A block and motes
frames: 1-6
subjects:
  block:
    solid: box
    size: [1.2, 1.2, 1.2]
    flows:
      - twist: {axis: y, centre: [-0.9, 0, 0], amount: {ease: linear, keys: {1: 0, 6: 60}}} # wrung
    place: [-0.9, 0, 0]
  motes: {cloud: {solid: icosphere, radius: 0.7}, count: 60, radius: 0.06, place: [0.9, 0, 0]}
resample: {max_edge_length: 0.4}
flows:
  - placed:
      translate: [0.9, 0.5, 0]
      rotate: [0, 0, 90]
      scale: 0.5
      flows:
        - vortex: {axis: x, centre: [1, 0, 0], radius: 1, strength: 1}
  - mirrored: {normal: x, centre: [0.5, 0, 0], flows: [{bend: {axis: z, centre: [1, 0.5, 0], amount: 20}}]}
  - reversed:
      flows:
        - vortex: {axis: z, centre: {ease: linear, keys: {1: [0, 0, 0], 6: [0, 1, 0]}}, strength: 0}
camera: {azimuth: -30, elevation: 14, target: [0, 0, 0], distance: 7}
"""

VORTEX = "flows.0.placed.flows.0.vortex"

PLACES = {
    f"{VORTEX}.centre": [0.9, 1, 0],
    "flows.0.placed.translate": [0.9, 0.5, 0],
    "flows.1.mirrored.centre": [0.5, 0, 0],
    "flows.1.mirrored.flows.0.bend.centre": [0, 0.5, 0],
    "flows.2.reversed.flows.0.vortex.centre": [0, 0.2, 0],
    "subjects.block.flows.0.twist.centre": [-0.9, 0, 0],
}
"""Centres in the scene at frame 5, which is the second from the end and so frame 2 of what is reversed."""


@pytest.fixture(scope="module")
def follower(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Follower]:
    with live_page(browser, tmp_path_factory.mktemp("handles"), SHOT) as made:
        made.at(5)
        made.wait(CURRENT)
        yield made


@pytest.fixture(autouse=True)
def undone(follower: Follower) -> Iterator[None]:
    yield
    while follower.tab.evaluate("page.shot.state.can_undo"):
        follower.tab.evaluate("page.shot.undo()")
    follower.wait(f"{SHOWN} && {CURRENT}")
    assert follower.shot.read_text() == SHOT


def spot(follower: Follower, name: str) -> list[float]:
    """Return the place of the handle of a centre, in pixels of the viewer."""
    return list(
        follower.tab.evaluate(
            f"(() => {{ const dot = document.querySelector('[data-focus=\"{name}\"] .spot');"
            " return ['cx', 'cy'].map((each) => Number(dot.getAttribute(each))); })()"
        )
    )


@pytest.mark.parametrize("name", PLACES)
def test_handles_are_where_placed_mirrored_reversed_and_subjects_flows_act(
    follower: Follower, name: str
) -> None:
    seen = follower.tab.evaluate(f"page.projection.point({PLACES[name]})")
    assert spot(follower, name) == pytest.approx([seen["x"], seen["y"]], abs=0.5)


def test_a_handle_of_a_placed_flow_writes_what_the_flow_has_within(follower: Follower) -> None:
    x, y = spot(follower, f"{VORTEX}.centre")
    depth = f"page.projection.point({PLACES[f'{VORTEX}.centre']}).depth"
    unit = follower.tab.evaluate(f"page.projection.unit({depth})")
    follower.drag(f'[data-focus="{VORTEX}.centre"] .spot', 0, -40, "Approximate: moved")
    found = follower.wait_for_text(r"vortex: \{axis: x, centre: \[(?!1, )([-\d.]+), ([-\d.]+), ([-\d.]+)\]")
    up = float(found[1]) - 1
    assert up == pytest.approx(2 * 40 * unit, rel=0.1), "up in the scene is along x within, at half the scale"
    follower.wait(f"{SHOWN} && {CURRENT}")
    assert spot(follower, f"{VORTEX}.centre") == pytest.approx([x, y - 40], abs=3)
    follower.tab.focus(f'[data-focus="{VORTEX}.radius"]')
    follower.tab.keyboard.press("ArrowUp")
    follower.wait_for_text(r"radius: 1\.05, strength")


LATE_EDITS = """() => {
  const fetchNow = window.fetch;
  const sent = new Promise((send) => { window.sendEdits = send; });
  window.fetch = async (name, ...rest) => {
    if (name === "edit") await sent;
    return fetchNow(name, ...rest);
  };
  window.endLateEdits = () => { window.sendEdits(); window.fetch = fetchNow; };
}"""
"""Has edits reach the server when `sendEdits` is called."""


@pytest.fixture
def late_edits(follower: Follower) -> Iterator[None]:
    follower.tab.evaluate(LATE_EDITS)
    yield
    follower.tab.evaluate("endLateEdits()")


@pytest.mark.usefixtures("late_edits")
def test_undo_waits_for_a_drag_that_is_still_being_written(follower: Follower) -> None:
    tab = follower.tab
    follower.drag('[data-focus="flows.0.placed.translate"] .spot', 0, -30)
    assert follower.shot.read_text() == SHOT and tab.is_enabled("#undo")
    tab.click("#undo")
    tab.evaluate("sendEdits()")
    follower.wait("!page.shot.writes")
    assert follower.shot.read_text() == SHOT and tab.is_disabled("#undo") and not follower.trouble
    assert tab.evaluate("page.shot.state.can_redo"), "the drag was written, and then undone"


@pytest.mark.usefixtures("late_edits")
def test_a_drag_that_begins_while_another_is_being_written_is_written_too(follower: Follower) -> None:
    follower.drag('[data-focus="flows.0.placed.translate"] .spot', 0, -30)
    follower.drag('[data-focus="flows.1.mirrored.centre"] .spot', 0, -30)
    follower.tab.evaluate("sendEdits()")
    follower.wait("!page.shot.writes")
    assert not follower.trouble
    assert "translate: [0.9, 0.5, 0]" not in (text := follower.shot.read_text())
    assert "normal: x, centre: [0.5, 0, 0]" not in text


@pytest.mark.usefixtures("late_edits")
def test_undo_undoes_a_turn_of_the_wheel_that_has_not_settled(follower: Follower) -> None:
    box = follower.box("#picture")
    follower.tab.mouse.move(box["x"] + 40, box["y"] + 40)
    follower.tab.mouse.wheel(0, 100)
    follower.wait("page.camera.wheeled || page.shot.writes")
    follower.tab.keyboard.press("Control+z")
    follower.tab.evaluate("sendEdits()")
    follower.wait("!page.shot.writes")
    assert follower.shot.read_text() == SHOT and follower.tab.evaluate("page.shot.state.can_redo")


def test_a_text_that_a_person_saves_meanwhile_is_kept_shown_and_said(follower: Follower) -> None:
    theirs = SHOT.replace("A block and motes", "A block and many motes").replace(
        "radius: 0.06", "radius: 0.07"
    )
    slider = follower.box('[data-focus="flows.0.placed.translate"] .spot')
    follower.tab.mouse.move(slider["x"] + 5, slider["y"] + 5)
    follower.tab.mouse.down()
    follower.tab.mouse.move(slider["x"] + 5, slider["y"] - 30)
    follower.save(theirs)
    follower.tab.mouse.up()
    follower.wait("document.getElementById('trouble').textContent.includes('has changed in the meantime')")
    follower.wait("page.shot.get(['subjects', 'motes', 'radius']).value === 0.07")
    assert follower.shot.read_text() == theirs
    follower.save(SHOT)
    follower.wait("page.shot.get(['subjects', 'motes', 'radius']).value === 0.06")


def test_handles_follow_the_camera_while_it_is_dragged(follower: Follower) -> None:
    before = spot(follower, "flows.0.placed.translate")
    box = follower.box("#picture")
    follower.tab.mouse.move(box["x"] + 40, box["y"] + 40)
    follower.tab.mouse.down()
    follower.tab.mouse.move(box["x"] + 160, box["y"] + 40)
    follower.wait("document.getElementById('tag').textContent.startsWith('Drawn small')")
    x, _ = spot(follower, "flows.0.placed.translate")
    seen = follower.tab.evaluate("page.projection.point([0.9, 0.5, 0])")
    assert abs(x - before[0]) > 10 and x == pytest.approx(seen["x"], abs=0.5)
    follower.tab.keyboard.press("Escape")
    follower.tab.mouse.up()


def test_keys_of_what_goes_backwards_are_set_at_its_own_time(follower: Follower) -> None:
    name = "flows.2.reversed.flows.0.vortex.centre"
    assert follower.tab.input_value(f'[data-path="{name}"] input >> nth=1') == "0.2"
    follower.tab.focus(f'[data-focus="{name}"]')
    follower.tab.keyboard.press("ArrowUp")
    follower.wait_for_text(r"keys: \{1: \[0, 0, 0\], 2: \[[-\d.]+, 0\.[2-9]\d*, [-\d.]+\], 6: ")


def test_values_of_one_of_several_subjects_are_dragged_and_written(follower: Follower) -> None:
    tab = follower.tab
    tab.click('[data-group="subjects.motes"] summary')
    slider = follower.box('[data-path="subjects.motes.radius"] input[type=range]')
    y = slider["y"] + slider["height"] / 2
    tab.mouse.move(slider["x"] + slider["width"] * 0.1, y)
    tab.mouse.down()
    tab.mouse.move(slider["x"] + slider["width"] * 0.3, y)
    follower.wait("document.getElementById('tag').textContent.startsWith('Approximate: a coarse')")
    tab.mouse.up()
    follower.wait_for_text(r"radius: 0\.(?!06)\d+, place: \[0\.9")
    curve = '[data-curve="subjects.block.flows.0.twist.amount"]'
    tab.click(f"{curve} .open")
    key = f'{curve} [data-focus="subjects.block.flows.0.twist.amount 1 0"]'
    follower.drag(key, 0, 40, "Approximate: moved")
    follower.wait_for_text(r"keys: \{1: 0, 6: (?!60\})[-\d.]+\}\}\} # wrung")
    tab.click(f"{curve} .open")


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (900, 600), (700, 500)])
def test_in_a_small_window_everything_is_there_and_nothing_is_cut(
    follower: Follower, width: int, height: int
) -> None:
    tab = follower.tab
    tab.set_viewport_size({"width": width, "height": height})
    tab.click('[data-curve="subjects.block.flows.0.twist.amount"] .open')
    tab.wait_for_timeout(100)
    boxes = tab.evaluate(
        "Object.fromEntries(['#picture', '#panel', '#help-button', '.curve.chosen svg'].map((each) => {"
        " const { left, right, top, bottom } = document.querySelector(each).getBoundingClientRect();"
        " return [each, { left, right, top, bottom }]; }))"
    )
    for name, box in boxes.items():
        assert box["left"] >= 0 and box["right"] <= width and box["right"] - box["left"] > 20, name
    picture, curve = boxes["#picture"], boxes[".curve.chosen svg"]
    assert picture["bottom"] - picture["top"] > 0.35 * height
    assert curve["top"] < height - 90, "the chosen curve is in view"
    assert boxes["#help-button"]["bottom"] < 50, "one line of buttons"
    tab.keyboard.press("v")
    assert tab.locator("#panel").is_visible() is False
    tab.keyboard.press("v")
    assert tab.locator("#panel").is_visible()
    assert follower.violations() == []
    tab.set_viewport_size({"width": 1280, "height": 800})
    tab.click('[data-curve="subjects.block.flows.0.twist.amount"] .open')
