"""`python -m benchmarks.perform`: from the hand to the picture, while a shot is performed in a browser.

A ball of 25 thousand vertices in two vortices, at full and half speed. In Chromium, the centre of a vortex is
dragged by its handle in the picture, by real input. Each event has the browser's time stamp. It counts as
shown once a picture that was simulated with it is decoded, the next animation frame has begun, and a task
behind that has its turn. The picture says how many samples it was simulated with.

`ms` are the median and the 95th percentile over all events, `CPU ms a picture` those of simulation, drawing
and requests together, which other work on the machine hardly lengthens; those of the browser are not counted.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Browser

from benchmarks.live import SHOTS
from benchmarks.report import Row, Target, keep, show
from tests import chromium
from tests.plugins.preview.live_page import Follower, live_page

MEDIAN, MOST = 50.0, 100.0
"""Milliseconds from an event to its picture: the median, and the 95th percentile."""

CENTRE = "flows.0.sum.0.vortex.centre"

EVENTS, PAUSE = 200, 12  # events of a drag, and milliseconds between them

WATCH = """(() => {
  window.moved = [];
  window.shown = [];
  const { perform } = page, play = perform.play.bind(perform), heard = perform.heard.bind(perform);
  perform.play = (edits) => {
    if (perform.isRecording && edits.length) moved.push(perform.movedAt ?? window.event.timeStamp);
    play(edits);
  };
  perform.heard = (message) => {
    heard(message);
    document.getElementById('picture').decode().catch(() => {}).then(() => requestAnimationFrame(() => {
      setTimeout(() => shown.push([message.inputs, performance.now(), message.frame]), 0);
    }));
  };
})()"""


def performed(follower: Follower, speed: float) -> Row:
    """Perform a drag at a speed, and return what it took."""
    tab = follower.tab
    follower.at(2)
    tab.evaluate(f"page.perform.speed = {speed}; window.moved = []; window.shown = [];")
    follower.wait("!page.film.trial && page.film.isCurrent")
    core = time.process_time()
    box = follower.box(f'[data-focus="{CENTRE}"] .spot')
    x, y = box["x"] + 6, box["y"] + 6
    tab.mouse.move(x, y)
    tab.mouse.down()  # the handle moves with the camera, so it is held before the shot plays
    tab.keyboard.press("r")
    follower.wait("page.perform.isRecording && shown.length > 2")
    for i in range(EVENTS):
        if not tab.evaluate("page.perform.isRecording"):
            break
        tab.mouse.move(x + 4 + 0.5 * i, y - 0.4 * i)
        tab.wait_for_timeout(PAUSE)
    tab.mouse.up()
    follower.wait("!page.perform.isRecording")
    moved, shown = tab.evaluate("[moved, shown]")
    core = time.process_time() - core
    tab.evaluate("page.shot.undo()")
    follower.wait("!page.shot.writes")
    waits = []
    for number, at in enumerate(moved, start=1):
        after = [time for inputs, time, _ in shown if inputs >= number and time >= at]
        waits += [min(after) - at] if after else []
    seconds = (shown[-1][1] - shown[0][1]) / 1000.0
    waits.sort()
    return {
        "speed": speed,
        "events": len(waits),
        "median ms": statistics.median(waits),
        "95% ms": waits[int(0.95 * (len(waits) - 1))],
        "pictures a second": (len(shown) - 1) / seconds,
        "CPU ms a picture": 1000.0 * core / len(shown),
        "frames a second": (shown[-1][2] - shown[0][2]) / seconds,
    }


def measured(browser: Browser) -> list[Row]:
    """Perform the ball at full and at half speed."""
    text = SHOTS["ball"].replace("frames: 1-24", "frames: 1-120")
    with tempfile.TemporaryDirectory() as folder, live_page(browser, Path(folder), text) as follower:
        tab = follower.tab
        tab.click(f'[data-path="{CENTRE}"] button >> nth=1')
        tab.evaluate(WATCH)
        follower.wait("page.perform.state.armed.length === 1")
        performed(follower, 1)  # kernels and fonts are loaded
        return [performed(follower, speed) for speed in (1, 0.5)]


def main() -> list[Target]:
    """Measure; return the targets."""
    chromium.FLAGS = tuple(flag for flag in chromium.FLAGS if "swiftshader" not in flag)  # WebGL on the CPU
    with chromium.running() as browser:
        rows = measured(browser)
    load = os.getloadavg()[0]
    show(f"From an event to its picture, 25 thousand vertices; {load:.1f} processes were running", rows)
    keep("perform", rows)
    return [
        Target("perform", f"{name}, at {row['speed']:g} of the speed", float(row[name]), most=most)
        for row in rows
        for name, most in (("median ms", MEDIAN), ("95% ms", MOST))
    ]


if __name__ == "__main__":
    show("Targets", [target.row for target in main()])
