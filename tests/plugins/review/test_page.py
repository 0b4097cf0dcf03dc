"""The page in a browser, opened as a file: what is shown is what was asked for, to the frame."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from flowsculpt.render.graphics.three_js import FETCH, installed_file
from flowsculpt.render.post.image import read_png
from tests.needed_plugins import needs_plugins
from tests.page_flaws import flaws
from tests.plugins.review.looker import Opened
from tests.plugins.review.studio import FAILED, MISSING, number_in
from tests.simulated_show import LAST, Desk


def test_every_key_press_is_one_frame(opened: Opened) -> None:
    look = opened()
    for number in range(1, 9):
        assert (look.frame, look.number) == (number, number)
        look.press("ArrowRight")
    look.press("ArrowLeft", ",", "ArrowLeft")
    assert (look.frame, look.number) == (6, 6)
    look.press(".", "Shift+ArrowRight")
    assert (look.frame, look.ask("review.a.state(17)[0]")) == (MISSING, "missing")
    look.press("Shift+ArrowLeft", "End")
    assert look.number == LAST
    look.press("ArrowRight", "Home")
    assert look.number == 1


def test_the_focus_of_the_keyboard_is_seen_on_bright_and_on_dark_pictures(opened: Opened) -> None:
    look = opened()
    for _ in range(4):
        look.press("Tab")
        style = look.ask(
            "(({outlineStyle, outlineColor, boxShadow}) => [outlineStyle, outlineColor, boxShadow])"
            "(getComputedStyle(document.activeElement))"
        )
        assert style[:2] == ["solid", "rgb(255, 255, 255)"] and style[2].startswith("rgb(0, 0, 0)")


def test_playing_shows_every_frame_of_the_loop_in_turn(opened: Opened) -> None:
    look = opened(a="T010_tiny · daily.scale50", frame=3)
    look.press("[")
    look.press(*["ArrowRight"] * 3, "]")
    assert look.tab.inner_text("#range") == "Loop 3–6"
    look.ask(
        "(() => { window.went = []; const go = review.transport.go.bind(review.transport);"
        "review.transport.go = (f) => { window.went.push(f); go(f); }; })()"
    )
    look.press(" ")
    look.wait("window.went.length > 8")
    look.press(" ")
    went = look.ask("window.went")
    assert went[:8] == [3, 4, 5, 6, 3, 4, 5, 6]
    assert look.number == look.frame == went[-1]
    look.press("\\")
    assert look.tab.inner_text("#range") == "1–24"


def test_a_loop_that_dissolves_is_mixed_with_its_beginning_while_it_plays(
    opened: Opened, tmp_path: Path
) -> None:
    look = opened(a="T010_tiny · daily.scale50", frame=22)
    look.ask(
        "(() => { review.a.about.dissolve = 4; review.choose('a', review.a); window.went = [];"
        "const go = review.transport.go.bind(review.transport);"
        "review.transport.go = (f) => { go(f); window.went.push([f, review.stage.beginning]); }; })()"
    )

    def shown(frame: int, plays: str = "false") -> NDArray[np.float64]:
        look.ask(
            f"Object.assign(review.transport, {{ frame: {frame}, playing: {plays} }}) && review.redraw()"
        )
        for needed in (2, frame):
            look.wait(f"review.cache.isSettled(review.a.url({needed}))")
        look.tab.locator("#stage").screenshot(path=str(tmp_path / "seen.png"))
        return read_png(tmp_path / "seen.png")[..., :3].astype(np.float64)

    begins, ends, mixed = shown(2), shown(22), shown(22, "true")
    shown(22)
    middle = tuple(slice(length // 3, -length // 3) for length in begins.shape[:2])
    assert np.abs(begins - ends)[middle].max() > 20
    assert np.abs(mixed - 0.6 * ends - 0.4 * begins)[middle].max() <= 2
    look.press(" ")
    look.wait("window.went.length > 4")
    look.press(" ")
    assert look.ask("window.went")[:4] == [[23, [3, 0.6]], [24, [4, 0.8]], [5, None], [6, None]]


def test_j_k_and_l_play_backwards_stop_and_go_faster(opened: Opened) -> None:
    look = opened(frame=5)
    look.press("j")
    look.wait("review.transport.frame !== 5")
    assert look.ask("review.transport.direction") == -1
    look.press("k")
    assert not look.ask("review.transport.playing")
    look.press("l", "l", "l")
    assert look.ask("[review.transport.direction, review.transport.speed]") == [1, 2]
    look.press("k", "<")
    assert look.tab.input_value("#speed") == "1.5"


def test_a_frame_that_is_not_there_is_a_slate_that_says_why(opened: Opened) -> None:
    look = opened(frame=MISSING)
    assert look.tab.inner_text("#state") == "missing"
    slate = look.picture()
    assert len(np.unique(slate.reshape(-1, 3), axis=0)) > 8 and number_in(slate) == 0
    look.press("n", "Shift+ArrowLeft", "ArrowRight", "ArrowRight")
    assert look.frame == FAILED
    assert look.tab.inner_text("#state") == "failed"
    assert "a lamp fell over" in look.tab.inner_text("#panel-facts")


def test_frames_that_are_not_there_can_be_left_out(opened: Opened) -> None:
    look = opened(frame=MISSING - 1)
    look.press("v", "ArrowRight")
    assert (look.frame, look.number) == (MISSING + 1, MISSING + 1)
    look.press("v", "ArrowLeft")
    assert (look.frame, look.tab.inner_text("#state")) == (MISSING, "missing")


def test_the_wipe_can_be_drawn_over_the_picture(opened: Opened) -> None:
    look = opened(b="T010_tiny · daily.scale50", frame=4)
    look.press("w")
    place = look.ask("review.stage.places()[0]")
    box = look.tab.locator("#stage").bounding_box()
    assert box is not None
    x, y = box["x"] + place["x"] + place["width"] / 2, box["y"] + box["height"] / 2
    look.tab.mouse.move(x, y)
    look.tab.mouse.down()
    look.tab.mouse.move(x - place["width"] / 4, y, steps=4)
    look.tab.mouse.up()
    row = look.picture()[-8, :, 0]
    edge = len(row) // 4
    assert (row[: edge - 4] < 20).all() and (row[edge + 4 :] > 235).all()
    assert abs(int(look.tab.input_value("#wipe")) - 25) <= 1


def test_the_difference_is_black_where_a_and_b_are_alike_and_grows_by_its_gain(opened: Opened) -> None:
    look = opened(a="T010_tiny · look chrome · draft", b="T010_tiny · draft", frame=2)
    look.press("d")
    look.tab.select_option("#gain", "1")
    faint = look.picture()
    assert faint[: len(faint) // 2 - 8].max() <= 4
    level = int(np.median(faint[-8]))
    look.tab.select_option("#gain", "4")
    assert 0 < level < 60 and abs(int(np.median(look.picture()[-8])) - 4 * level) <= 4


def test_side_by_side_shows_a_left_and_b_right(opened: Opened) -> None:
    look = opened(b="T010_tiny · daily.scale50", frame=6)
    look.press("s")
    look.settled()
    places, whole = look.ask("review.stage.places()"), look.seen()
    for place, light in zip(places, (0, 255), strict=True):
        x, y, w, h = (round(place[name]) for name in ("x", "y", "width", "height"))
        assert number_in(whole[y : y + h, x : x + w]) == 6
        assert abs(int(whole[y + h - 8, x + w // 2, 0]) - light) < 8
    look.press("x")
    assert look.tab.inner_text("#tag-a") == "daily.scale50"


def test_a_click_on_a_chart_goes_to_its_frame(opened: Opened) -> None:
    look = opened()
    chart = look.tab.locator("#panel-measures .plot").first
    box = chart.bounding_box()
    assert box is not None
    chart.click(position={"x": box["width"] * (12 - 0.5) / LAST, "y": 20})
    assert (look.frame, look.number) == (12, 12)
    assert "588 triangles" in look.tab.inner_text("#panel-measures")


def test_a_click_on_the_strip_goes_to_its_frame_and_hovering_shows_it(opened: Opened) -> None:
    look = opened()
    strip = look.tab.locator("#strip")
    box = strip.bounding_box()
    assert box is not None
    strip.click(position={"x": box["width"] * (20 - 0.5) / LAST, "y": 20})
    assert (look.frame, look.number) == (20, 20)
    look.tab.mouse.move(box["x"] + box["width"] * (FAILED - 0.5) / LAST, box["y"] + 20)
    assert look.tab.inner_text("#strip .hover").split() == [str(FAILED), "00:00:00:08", "failed"]
    assert strip.get_attribute("aria-valuetext") == f"frame 20 of {LAST}"


def test_zooming_keeps_the_point_under_the_mouse_where_it_is(opened: Opened) -> None:
    look = opened()
    box = look.tab.locator("#stage").bounding_box()
    assert box is not None

    def under(x: float, y: float) -> NDArray[np.float64]:
        place = look.ask("review.stage.places()[0]")
        return np.array([(x - place["x"]) / place["width"], (y - place["y"]) / place["height"]])

    before = under(300, 200)
    look.tab.mouse.move(box["x"] + 300, box["y"] + 200)
    look.tab.mouse.wheel(0, -400)
    look.wait("review.stage.zoom !== null")
    assert np.abs(under(300, 200) - before).max() < 0.005
    look.press("z")
    assert look.ask("review.stage.places()[0].width") == 480
    look.press("f")
    assert look.ask("review.stage.zoom") is None


@needs_plugins("sheets")
def test_a_click_in_the_grid_makes_a_cell_a_and_with_shift_b(opened: Opened) -> None:
    look = opened(frame=3)
    look.press("g")
    assert look.tab.locator("#grid .cell").count() == 4
    look.tab.get_by_role("button", name="look glaze").click()
    look.tab.get_by_role("button", name="look chrome").click(modifiers=["Shift"])
    assert look.ask("[review.a.label, review.b.label]") == ["look glaze · draft", "look chrome · draft"]
    look.press("1")
    assert look.number == 3 and look.picture()[-8].min() > 235


@pytest.mark.skipif(not installed_file().exists(), reason="three.js is not set up here")
def test_the_mesh_nearest_to_the_playhead_is_drawn(opened: Opened) -> None:
    look = opened(frame=LAST)
    look.press("m", "Shift+M")
    look.wait("review.panels.mesh.view?.shownName")
    assert "Frame 24, 6" in look.tab.inner_text("#panel-mesh .note")
    plain = look.seen(".mesh-stage").astype(int)
    assert np.ptp(plain) > 60 and (plain.max(axis=2) > 60).mean() > 0.03
    look.press("e")
    lined = look.seen(".mesh-stage").astype(int)
    assert (np.abs(lined - plain).max(axis=2) > 20).mean() > 0.002


def test_a_page_without_three_works_and_says_how_to_get_it(
    opened: Opened, desk: Desk, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(desk.page().parent, tmp_path / "page"))
    data = json.loads((folder / "data.js").read_text().removeprefix("window.reviewData = ").rstrip(";\n"))
    told = {**data, "three": None, "hint": f"three.js is not installed; {FETCH} fetches it"}
    (folder / "data.js").write_text(f"window.reviewData = {json.dumps(told)};")
    look = opened(folder / "index.html", frame=2)
    look.press("m", "ArrowRight")
    assert "flowsculpt.render.graphics.three_js fetches it" in look.tab.inner_text("#panel-mesh")
    assert look.number == 3


@needs_plugins("sheets")
def test_the_address_tells_what_is_shown(opened: Opened) -> None:
    look = opened(b="T010_tiny · look glaze · draft", frame=4)
    look.press("w", "ArrowRight")
    look.wait("location.hash.includes('frame=5')")
    address = look.ask("location.href")
    look.tab.goto("about:blank")
    look.tab.goto(address)
    look.wait("window.review")
    assert look.ask("[review.mode, review.b.label]") == ["wipe", "look glaze · draft"]
    assert look.frame == 5


def test_a_frame_is_typed_and_the_keys_play_again(opened: Opened) -> None:
    look = opened()
    look.press("Enter")
    look.tab.keyboard.type("15")
    look.press("Enter")
    assert (look.frame, look.number) == (15, 15)
    look.press("ArrowRight", "?")
    assert look.tab.locator("#help").is_visible() and "Side by side" in look.tab.inner_text("#help")
    assert look.ask("document.getElementById('help').scrollTop") == 0
    look.press("ArrowRight", "Escape")
    assert look.frame == 16


def test_bars_and_panel_leave_the_picture_free_in_wide_and_narrow_windows(opened: Opened) -> None:
    look = opened(frame=3)
    look.press("Shift+E")
    sizes = {(1280, 720): "beside", (1920, 1080): "beside", (700, 900): "below"}
    for (width, height), where in sizes.items():
        look.tab.set_viewport_size({"width": width, "height": height})
        look.wait("review.stage.canvas.width === Math.round(review.stage.canvas.clientWidth)")
        boxes = [look.tab.locator(name).bounding_box() for name in ("#viewing", "#viewer", "#panel")]
        bar, viewer, panel = (each or {} for each in boxes)
        assert bar["y"] + bar["height"] <= viewer["y"] + 1, "no picture under the bar"
        assert (panel["y"] >= viewer["y"] + viewer["height"] - 1) == (where == "below")
        assert panel["x"] + panel["width"] <= width and look.picture().shape[1] > 0.5 * width
    look.press("Shift+E")
    look.tab.set_viewport_size({"width": 1200, "height": 720})


def test_the_page_is_used_in_light_and_dark_on_a_phone_and_by_keys_alone(opened: Opened) -> None:
    look = opened()
    assert flaws(look.tab) == []


def test_axe_finds_nothing_serious(opened: Opened) -> None:
    look = opened()
    for keys in (["w"], ["n", "d"], ["m"], ["g"], ["?"]):
        look.press(*keys)
        assert look.findings() == [], keys


@needs_plugins("sheets")
def test_the_differences_of_shot_files_stand_beside_the_picture(opened: Opened) -> None:
    look = opened(a="T010_tiny · look chrome · draft", b="T010_tiny · look glaze · draft", frame=2)
    look.press("Shift+D")
    assert look.tab.locator("#panel-shot .less").all_inner_texts() == ["−# --set look=chrome"]
    assert look.tab.locator("#panel-shot .more").all_inner_texts() == ["+# --set look=glaze"]
    assert "2 lines differ" in look.tab.inner_text("#panel-shot") and look.findings() == []
    look.tab.select_option("#choose-b", label="draft")
    assert look.tab.locator("#panel-shot .more").count() == 0
    look.tab.select_option("#choose-a", label="draft")
    assert "resample: {max_edge_length: 0.5}" in look.tab.inner_text("#panel-shot")


def test_differing_lines_are_the_fewest_that_tell_two_texts_apart(opened: Opened) -> None:
    look = opened()
    cases = [("abcd", "abxd"), ("", "ab"), ("abcabba", "cbabac"), ("same", "same"), ("x", "")]
    for one, other in cases:
        lines = look.ask("([a, b]) => differences([...a], [...b])", [one, other])
        assert "".join(line for sign, line in lines if sign != "+") == one
        assert "".join(line for sign, line in lines if sign != "−") == other
    assert len(look.ask("differences([...'abcabba'], [...'cbabac']).filter(([sign]) => sign !== ' ')")) == 5
