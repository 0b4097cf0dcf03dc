"""`python -m benchmarks.live`: how fast the live page follows a drag.

Four shots of 24 frames, simulated first: a ball of 25 thousand vertices in two vortices, a box whose edges
stay sharp, a rod whose edges follow its curvature, and a cloud of points. In the middle of each, camera, look
and a flow are dragged in steps, as the page asks for them at its address: from the request to the answer,
with the small picture. The first picture of a drag prepares what the next ones need. `full` is from release,
which writes the file, to the full picture of the frame; of a flow all frames before it are simulated first.
Seconds by the clock, medians, and CPU seconds of the process, which other work hardly lengthens; targets are
in CPU seconds.

    python -m benchmarks.live ball      one of the shots
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from benchmarks.report import Row, Target, keep, show
from pipeline.dailies.preview.live_feed import LiveFeed, Message
from pipeline.dailies.preview.live_server import serving
from pipeline.dailies.preview.live_session import READY, LiveSession
from pipeline.dailies.preview.shot_editor import ShotEditor
from pipeline.dailies.preview.sketch import Sketch
from pipeline.dailies.preview.staging import actions_of
from pipeline.dailies.preview.surface_stream import SurfaceStream
from pipeline.production.execution.project import Project

STEPS = 12
"""Pictures of a drag."""

FIRST = 0.150
"""CPU seconds to the first picture of a drag that are allowed for 25 thousand vertices."""

PAIR = """\
frames: 1-24
flows:
  - sum:
      - vortex: {centre: [0.9, 0.3, 0], radius: 0.8, strength: {keys: {1: 0, 8: 3, 24: 0}}}
      - vortex: {centre: [-0.9, 0.3, 0], radius: 0.8, strength: {keys: {1: 0, 8: -3, 24: 0}}}
  - twist: {axis: y, amount: {keys: {1: 0, 24: 40}}}
"""

SHOTS = {
    "ball": f"title: Ball\nsubject: {{solid: icosphere}}\nresample: {{max_edge_length: 0.036}}\n{PAIR}",
    "box": "title: Box\nsubject: {solid: box, size: [2, 2, 2]}\n"
    f"resample: {{max_edge_length: 0.075}}\n{PAIR}",
    "rod": "title: Rod\nsubject: {solid: rod, length: 3.2, radius: 0.55}\n"
    "resample: {max_edge_length: {curvature: {tolerance: 0.002, finest: 0.02, coarsest: 0.09}}}\n" + PAIR,
    "cloud": "title: Cloud\nsubject: {cloud: {solid: icosphere}, count: 20000, radius: 0.011}\n" + PAIR,
}

RADIUS = ("flows", 0, "sum", 0, "vortex", "radius")


class Page:
    """The requests of one page."""

    def __init__(self, address: str, messages: SimpleQueue[Message]) -> None:
        self._address, self._messages = address, messages

    def ask(self, name: str, **asked: Any) -> dict[str, Any]:
        headers = {"Origin": self._address.rsplit("/", 2)[0], "Content-Type": "application/json"}
        request = urllib.request.Request(self._address + name, json.dumps(asked).encode(), headers)
        with urllib.request.urlopen(request) as answer:
            found: dict[str, Any] = json.load(answer)
        return found

    def wait(self, **wanted: Any) -> None:
        """Wait for a message."""
        while True:
            message = self._messages.get()
            if all(message.get(key) == value for key, value in wanted.items()):
                return


@contextmanager
def opened(name: str, folder: Path) -> Iterator[tuple[Page, LiveSession]]:
    """Yield the page of a shot that is simulated and drawn."""
    shot = folder / "shots" / f"{name}.yaml"
    shot.parent.mkdir()
    shot.write_text(SHOTS[name])
    feed = LiveFeed()

    def read() -> Sketch:
        return Sketch(Project(folder, 2).request(shot, "draft", None, variant="none"))

    with SurfaceStream(Project(folder, 2).store) as stream:
        session = LiveSession(read, feed, stream, lambda ready: None, {shot})
        with serving(feed, 0, actions_of(ShotEditor(shot), session)) as address:
            page = Page(address, feed.subscribe())
            threading.Thread(target=session.follow, daemon=True).start()
            page.wait(words=READY)
            yield page, session


def measured(shot: str) -> list[Row]:
    """Drag the camera, the look and a flow of a shot."""
    with tempfile.TemporaryDirectory() as folder, opened(shot, Path(folder)) as (page, session):
        state = page.ask("state")
        frame = (state["first"] + state["last"]) // 2
        drawn = session.drawn(frame)
        assert drawn is not None
        vertices = len(session.arrays(drawn, frame)["vertices"])
        drags: dict[str, tuple[tuple[str | int, ...], list[Any]]] = {
            "camera": (("camera", "elevation"), [10 + i for i in range(STEPS)]),
            "look": (("look",), ["clay", "glaze", "chrome", "putty"] * (STEPS // 4)),
            "flow": (RADIUS, [round(0.8 + 0.02 * (i + 1), 3) for i in range(STEPS)]),
        }
        return [
            {"shot": shot, "vertices": vertices, "frame": frame, "drag": name}
            | dragged(page, frame, where, values)
            for name, (where, values) in drags.items()
        ]


def dragged(page: Page, frame: int, where: tuple[str | int, ...], values: list[Any]) -> Row:
    """Drag a value through others and release it."""
    digest, walls, cores = page.ask("state")["digest"], [], []
    for value in values:
        edits = [{"kind": "set", "where": list(where), "value": value}]
        wall, core = time.perf_counter(), time.process_time()
        page.ask("follow", digest=digest, edits=edits, frame=frame)
        walls.append(time.perf_counter() - wall)
        cores.append(time.process_time() - core)
    released = time.perf_counter()
    page.ask("edit", digest=digest, edits=edits, frame=frame)
    page.wait(event="begin")
    page.wait(event="frame", frame=frame)
    full = time.perf_counter() - released
    page.wait(words=READY)
    return {
        "first s": walls[0],
        "first CPU s": cores[0],
        "next s": statistics.median(walls[1:]),
        "next CPU s": statistics.median(cores[1:]),
        "full s": full,
    }


def main() -> list[Target]:
    """Measure all shots; return the targets, which are for the ball."""
    rows = [row for shot in sys.argv[1:] or SHOTS for row in measured(shot)]
    keep("live", rows)
    show("Drags on the live page", rows)
    return [
        Target("live", f"first picture, {row['drag']}, CPU s", float(row["first CPU s"]), most=FIRST)
        for row in rows
        if row["shot"] == "ball"
    ]


if __name__ == "__main__":
    show("Targets", [target.row for target in main()])
