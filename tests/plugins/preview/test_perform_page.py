"""A shot is performed on the live page: by handle, pointer, pen, MIDI, gamepad, OSC and keyboard."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser
from pythonosc.udp_client import SimpleUDPClient

from flowsculpt.pipeline.plugins.preview.control_inputs import gamepad_controls, midi_controls
from flowsculpt.pipeline.plugins.preview.osc_input import osc_controls, osc_input
from flowsculpt.pipeline.plugins.preview.performed_takes import TakeFolder
from tests.page_flaws import flaws
from tests.plugins.preview.live_page import SHOWN, Follower, live_page
from tests.sounds import sine, write_sound

SHOT = """\
title: A ball to perform
frames: 1-60
sound: {file: tone.wav}
subject: {solid: icosphere, radius: 1.0}
resample: {max_edge_length: 0.6}
flows:
  - vortex: {axis: z, centre: [0.4, 0.25, 0], radius: 0.6, strength: 0.2}
  - twist: {axis: y, amount: 3}
look: clay
camera: {azimuth: -30, elevation: 14, target: [0, 0, 0], distance: 7}
"""

STRENGTH, CENTRE, AMOUNT = "flows.0.vortex.strength", "flows.0.vortex.centre", "flows.1.twist.amount"

FAKE_DEVICES = """
window.port = {};
navigator.requestMIDIAccess = async () => ({ inputs: new Map([["fake", port]]) });
window.midi = (...data) => port.onmidimessage?.({ data, timeStamp: performance.now() });
window.pad = { index: 0, axes: [0, 0], buttons: [{ value: 0 }] };
navigator.getGamepads = () => [window.pad];
"""
"""A MIDI port and a gamepad that scripts move, in place of the browser's."""


HEARD = """(() => {
  const { perform: { sound }, film } = page, speed = sound.source.playbackRate.value;
  const heard = sound.begun + speed * (sound.context.currentTime - sound.at);
  return [heard - (film.at - film.take.first) / film.take.fps, sound.buffer.duration, speed];
})()"""
"""Seconds by which the sound is ahead of the picture, its length in seconds, and its speed."""


@pytest.fixture(scope="module")
def follower(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Follower]:
    root = tmp_path_factory.mktemp("perform")
    (root / "shots").mkdir()
    write_sound(root / "shots/tone.wav", sine(220.0, 2.0))
    with live_page(browser, root, SHOT) as made:
        made.tab.evaluate(f"(() => {{ {FAKE_DEVICES} }})()")
        made.at(2)
        yield made


@pytest.fixture(autouse=True)
def undone(follower: Follower) -> Iterator[None]:
    yield
    if follower.tab.evaluate("page.perform.isRecording"):
        stop(follower)
    for where in list(follower.performer.controls.armed):
        follower.performer.act({"do": "arm", "where": list(where)})
    follower.wait("page.perform.state.armed.length === 0")
    editor = follower.performer.editor
    while (state := editor.state())["can_undo"]:
        editor.undo(state["digest"])
    follower.performer.session.resume()
    follower.wait(f"{SHOWN} && page.shot.state.digest === '{state['digest']}'")
    assert follower.shot.read_text() == SHOT


def arm(
    follower: Follower, path: str, control: str = "", part: int = 0, low: float = 0, high: float = 1
) -> None:
    follower.tab.click(f'[data-path="{path}"] button >> nth=1')
    follower.wait(f"page.perform.state.armed.some((each) => each.where.join('.') === '{path}')")
    if control:
        where = follower.tab.evaluate(f"page.shot.values.get('{path}').where")
        bound = {"where": where, "part": part, "control": control, "low": low, "high": high}
        follower.performer.act({"do": "bind", **bound})


def record(follower: Follower, frame: int = 2) -> None:
    follower.at(frame)
    follower.tab.evaluate("document.activeElement.blur(); page.perform.speed = 0.25")
    follower.tab.keyboard.press("r")
    follower.wait("page.perform.isRecording && page.film.trial")


def stop(follower: Follower) -> None:
    follower.tab.keyboard.press("r")
    follower.wait("!page.perform.isRecording")


def samples(follower: Follower, path: str) -> list[list[float]]:
    """Return the samples of a value in the latest take."""
    folder = TakeFolder(follower.shot)
    where = [int(step) if step.isdigit() else step for step in path.split(".")]
    taken = folder.read(folder.names()[-1]).value_at(where)
    assert taken is not None
    return taken.samples


