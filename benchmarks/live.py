"""`python -m benchmarks.live`: how fast the live page follows a drag.

Shots that are simulated first: a ball of 25 thousand vertices in two vortices, as clay and as glass; two
blocks of as many together; a cloud of 20 thousand points; a box whose edges stay sharp; a rod whose edges
follow its curvature; and a small ball in a long shot. In the middle of each, camera, look, a flow and the
subject are dragged in steps, as the page asks for them at its address: from the request to the answer, with
the small picture. Each drag is made TIMES times. The page prepares a drag while the pointer goes down; here
nothing is prepared.

`first` is the first picture of a drag, which prepares what the next ones need: the median and the worst by
the clock, and the median of CPU seconds of the process, which other work hardly lengthens. `next` are the
pictures after it. `full` is from release, which writes the file, to the full picture of the frame; of a flow
or a subject all frames before it are simulated first.

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
from flowsculpt.pipeline.plugins.preview.live_server import actions_of, serving
from flowsculpt.pipeline.plugins.preview.live_session import READY, LiveFeed, LiveSession, Message
from flowsculpt.pipeline.plugins.preview.shot_editor import ShotEditor
from flowsculpt.pipeline.plugins.preview.sketch import Sketch
from flowsculpt.pipeline.plugins.preview.surface_stream import SurfaceStream
from flowsculpt.pipeline.production.execution.project import Project

STEPS, TIMES = 5, 3
"""Pictures of a drag, and drags of each value."""

FIRST = 0.150
"""Seconds that the first picture of a drag of 25 thousand vertices may take, by the clock and of CPU."""

PAIR = """\
  - sum:
      - vortex: {centre: [0.9, 0.3, 0], radius: 0.8, strength: {keys: {1: 0, 8: 3, 24: 0}}}
      - vortex: {centre: [-0.9, 0.3, 0], radius: 0.8, strength: {keys: {1: 0, 8: -3, 24: 0}}}
  - twist: {axis: y, amount: {keys: {1: 0, 24: 40}}}
"""


def shot_text(entries: str, frames: int = 24) -> str:
    """Return a shot file with some entries, in the flow of PAIR."""
    return f"title: Drags\nframes: 1-{frames}\n{entries}flows:\n{PAIR}"


BALL = "subject: {solid: icosphere, radius: 1.0}\nresample: {max_edge_length: 0.036}\n"

SHOTS = {
    "ball": shot_text(BALL),
    "glass": shot_text(f"{BALL}look: glass\nstage: {{kind: plinth}}\n"),
    "blocks": shot_text(
        "subjects:\n  left: {solid: box, size: [0.9, 1.6, 1.4], place: [-0.6, 0, 0], look: glaze}\n"
        "  right: {solid: box, size: [0.9, 1.6, 1.4], place: [0.6, 0, 0]}\n"
        "resample: {max_edge_length: 0.047}\n"
    ),
    "cloud": shot_text("subject: {cloud: {solid: icosphere, radius: 1.0}, count: 20000, radius: 0.011}\n"),
    "box": shot_text("subject: {solid: box, size: [2, 2, 2]}\nresample: {max_edge_length: 0.075}\n"),
    "rod": shot_text(
        "subject: {solid: rod, length: 3.2, radius: 0.55}\n"
        "resample: {max_edge_length: {curvature: {tolerance: 0.002, finest: 0.02, coarsest: 0.09}}}\n"
    ),
    "long": shot_text(
        "subject: {solid: icosphere, radius: 1.0}\nresample: {max_edge_length: 0.15}\n", frames=240
    ),
}

MIDDLE = 150
"""The last frame that is dragged."""

LARGE = ("ball", "glass", "blocks", "cloud")
"""Shots that FIRST is for."""

Where = tuple[str | int, ...]

LOOKS = ("clay", "glaze", "chrome", "putty", "ceramic")
"""Looks of a drag. Each drag ends with another one: a release that changes nothing shows nothing new."""

RADIUS: Where = ("flows", 0, "sum", 0, "vortex", "radius")

SIZES: dict[str, Where] = {
    "blocks": ("subjects", "left", "size"),
    "cloud": ("subject", "cloud", "radius"),
    "box": ("subject", "size"),
}
"""Paths of what is dragged of a subject; of the others the radius."""


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
    """Drag the camera, the look, a flow and the subject of a shot."""
    with tempfile.TemporaryDirectory() as folder, opened(shot, Path(folder)) as (page, session):
        state = page.ask("state")
        frame = min((state["first"] + state["last"]) // 2, MIDDLE)
        drawn = session.drawn(frame)
        assert drawn is not None
        parts = drawn.sketch.request.parts
        vertices = sum(len(session.arrays(part, frame)["vertices"]) for part in parts)
        size = SIZES.get(shot, ("subject", "radius"))
        is_vector = size[-1] == "size"
        steps = [round(0.55 + 0.01 * i, 3) for i in range(STEPS * TIMES)]
        drags: dict[str, tuple[Where, list[Any]]] = {
            "camera": (("camera", "elevation"), [5 + i for i in range(STEPS * TIMES)]),
            "flow": (RADIUS, [round(0.8 + 0.01 * (i + 1), 3) for i in range(STEPS * TIMES)]),
            "subject": (size, [[step, 1.6, 1.4] if is_vector else step for step in steps]),
            "look": (
                ("look",),
                [LOOKS[(drag + step) % STEPS] for drag in range(TIMES) for step in range(STEPS)],
            ),
        }
        return [
            {"shot": shot, "vertices": vertices, "frame": frame, "drag": name}
            | dragged(page, frame, where, values)
            for name, (where, values) in drags.items()
        ]


def dragged(page: Page, frame: int, where: Where, values: list[Any]) -> Row:
    """Drag a value through others, TIMES times, and release it each time."""
    firsts, nexts, fulls = [], [], []
    for drag in range(TIMES):
        digest, times = page.ask("state")["digest"], []
        for value in values[drag * STEPS : (drag + 1) * STEPS]:
            edits = [{"kind": "set", "where": list(where), "value": value}]
            wall, core = time.perf_counter(), time.process_time()
            page.ask("follow", digest=digest, edits=edits, frame=frame)
            times.append((time.perf_counter() - wall, time.process_time() - core))
        firsts.append(times[0])
        nexts += times[1:]
        released = time.perf_counter()
        page.ask("edit", digest=digest, edits=edits, frame=frame)
        page.wait(event="begin")
        page.wait(event="frame", frame=frame)
        fulls.append(time.perf_counter() - released)
        page.wait(words=READY)
    return {
        "first s": statistics.median(wall for wall, _ in firsts),
        "worst first s": max(wall for wall, _ in firsts),
        "first CPU s": statistics.median(core for _, core in firsts),
        "next s": statistics.median(wall for wall, _ in nexts),
        "next CPU s": statistics.median(core for _, core in nexts),
        "full s": statistics.median(fulls),
    }


def main() -> list[Target]:
    """Measure all shots; return the targets, which are for the large ones."""
    rows = []
    for shot in sys.argv[1:] or SHOTS:
        rows += (found := measured(shot))
        show(f"Drags of the shot {shot} on the live page", found)
    keep("live", rows)
    return [
        Target("live", f"first picture, {row['shot']}, {row['drag']}, {what}", float(row[what]), most=FIRST)
        for row in rows
        if row["shot"] in LARGE
        for what in ("first CPU s", "first s")
    ]


if __name__ == "__main__":
    show("Targets", [target.row for target in main()])
