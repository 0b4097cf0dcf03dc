"""Placement of new vertices (P34): chord, curved and exact against the exact surface."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from examples.drawing import COOL, OCHRE, WARM, page, save
from examples.figure_a import vortex_flow
from examples.film import RATE
from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.flow.flow_map import FlowMap, FrameStep
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere
from flowsculpt.pipeline.resample import Chord, Curved, Exact, Placement, Resampler, Thresholds

FRAMES, LONGEST, EVERY = 60, 0.15, 6
STEP = 1e-6
"""Finite difference for gradients, scene units."""

NAMES = ("chord", "curved", "exact")


def simulate(name: str, thresholds: Thresholds, frames: int) -> Iterator[tuple[int, TriangleMesh]]:
    """Yield the frame number and the surface of a ball of radius 1 in three vortices."""
    history, flow = FlowMap(), vortex_flow()
    placements: dict[str, Placement] = {
        "chord": Chord(),
        "curved": Curved(),
        "exact": Exact(history.carry, project=onto_ball),
    }
    resampler = Resampler(icosphere(14), thresholds, placements[name])
    for frame in range(1, frames + 1):
        history.add(FrameStep(flow, (frame - 1) / RATE, 1 / RATE, frame))
        resampler.vertices[:] = flow.displace(resampler.vertices, (frame - 1) / RATE, 1 / RATE)
        resampler.resample()
        yield frame, resampler.mesh


def film(name: str, frames: int = FRAMES, every: int = EVERY) -> Floats:
    """Return distances (N, 2) of vertices and face centres from the exact surface, in maximum edges.

    The 95th percentile every so many frames: a few vertices may have had to stay on the chord.
    """
    errors = []
    for frame, mesh in simulate(name, Thresholds(LONGEST), frames):
        if frame % every == 0:
            both = (mesh.vertices, centres(mesh))
            errors.append([np.percentile(np.abs(distances(points, frame)), 95) for points in both])
    return np.array(errors) / LONGEST


def centres(mesh: TriangleMesh) -> Points:
    """Return the middle (F, 3) of each face."""
    middles: Points = mesh.vertices[mesh.faces].mean(axis=1)
    return middles


def onto_ball(points: Points) -> Points:
    """Return the nearest points of the unit sphere."""
    nearest: Points = points / np.linalg.norm(points, axis=1, keepdims=True)
    return nearest


def distances(points: Points, frame: int) -> Floats:
    """Return distances (N,) from the exact surface, to first order: rest height over its gradient."""
    steps = STEP * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    heights = height_at_rest((points + steps[:, None]).reshape(-1, 3), frame).reshape(4, -1)
    far: Floats = heights[0] * STEP / np.linalg.norm(heights[1:] - heights[0], axis=0)
    return far


def height_at_rest(points: Points, frame: int) -> Floats:
    """Return the distance (N,) from the sphere of points moved back to the first frame."""
    back = FlowMap()
    for number in range(frame, 0, -1):
        back.add(FrameStep(vortex_flow(), number / RATE, -1 / RATE, number))
    height: Floats = np.linalg.norm(back.carry(points), axis=1) - 1.0
    return height


def draw() -> None:
    figure, panels = page(("vertices", "centres of faces"), height=3.1)
    frames = np.arange(EVERY, FRAMES + 1, EVERY)
    for name, colour in zip(NAMES, (WARM, OCHRE, COOL), strict=True):
        for panel, errors in zip(panels, film(name).T, strict=True):
            panel.plot(frames, errors, color=colour, label=name)
    for panel in panels:
        panel.set_xlabel("frame")
    panels[0].set_yscale("log")
    panels[1].set_ylim(0)
    panels[0].set_ylabel("95th percentile / maximum edge")
    panels[1].legend()
    save(figure, "placements.svg")


if __name__ == "__main__":
    draw()
