"""The battery: kinds of mesh × flows × placements × scales, each held to every promise for sixty frames.

A case is its name: mesh, flow, placement, scale. Its other settings are drawn from a seed made of the name,
so `Case("spikes", "waves", "chord", 1.0).run(60)` repeats a failing one.
"""

from __future__ import annotations

import re
import zlib
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.errors import VertexBudgetError
from flowsculpt.pipeline.mesh import TriangleMesh, validate
from flowsculpt.pipeline.mesh.halfedge_mesh import with_identities
from flowsculpt.pipeline.resample import Chord, Curved, Exact, Placement, Resampler, Thresholds
from tests.resample.battery import FLOWS, MESHES

PLACEMENTS = ("chord", "curved", "exact")
SCALES = (1e-6, 1e-3, 1.0, 1e6)
FRAMES, RESUMED = 60, 3  # frames of a case; frames for which a resumed resampler runs beside the first
_ROOM = 40_000  # vertices
_COUNTED = re.compile(r"(\d+) vertices and (\d+) edges? to split exceed the budget of (\d+) vertices")


@dataclass
class Case:
    """One run of the battery.

    moves   the flow of each frame so far, which exact placement carries points through
    """

    mesh: str
    flow: str
    placement: str
    scale: float

    def __post_init__(self) -> None:
        self.name = f"{self.mesh}-{self.flow}-{self.placement}-{self.scale:g}"
        self.rng = np.random.default_rng(zlib.crc32(self.name.encode()))
        self.moved = 0
        edge = self.scale * float(self.rng.uniform(0.15, 0.4))
        start = len(MESHES[self.mesh]().vertices)
        self.budget = int(self.rng.choice([_ROOM, start + self.rng.integers(20, 2500)]))
        self.edge, self.shortest = edge, edge * float(self.rng.choice([0.4, self.rng.uniform(0, 0.49)]))
        self.hard_angle = float(self.rng.choice([0.7, self.rng.uniform(0.2, 3.1)]))
        self.min_roundness = float(self.rng.choice([0.0, 0.6, 0.85]))
        self.splits: Literal["edges", "faces"] = (
            "faces" if self.placement == "chord" and self.rng.random() < 0.2 else "edges"
        )

    def move(self, points: Points, frame: int) -> Points:
        return FLOWS[self.flow](points / self.scale, frame) * self.scale

    def carry(self, points: Points) -> Points:
        for frame in range(self.moved):
            points = self.move(points, frame)
        return points

    def placed(self) -> Placement:
        return {"chord": Chord(), "curved": Curved(), "exact": Exact(self.carry)}[self.placement]

    def thresholds(self, budget: int) -> Thresholds:
        return Thresholds(self.edge, self.shortest, self.hard_angle, max_vertices=budget)

    def run(self, frames: int) -> int:
        """Run the case; return how many times the budget stopped it."""
        rest = MESHES[self.mesh]()
        rest = with_identities(rest.with_vertices(rest.vertices * self.scale))
        euler, stops = validate(rest).require().euler, 0
        settings = (self.placed(), self.min_roundness, self.splits)
        resampler = Resampler(rest, self.thresholds(self.budget), *settings)
        saved_at, copy = int(self.rng.integers(frames - RESUMED)), None
        for frame in range(frames):
            for surface in (resampler, copy):
                if surface is not None:
                    surface.vertices[:] = self.move(surface.vertices, frame)
            self.moved += 1
            if not self._resample(resampler, frame):
                stops += 1
                if self.budget == _ROOM:
                    return stops  # the flow makes more than fits
                self.budget, copy = _ROOM, None
                resampler.thresholds = self.thresholds(self.budget)
                continue
            self._holds(resampler.mesh, euler, frame)
            if copy is not None:
                assert self._resample(copy, frame)
                assert _digest(copy) == _digest(resampler), f"{self.name}: frame {frame} differs when resumed"
            if frame == saved_at:
                copy = Resampler.from_state(resampler.state(), resampler.thresholds, *settings)
            elif frame == saved_at + RESUMED:
                copy = None
        return stops

    def _resample(self, resampler: Resampler, frame: int) -> bool:
        """Resample once; return False where the budget stopped it, which must be true and leave no hole."""
        try:
            report = resampler.resample()
        except VertexBudgetError as error:
            found = validate(resampler.mesh).require(name=f"{self.name}, stopped at frame {frame}")
            counted = _COUNTED.search(str(error))
            if counted:
                now, more, budget = map(int, counted.groups())
                # Faces are cut in rounds on a copy, and a stop keeps the surface as it was.
                assert now == found.vertices or self.splits == "faces", f"{self.name}, frame {frame}: {error}"
                assert now + more > budget == self.budget, f"{self.name}, frame {frame}: {error}"
            assert len(resampler.mesh.attributes["identity"]) == found.vertices <= self.budget
            return False
        where = f"{self.name}, frame {frame}"
        assert report.too_long == 0, where
        assert report.longest <= self.edge, where
        assert report.vertices <= max(self.budget, len(MESHES[self.mesh]().vertices)), where
        assert report.too_short == sum(report.refused.values()), where
        return True

    def _holds(self, mesh: TriangleMesh, euler: int, frame: int) -> None:
        found = validate(mesh).require(name=f"{self.name}, frame {frame}")
        assert found.euler == euler, f"{self.name}, frame {frame}"
        assert len(np.unique(mesh.attributes["identity"])) == found.vertices


def _digest(resampler: Resampler) -> dict[str, bytes]:
    return {name: values.tobytes() for name, values in resampler.state().items()}


DIAGONAL = [
    (mesh, flow, PLACEMENTS[i % 3], SCALES[i % 4])
    for i, (mesh, flow) in enumerate(zip(MESHES, [*FLOWS, *FLOWS], strict=False))
]


@pytest.mark.parametrize(("mesh", "flow", "placement", "scale"), DIAGONAL)
def test_each_kind_of_mesh_keeps_its_promises(mesh: str, flow: str, placement: str, scale: float) -> None:
    Case(mesh, flow, placement, scale).run(12)


def test_the_budget_counts_no_collapsed_vertices_and_a_stop_leaves_no_hole() -> None:
    """A stop while vertices make room for others, with collapsed ones still in the arrays."""
    assert Case("spikes", "waves", "chord", 1.0).run(30) == 1


@pytest.mark.soak
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("mesh", "placement"), list(product(MESHES, PLACEMENTS)))
def test_the_whole_battery_keeps_its_promises(mesh: str, placement: str, scale: float) -> None:
    for flow in FLOWS:
        Case(mesh, flow, placement, scale).run(FRAMES)