def test_a_handle_in_the_picture_is_performed_while_the_shot_plays(follower: Follower) -> None:
    tab = follower.tab
    tab.focus(f'[data-focus="{CENTRE}"]')
    tab.keyboard.press("a")
    follower.wait("page.perform.state.armed.length === 1")
    assert tab.locator(f'g.armed[data-focus="{CENTRE}"]').count() == 1
    record(follower)
    box = follower.box(f'[data-focus="{CENTRE}"] .spot')
    x, y = box["x"] + 5, box["y"] + 5
    tab.mouse.move(x, y)
    tab.mouse.down()
    for i in range(30):
        tab.mouse.move(x + 3 * i, y - 2 * i)
        tab.wait_for_timeout(8)
    frame = tab.evaluate("page.film.at")
    ahead, length, speed = tab.evaluate(HEARD)
    assert abs(ahead) < 0.25 and speed == 0.25, "the sound is where the picture is"
    assert length == pytest.approx(60 / 24, abs=0.01)
    assert frame > 3 and tab.inner_text("#tag").startswith("Recording")
    tab.mouse.up()
    stop(follower)
    follower.wait_for_text(r"centre: \{keys: \{\d+: \{value: \[0\.4, 0\.25, 0\], right: \[")
    rows = samples(follower, CENTRE)
    assert len(rows) > 20 and rows[-1][0] > rows[0][0] + 0.1 and rows[-1][1] > rows[0][1] + 0.1
    assert not follower.trouble


def test_a_value_that_is_not_armed_is_not_recorded_and_the_page_says_so(follower: Follower) -> None:
    arm(follower, AMOUNT)
    record(follower)
    follower.tab.focus(f'[data-focus="{CENTRE}"]')
    follower.tab.keyboard.press("ArrowUp")
    stop(follower)
    follower.wait("page.perform.state.words.startsWith('Nothing armed was moved')")
    assert follower.shot.read_text() == SHOT


def test_arrow_keys_perform_too(follower: Follower) -> None:
    tab = follower.tab
    tab.focus(f'[data-focus="{CENTRE}"]')
    tab.keyboard.press("a")
    follower.wait("page.perform.state.armed.length === 1")
    record(follower)
    tab.focus(f'[data-focus="{CENTRE}"]')
    for _ in range(5):
        tab.keyboard.press("ArrowUp")
    tab.evaluate("document.activeElement.blur()")
    stop(follower)
    assert len(samples(follower, CENTRE)) >= 5


def test_the_camera_is_performed_by_dragging_the_picture(follower: Follower) -> None:
    tab = follower.tab
    tab.evaluate("document.getElementById('picture').focus()")
    tab.keyboard.press("a")
    follower.wait("page.perform.state.armed.length === 2")
    record(follower)
    before = tab.evaluate("page.film.trial.camera.origin")
    box = follower.box("#picture")
    tab.mouse.move(box["x"] + 40, box["y"] + 40)
    tab.mouse.down()
    for i in range(20):
        tab.mouse.move(box["x"] + 40 + 4 * i, box["y"] + 40)
        tab.wait_for_timeout(8)
    follower.wait(f"Math.hypot(...page.film.trial.camera.origin.map((x, i) => x - {before}[i])) > 1")
    tab.mouse.up()
    stop(follower)
    turned = [row[0] for row in samples(follower, "camera.azimuth")]
    assert -35 > turned[-1] > -80 and turned == sorted(turned, reverse=True), "the drag does not run away"
    follower.wait_for_text(r"camera: \{azimuth: \{keys: \{\d+: \{value: -30, right")


def test_a_pen_performs_by_its_place_and_pressure(follower: Follower) -> None:
    arm(follower, STRENGTH, "pen pressure", low=0, high=2)
    arm(follower, AMOUNT, "pointer x", low=-10, high=10)
    record(follower)
    box = follower.box("#picture")
    session = follower.tab.context.new_cdp_session(follower.tab)
    kinds = ["mousePressed", *["mouseMoved"] * 24]
    for i, kind in enumerate(kinds):
        share = 0.1 + 0.03 * i
        session.send(
            "Input.dispatchMouseEvent",
            {
                "type": kind,
                "x": box["x"] + box["width"] * share,
                "y": box["y"] + box["height"] * 0.9,
                "button": "left",
                "buttons": 1,
                "clickCount": 1,
                "pointerType": "pen",
                "force": 0.2 + 0.03 * i,
            },
        )
        follower.tab.wait_for_timeout(8)
    stop(follower)
    pressure = [row[0] for row in samples(follower, STRENGTH)]
    across = [row[0] for row in samples(follower, AMOUNT)]
    assert pressure[-1] == pytest.approx(2 * 0.92, abs=0.02) and min(pressure[1:]) < 0.6
    assert len(pressure) > 20 and len(across) > 20 and across[-1] > across[5] > -10
    session.send("Input.dispatchMouseEvent", {"type": "mouseReleased", "x": 5, "y": 5, "button": "left"})


