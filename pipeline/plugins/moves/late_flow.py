"""What flows have in common that act on one subject, its far parts later than the near ones."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from flowsculpt import Flow, UsageError
from flowsculpt.api.flows import Expression
from flowsculpt.api.meshes import Floats

Vector = tuple[float, float, float]

PLACE = ("x", "y", "z")
"""The names in a formula of a delay."""

ROUND = 0.05
"""Width of the place that is not late, over the reach: there the delay is round, not a cone or an edge."""


@dataclass(frozen=True)
class LateFlow(Flow):
    """The base of flows that act on one subject, its far parts later.

    seconds  by which what is `reach` away is late, or a formula over PLACE; what is below 0 counts as 0
    leads    the place that is not late; None is `centre`
    reach    units; None is the distance of the farthest point at rest
    along    direction in which the distance counts, ahead alone; None is all
    moments  numbers and times of all frames, for `findings`
    """

    seconds: float | str = 0.0
    leads: Vector | None = None
    reach: float | None = None
    along: Vector | None = None
    centre: Vector = (0.0, 0.0, 0.0)
    moments: tuple[tuple[int, float], ...] = field(default=(), compare=False, repr=False)

    def displace(self, points: Floats, time: float, dt: float) -> Floats:
        """Refuse to move points of which no subject is known."""
        raise UsageError(f"{self.name} acts on one subject. Make it an entry of flows.")

    def cache_data(self, time: float, dt: float) -> Any:
        raise UsageError(f"{self.name} acts on one subject. Make it an entry of flows.")

    def require_still(self, subject: Any) -> None:
        """Raise UsageError for a subject that a file moves."""
        if getattr(subject, "keeps_faces", False):
            fact = f"{self.name} does not carry a model that its file moves"
            raise UsageError(f"{fact}. Use place, or remove it.")

    @property
    def where(self) -> list[Any]:
        """What decides delays apart from the subject, JSON-able; empty where nothing is late."""
        return [self.seconds, self.leads or self.centre, self.reach, self.along] if self.seconds else []

    @cached_property
    def _formula(self) -> Expression | None:
        return Expression(self.seconds, PLACE) if isinstance(self.seconds, str) else None

    def distances(self, points: Floats) -> Floats:
        """Return the distances (N,) of points (N, 3) from what is not late; below 0 behind it."""
        x, y, z = points.T - np.array(self.leads or self.centre)[:, None]
        if self.along is None:
            distances: Floats = np.sqrt(x * x + y * y + z * z)
            return distances
        a, b, c = np.array(self.along) / np.linalg.norm(self.along)
        return np.asarray(a * x + b * y + c * z, np.float64)

    def delays(self, points: Floats, reach: float) -> Floats:
        """Return the delays (N,) of points (N, 3), s. Raises UsageError where a formula is not finite."""
        if self._formula is not None:
            return np.maximum(self._formula(**dict(zip(PLACE, points.T, strict=True))), 0.0)
        assert isinstance(self.seconds, float), "text is a formula"
        distances, width = self.distances(points), ROUND * reach
        rounded = np.hypot(distances, width)
        rounded = rounded - width if self.along is None else 0.5 * (distances + rounded)
        return self.seconds / reach * rounded
