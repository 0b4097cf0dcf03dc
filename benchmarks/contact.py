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
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.plugins.contact.contact_flow import OnFloor, Squashing
from flowsculpt.pipeline.plugins.contact.earlier_motion import EarlierMotion, Extent
from flowsculpt.pipeline.shot import read_shot

DOWN = "translation: {rate: {ease: linear, keys: {1: [0, 0, 0], 3: [0, -0.5, 0], 48: [0, -0.5, 0]}}}"

BALL = "{solid: icosphere, radius: 1}"

SHOTS = {
    "ball": (BALL, DOWN),
    "ball, twisted": (BALL, f"twist: {{amount: {{keys: {{1: 0, 48: 120}}}}}}\n  - {DOWN}"),
    "box in a vortex": ("{solid: box, size: [1.6, 2, 1.6]}", f"vortex: {{strength: 2}}\n  - {DOWN}"),
}

CONTACT = "\n  - contact: {floor: -1, softness: 1}"

RUNS = 3


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
    """Undo each squash and do it again: the meshes stay, and what that adds is what contact takes."""
    steps = OnFloor.steps

    def again(floor: OnFloor, time: float, dt: float) -> Iterator[FlowStep]:
        yield from steps(floor, time, dt)
        yield from Squashing(floor, undoes=True).steps(time + dt, 0.0)
        yield from Squashing(floor, undoes=False).steps(time, dt)

    with patch.object(OnFloor, "steps", again):
        yield


@contextmanager
def timed(spent: list[float]) -> Iterator[None]:
    """Add up the CPU seconds of following the subject's points without a floor."""
    extent = EarlierMotion.extent

    def counted(motion: EarlierMotion, time: float) -> Extent:
        begun = process_time()
        found = extent(motion, time)
        spent[0] += process_time() - begun
        return found

    with patch.object(EarlierMotion, "extent", counted):
        yield


def measure(folder: Path, subject: str, flows: str, length: float) -> Measured:
    """Simulate a shot of 48 frames; `contact` is what following the points takes."""
    path = folder / "A010_contact.yaml"
    text = f"title: Contact\nframes: 1-48\nsubject: {subject}\nresample: {{max_edge_length: {length}}}\n"
    path.write_text(f"{text}flows:\n  - {flows}{CONTACT}\n", encoding="utf-8")
    shot, meshes, lowest, spent = read_shot(path), [], np.inf, [0.0]
    begun = process_time()
    with timed(spent):
        for frame in animate(shot):
            lowest = min(lowest, float(frame.mesh.vertices[:, 1].min()))
            meshes = [*meshes[:1], frame.mesh]
    seconds, (first, last) = process_time() - begun, meshes
    height, change = float(np.ptp(last.vertices[:, 1])), volume(last) / volume(first) - 1.0
    return Measured(seconds, spent[0], len(last.vertices), lowest, change, height)


def main() -> None:
    """Print the table of docs/benchmarks.md: the run with the least CPU time of each shot."""
    length = float(sys.argv[1]) if len(sys.argv) > 1 else 0.04
    print("| | vertices | height | CPU s | of that, contact | lowest, % of 2 | volume, % |")
    print("|---|---|---|---|---|---|---|")
    with TemporaryDirectory() as folder:
        for name, (subject, flows) in SHOTS.items():
            best = min(measure(Path(folder), subject, flows, length) for _ in range(RUNS))
            with repeated():
                twice = min(measure(Path(folder), subject, flows, length).seconds for _ in range(RUNS))
            contact = best.contact + max(0.0, twice - best.seconds)
            print(
                f"| {name} | {best.vertices} | {best.height:.2f} | {best.seconds:.2f} | {contact:.2f} | "
                f"{50 * (best.lowest + 1):.3f} | {100 * best.change:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
