"""A small studio whose pictures tell their frames: made here, in the place of a renderer's.

Each picture is 480 × 270 pixels. Its upper half is the frame's number in eight squares, white for ones; its
lower half tells which sequence it is of.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.plugins.sheets.wedge import Grid, Wedge
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.store.event_log import EventLog
from flowsculpt.pipeline.production.store.paths import EVENTS
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.pipeline.production.tasks.worker import task_of
from flowsculpt.render.post.image import write_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from tests.conftest import commanded

NAME = "T010_tiny"
LAST, MISSING, FAILED = 24, 17, 9
TITLE = "A box </script><script>window.attacked = 1</script><img src=x onerror='window.attacked = 1'>"
FAULT = f"a lamp fell over {TITLE}"
"""A title and a message that attack the page."""

SHOT = f"""\
title: "{TITLE}"
frames: 1-{LAST}
subject: {{solid: box, size: [2, 2, 2]}}
resample: {{max_edge_length: 0.5}}
flows:
  - twist: {{axis: y, amount: {{ease: linear, keys: {{1: 0, 16: 36, {LAST}: 60}}}}}}
quality: {{daily: {{temporal_denoise: 0}}}}
"""

WIDTH, HEIGHT, BITS = 480, 270, 8
BLOCK = WIDTH // BITS
Picture = NDArray[np.float32]

BRIGHT = 60.0
"""Linear light that the view shows as white."""


@dataclass(frozen=True)
class Desk:
    root: Path

    def project(self) -> Project:
        return Project(self.root, 2)

    def request(self, quality: str) -> RenderRequest:
        return self.project().request(self.root / "shots" / f"{NAME}.yaml", quality)

    def command(self, *words: str) -> tuple[int, str]:
        return commanded(self.root, *words)

    def page(self, name: str = NAME) -> Path:
        return self.root / "renders" / "review" / name / "index.html"


def surfaces(project: Project, request: RenderRequest) -> Plan:
    """Plan what pictures are made from: meshes, normals and cameras."""
    planner = project.planner()
    planner.surfaces(request)
    return planner.plan()


def simulated(root: Path, shot: str = SHOT) -> Desk:
    """A studio with a shot, its meshes and its cameras."""
    (root / "shots").mkdir(parents=True, exist_ok=True)
    (root / "shots" / f"{NAME}.yaml").write_text(shot)
    desk = Desk(root)
    _done(root, surfaces(desk.project(), desk.request("draft")))
    return desk


def furnish(root: Path) -> Desk:
    """Simulate the shot, and lay numbered pictures where renders would lie: of two qualities and a wedge."""
    desk = simulated(root)
    project, request = desk.project(), desk.request("draft")
    there = [number for number in request.angles if number not in (MISSING, FAILED)]
    hang(desk, request, there, dark)
    hang(desk, desk.request("daily.scale50"), request.angles, bright)
    log = EventLog(root / EVENTS / "20260101-000000-1.jsonl", "render_0000")
    log.write("fail", stage="render", shot=NAME, quality="draft", frame=FAILED, message=FAULT)
    wedge = Wedge(
        project,
        root / "shots" / f"{NAME}.yaml",
        Grid.parse(["look=chrome,glaze"]),
        "draft",
        FrameRange.parse("1-4"),
    )
    _done(root, surfaces(project, wedge.requests[0][1]))
    for (_, cell), paint in zip(wedge.requests, (dusky, bright), strict=True):
        hang(desk, cell, cell.requested, paint)
    wedge.draw()
    return desk


def _done(root: Path, plan: Plan) -> None:
    for job in plan.jobs:
        assert task_of(job.stage)(Context.of(root, plan, job.name))


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
