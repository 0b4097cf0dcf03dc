"""A film of `benchmarks.works`, resampled frame after frame; only the resampling is timed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.works import Film
from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere
from flowsculpt.pipeline.mesh.normals import NORMAL, carried_normals
from flowsculpt.pipeline.resample import Chord, Curved, Exact, Placement, Report, Resampler, Thresholds
from flowsculpt.pipeline.resample.thresholds import DEFAULT_ROUNDNESS

PLACEMENTS = ("chord", "curved", "exact")


@dataclass(frozen=True)
class Moment:
    """One frame: the surface moved but not resampled, and a function that resamples it.

    seconds, carrying  CPU seconds of all frames so far; carrying is not part of the seconds
    """

    number: int
    before: TriangleMesh | None
    after: Callable[[], TriangleMesh]
    report: Report
    seconds: float
    carrying: float


def play(
    film: Film,
    placement: str,
    thresholds: Thresholds | None = None,
    min_roundness: float = DEFAULT_ROUNDNESS,
    looks: Callable[[int], bool] = lambda number: False,
) -> Iterator[Moment]:
    """Yield every frame of a film; `looks` tells for which frames the surface before resampling is needed.

    If the subject has vertex normals, the flow moves normals too.
    """
    carrier = _Carrier(film)
    how: dict[str, Placement] = {
        "chord": Chord(),
        "curved": Curved(),
        "exact": Exact(carrier.carry, film.project),
    }
    chosen = thresholds if thresholds is not None else Thresholds(film.max_edge_length)
    resampler = Resampler(film.subject, chosen, how[placement], min_roundness)
    seconds = 0.0
    for number in range(1, film.frames + 1):
        _move(film, resampler, number)
        before, carrier.frame, carried = resampler.mesh if looks(number) else None, number, carrier.seconds
        start = time.process_time()
        report = resampler.resample()
        seconds += time.process_time() - start - (carrier.seconds - carried)
        yield Moment(number, before, lambda: resampler.mesh, report, seconds, carrier.seconds)


def _move(film: Film, resampler: Resampler, number: int) -> None:
    """Move the mesh into a frame: its vertices, and their normals if it has any."""

    def step(points: Points) -> Points:
        return film.follow(points, number - 1, number)

    points, normals = resampler.vertices.copy(), resampler.vectors(NORMAL)
    resampler.vertices[:] = step(points)
    if normals is not None:
        normals[:] = carried_normals(step, points, resampler.vertices, normals)


class _Carrier:
    """Carries points from rest to the present frame, and counts the CPU seconds of that."""

    def __init__(self, film: Film) -> None:
        self._film, self.frame, self.seconds = film, 0, 0.0

    def carry(self, points: Points) -> Points:
        start = time.process_time()
        moved = self._film.follow(points, 0, self.frame)
        self.seconds += time.process_time() - start
        return moved


def with_normals(film: Film) -> Film:
    """Return the film with exact normals, from which curvature is taken."""
    h, rest = 1e-6 * film.max_edge_length, film.subject.vertices
    rise = [film.height(rest + h * axis) - film.height(rest - h * axis) for axis in np.eye(3)]
    normals = np.column_stack(rise)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(film, subject=film.subject.with_attributes(normal=normals))


def warm() -> None:
    """Load all kernels, so that no measurement includes it."""
    ball = icosphere(6)
    for placement in (Chord(), Curved(), Exact(_drawn_out, _onto), Exact(_turned, _onto)):
        for min_roundness in (0.6, 0.85):
            resampler = Resampler(ball, Thresholds(0.25), placement, min_roundness)
            for move in (_drawn_out, _turned):  # what is carried elsewhere stays on the chord, and is healed
                resampler.vertices[:] = move(resampler.vertices)
                resampler.resample()
            assert resampler.mesh.faces.size


def _drawn_out(points: Points) -> Points:
    return points * (1.5, 0.6, 1.0)


def _turned(points: Points) -> Points:
    return points[:, [2, 0, 1]]


def _onto(points: Points) -> Points:
    on: Points = points / np.linalg.norm(points, axis=1, keepdims=True)
    return on