def test_midi_of_an_injected_fake_device_is_learned_and_performed(follower: Follower) -> None:
    tab = follower.tab
    arm(follower, STRENGTH, "learn", low=0, high=2)
    follower.wait("page.perform.state.armed[0].parts[0].control === 'learn'")
    tab.evaluate("midi(0xB0, 21, 3)")
    follower.wait("page.perform.state.armed[0].parts[0].control === 'midi cc 21'")
    record(follower)
    for value in range(0, 128, 8):
        tab.evaluate(f"midi(0xB0, 21, {value})")
        tab.evaluate("midi(0xB0, 22, 99)")
    tab.wait_for_timeout(60)
    stop(follower)
    rows = {round(row[0], 4) for row in samples(follower, STRENGTH)}
    assert {round(2 * value / 127, 4) for value in range(0, 128, 8)} <= rows, "no sample is lost"


def test_a_fake_gamepad_is_performed(follower: Follower) -> None:
    tab = follower.tab
    arm(follower, STRENGTH, "gamepad stick 1", low=0, high=1)
    follower.wait("page.perform.state.armed[0].parts[0].control === 'gamepad stick 1'")
    record(follower)
    tab.wait_for_timeout(100)
    for value in (-0.5, 0.25, 1):
        tab.evaluate(f"pad.axes[1] = {value}")
        tab.wait_for_timeout(120)
    stop(follower)
    assert {0.25, 0.625, 1.0} <= {round(row[0], 4) for row in samples(follower, STRENGTH)}


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def test_osc_by_udp_is_learned_and_performed_and_no_packet_is_lost(follower: Follower) -> None:
    tab, port = follower.tab, free_port()
    with osc_input(port, follower.performer.heard), SimpleUDPClient("127.0.0.1", port) as client:
        arm(follower, CENTRE, "learn", part=1, low=-1, high=1)
        client.send_message("/xy", [0.5, 0.5])
        follower.wait("page.perform.state.armed[0].parts[1].control === 'osc /xy 0'")
        record(follower)
        for i in range(40):
            client.send_message("/xy", [i / 40, 1.0])
            client.send_message("/other", ["words", float("nan")])
            tab.wait_for_timeout(5)
        stop(follower)
    rows = samples(follower, CENTRE)
    assert {round(2 * i / 40 - 1, 4) for i in range(40)} <= {round(row[1], 4) for row in rows}
    assert {row[0] for row in rows} == {0.4}, "the other numbers of the vector stay"


def test_a_page_that_closes_ends_the_recording_and_keeps_the_take(
    follower: Follower, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flowsculpt.pipeline.plugins.preview.performer.SILENCE", 1.0)
    tab = follower.tab
    second = tab.context.new_page()
    second.goto(tab.url)
    second.wait_for_selector("#picture:not([hidden])")
    arm(follower, AMOUNT, "pointer x")
    second.evaluate("void page.perform.record()")
    follower.wait("page.perform.isRecording")
    box = second.locator("#picture").bounding_box()
    assert box is not None
    second.mouse.move(box["x"] + 50, box["y"] + 50)
    second.mouse.move(box["x"] + 90, box["y"] + 50)
    follower.wait("page.film.at > 3")
    names = TakeFolder(follower.shot).names()
    second.close()
    recording = follower.performer.recording
    if recording is not None:
        recording.heard -= 60.0  # this page goes on to say that it is there
        assert recording.done.wait(30)
    follower.wait("!page.perform.isRecording")
    assert len(TakeFolder(follower.shot).names()) == len(names) + 1
    assert all(path.suffix == ".json" for path in (follower.shot.parent / "takes").iterdir())


def test_armed_values_and_takes_are_reached_by_keyboard_and_clean_by_axe(follower: Follower) -> None:
    arm(follower, STRENGTH)
    arm(follower, CENTRE)
    assert flaws(follower.tab, stops=110) == []
    select = follower.tab.locator(".bound select").first
    select.focus()
    select.select_option("pointer y")
    follower.wait("page.perform.state.armed[0].parts[0].control === 'pointer y'")


@pytest.mark.parametrize(
    ("message", "moved"),
    [
        ([0xB3, 7, 127], [("midi cc 7", 1.0)]),
        ([0xE0, 127, 127], [("midi bend", 1.0)]),
        ([0x90, 60, 127], [("midi note", 60 / 127), ("midi velocity", 1.0)]),
        ([0x90, 60, 0], [("midi velocity", 0.0)]),
        ([0x80, 60, 64], [("midi velocity", 0.0)]),
        ([0xF8], []),
        ([0xC0, 5, 0], []),
    ],
)
def test_messages_of_midi_are_controls_from_0_to_1(message: list[int], moved: list[Any]) -> None:
    assert midi_controls(message) == moved


def test_sticks_rest_in_the_middle_and_osc_numbers_stay_as_they_are() -> None:
    assert gamepad_controls([0, 2, 0.0]) == [("gamepad stick 2", 0.5)]
    assert gamepad_controls([1, 3, 1.0]) == [("gamepad button 3", 1.0)]
    assert osc_controls("/fader", (220.5,)) == [("osc /fader", 220.5)]
    assert osc_controls("/none", ("a",)) == []
