"""Contact: its share of the CPU time of simulating, and how well it keeps the floor and the volume.

python -m benchmarks.contact
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import NamedTuple
from unittest.mock import patch

import numpy as np

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.flow.flow import FlowStep
from flowsculpt.pipeline.flow.flow_map import FlowMap, FrameStep
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.plugins.contact.contact_flow import InContact, Meeting, Squashing
from flowsculpt.pipeline.shot import read_shot

DOWN = "{translation: {rate: {ease: linear, keys: {1: [0, 0, 0], 3: [0, -0.5, 0], 48: [0, -0.5, 0]}}}}"

FLOOR = "{contact: {floor: -1, softness: 1}}"

OTHER = "{contact: {others: [other], softness: 1}}"

BALL = "solid: icosphere, radius: 1"

BLOCK = "solid: box, size: [4, 1, 4], place: [0, -1.5, 0]"

TWIST = "{twist: {amount: {keys: {1: 0, 48: 120}}}}"

LANDING = """{move: {
  by: {keys: {1: [0, 0, 0], 8: [0, -0.3, 0], 20: {value: [0, 1.1, 0], ease: drop 0},
    29: {value: [0, -0.55, 0], ease: settle 0.25}, 54: [0, 0, 0]}},
  turn: {ease: drag, keys: {8: 0, 30: {value: 90, ease: settle 0.3}, 54: 90}},
  lag: 0.1, leads: [0, -1, 0]}}"""

SHOTS = {
    "landing": (
        f"solid: box, size: [1.3, 1.8, 1.3], place: [0, -0.1, 0], flows: [{LANDING}, {FLOOR}]",
        BLOCK,
    ),
    "ball in a vortex, on a block": (f"{BALL}, flows: [{{vortex: {{strength: 2}}}}, {DOWN}, {OTHER}]", BLOCK),
    "ball in a vortex, on a ball": (
        f"{BALL}, flows: [{{vortex: {{strength: 2}}}}, {DOWN}, {OTHER}]",
        "solid: icosphere, radius: 3, place: [0, -4, 0]",
    ),
    "ball": (f"{BALL}, flows: [{DOWN}, {FLOOR}]", BLOCK),
    "ball, twisted": (f"{BALL}, flows: [{TWIST}, {DOWN}, {FLOOR}]", BLOCK),
    "box in a vortex": (
        f"solid: box, size: [1.6, 2, 1.6], flows: [{{vortex: {{strength: 2}}}}, {DOWN}, {FLOOR}]",
        BLOCK,
    ),
    "ball on a block": (f"{BALL}, flows: [{DOWN}, {OTHER}]", BLOCK),
    "ball on a block that turns": (
        f"{BALL}, flows: [{DOWN}, {OTHER}]",
        f"{BLOCK}, flows: [{{rotation: {{axis: y, speed: 45}}}}]",
    ),
}
"""The subject that is pressed, and the other one.

Typical are those that other flows move as shots do: `landing`, whose flows are those of B220_landing, and
those in a vortex. In the others the flows do almost nothing, so that contact's share is the largest there is.
"""

RUNS = 7

TIMES = 4
"""Squashes that are undone and done again: more than one, as one adds less than runs differ by."""


class Measured(NamedTuple):
    """CPU seconds, those of contact, and the last frame's vertices, change of volume and height.

    lowest  height of the lowest point over all frames, units; the floor is at -1
    """

    seconds: float
    contact: float
    vertices: int
    lowest: float
    change: float
    height: float


def volume(mesh: TriangleMesh) -> float:
    """Return the volume that a closed mesh encloses, units³."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", np.cross(a, b), c).sum() / 6.0)


@contextmanager
def repeated() -> Iterator[None]:
    """Undo each squash and do it again TIMES: the meshes stay, and what one adds is what contact takes.

    New vertices do not: they go through the last squash alone, as later steps undo the earlier ones.
    """
    steps, add = InContact.steps, FlowMap.add

    def again(whole: InContact, time: float, dt: float) -> Iterator[FlowStep]:
        yield from steps(whole, time, dt)
        for _ in range(TIMES):
            yield from Squashing(whole, 0, is_inverse=True).steps(time + dt, 0.0)
            yield from Squashing(whole, 0, is_inverse=False).steps(time, dt)

    def add_once(history: FlowMap, step: FrameStep) -> None:
        with patch.object(InContact, "steps", steps):
            add(history, step)

    with patch.object(InContact, "steps", again), patch.object(FlowMap, "add", add_once):
        yield


@contextmanager
def timed(spent: list[float]) -> Iterator[None]:
    """Add up the CPU seconds of following the subject's points, and the others, if nothing gave way."""
    meet = InContact._meet

    def counted(whole: InContact, time: float) -> Iterator[Meeting]:
        begun = process_time()
        yield from list(meet(whole, time))
        spent[0] += process_time() - begun

    with patch.object(InContact, "_meet", counted):
        yield


def measure(folder: Path, subjects: tuple[str, str], length: float) -> Measured:
    """Simulate a shot of 48 frames; `contact` is what following the points takes."""
    path, (pressed, other) = folder / "A010_contact.yaml", subjects
    head = f"title: Contact\nframes: 1-48\nresample: {{max_edge_length: {length}}}"
    text = f"{head}\nsubjects:\n  pressed: {{{pressed}}}\n  other: {{{other}}}\n"
    path.write_text(text, encoding="utf-8")
    meshes, lowest, spent = [], np.inf, [0.0]
    part = read_shot(path).of_subject("pressed")
    begun = process_time()
    with timed(spent):
        for frame in animate(part):
            lowest = min(lowest, float(frame.mesh.vertices[:, 1].min()))
            meshes = [*meshes[:1], frame.mesh]
    seconds, (first, last) = process_time() - begun, meshes
    height, change = float(np.ptp(last.vertices[:, 1])), volume(last) / volume(first) - 1.0
    return Measured(seconds, spent[0], len(last.vertices), lowest, change, height)


def main() -> None:
    """Print the table of docs/benchmarks.md: the run with the least CPU time of each shot."""
    length = float(sys.argv[1]) if len(sys.argv) > 1 else 0.04
    print("| | vertices | height | CPU s | of that, contact | % | lowest, % of 2 | volume, % |")
    print("|---|---|---|---|---|---|---|---|")
    with TemporaryDirectory() as folder:
        for name, shot in SHOTS.items():
            best = min(measure(Path(folder), shot, length) for _ in range(RUNS))
            with repeated():
                more = min(measure(Path(folder), shot, length).seconds for _ in range(RUNS))
            contact = best.contact + max(0.0, more - best.seconds) / TIMES
            print(
                f"| {name} | {best.vertices} | {best.height:.2f} | {best.seconds:.2f} | {contact:.2f} | "
                f"{100 * contact / best.seconds:.0f} | "
                f"{50 * (best.lowest + 1):.3f} | {100 * best.change:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
