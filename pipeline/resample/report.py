"""The report of one resampled frame: what was done, edge lengths, and edges too short, by the reason why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType


@dataclass(frozen=True)
class Report:
    """Counts of one frame.

    splits, collapses, flips   operations done
    passes                     rounds of splitting until no edge was too long
    refused                    edges still too short, by the reason why they may not collapse:
                               link       the surface would no longer be a manifold
                               boundary   two boundaries would meet, or a boundary triangle vanish
                               feature    two corners or two creases would become one
                               too_long   an edge over the maximum would appear
                               fold       a face would turn over or become a sliver
                               shape      a tendril would lose over 5% of the maximum edge at its tip
                               crowded    an end has more than 511 neighbours
    vertices, faces, edges     counts after the pass
    too_long, too_short        edges outside their limits; too_long is 0, too_short the sum of `refused`
    shortest, longest          edge lengths, scene units
    relaxed                    vertices moved within the surface for the shape of their triangles
    on_chord                   new vertices left at the middle of their edge, because the surface would have
                               folded at their proper place
    """

    splits: int
    collapses: int
    flips: int
    passes: int
    vertices: int
    faces: int
    edges: int
    too_long: int
    too_short: int
    shortest: float
    longest: float
    relaxed: int = 0
    on_chord: int = 0
    refused: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "refused", MappingProxyType(dict(self.refused)))

    @property
    def within_limits(self) -> float:
        """Share of the edges within their length limits, 0 to 1."""
        return 1.0 - (self.too_long + self.too_short) / self.edges
