"""A small studio whose pictures tell their frames: made here, in the place of a renderer's.

Each picture is 480 × 270 pixels. Its upper half is the frame's number in eight squares, white for ones; its
lower half tells which sequence it is of.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.store.event_log import EventLog
from flowsculpt.pipeline.production.store.paths import EVENTS
from flowsculpt.render.post.image import write_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from tests.conftest import done
from tests.needed_plugins import missing
from tests.simulated_show import NAME, TITLE, Desk, simulated, surfaces

MISSING, FAILED = 17, 9

FAULT = f"a lamp fell over {TITLE}"
"""A message that attacks the page."""

WIDTH, HEIGHT, BITS = 480, 270, 8
BLOCK = WIDTH // BITS
Picture = NDArray[np.float32]

BRIGHT = 60.0
"""Linear light that the view shows as white."""


def furnish(root: Path) -> Desk:
    """Simulate the shot, and lay numbered pictures where renders would lie: of two qualities and a wedge.

    There is no wedge where the plug-in that makes them is not installed.
    """
    desk = simulated(root)
    request = desk.request("draft")
    there = [number for number in request.angles if number not in (MISSING, FAILED)]
    hang(desk, request, there, dark)
    hang(desk, desk.request("daily.scale50"), request.angles, bright)
    log = EventLog(root / EVENTS / "20260101-000000-1.jsonl", "render_0000")
    log.write("fail", stage="render", shot=NAME, quality="draft", frame=FAILED, message=FAULT)
    if not missing("sheets"):
        _hang_wedge(desk)
    return desk


def _hang_wedge(desk: Desk) -> None:
    from flowsculpt.pipeline.plugins.sheets.wedge import Grid, Wedge

    project, root = desk.project(), desk.root
    wedge = Wedge(
        project,
        root / "shots" / f"{NAME}.yaml",
        Grid.parse(["look=chrome,glaze"]),
        "draft",
        FrameRange.parse("1-4"),
    )
    done(root, surfaces(project, wedge.requests[0][1]))
    for (_, cell), paint in zip(wedge.requests, (dusky, bright), strict=True):
        hang(desk, cell, cell.requested, paint)
    wedge.draw()


def hang(desk: Desk, request: RenderRequest, numbers: Iterable[int], paint: Callable[[int], Picture]) -> None:
    """Lay the pictures of a take where renders would lie."""
    store = desk.project().store
    keys = request.keys.pictures(store)
    assert keys is not None
    for number in numbers:
        key, pixels = keys[number].frame, paint(number)
        header = {"key": key, "seed": request.seed(number), "samples": 4, "quality": request.quality_name}
        store.put(
            "frame", key, lambda p, x=pixels, h=header: write_exr(p, RenderedFrame({"beauty": x}, {}), h)
        )
        store.link("frame", key, request.place("frame", number))


def dark(number: int) -> Picture:
    return numbered(number, 0.0)


def dusky(number: int) -> Picture:
    return numbered(number, 0.05)


def bright(number: int) -> Picture:
    return numbered(number, BRIGHT)


def numbered(number: int, light: float) -> Picture:
    """(270, 480, 3): the number in squares above, light below."""
    picture = np.full((HEIGHT, WIDTH, 3), light, np.float32)
    picture[: HEIGHT // 2] = 0.0
    for bit in range(BITS):
        if number >> bit & 1:
            picture[: HEIGHT // 2, bit * BLOCK : (bit + 1) * BLOCK] = BRIGHT
    return picture


def number_in(shown: NDArray[np.uint8]) -> int:
    """The number of a picture as it is shown, at any size."""
    height, width = shown.shape[:2]
    row = shown[round(0.25 * height), :, :3].mean(axis=1)
    return sum(1 << bit for bit in range(BITS) if row[int((bit + 0.5) / BITS * width)] > 128)
