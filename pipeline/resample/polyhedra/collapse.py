"""Unsubdivision: removing edges, or faces, that have become too small (P9, P22; Figure E)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable

from pipeline.resample.polyhedra.can_collapse import can_collapse
from pipeline.resample.polyhedra.editor import PolyhedronEditor
from pipeline.resample.polyhedra.geometry import norm
from pipeline.resample.polyhedra.polyhedron import OUTSIDE

_EQUILATERAL = math.sqrt(3) / 4  # area of a triangle over its side squared


class Collapser:
    """Collapses what is too small where it may; counts the rest by reason.

    refused   edges that are still too short, by reason (P9)
    """

    def __init__(self, editor: PolyhedronEditor) -> None:
        self._editor = editor
        self.refused: Counter[str] = Counter()

    def edges(self, edges: Iterable[int]) -> None:
        """Collapse every short edge that may collapse, the shortest first (the paper's choice).

        Includes edges that a collapse makes short. A refused edge is tried again once a face around it has
        changed.
        """
        queue = self._short(edges)
        refused: dict[int, str] = {}
        while queue:
            changed: set[int] = set()
            for h in queue:  # it grows as it is worked through
                if not self._is_short(h):
                    continue
                decision = can_collapse(self._editor, h)
                if decision.share is None:
                    refused[h] = decision.reason
                else:
                    refused.pop(h, None)
                    queue += self._short(self._collapse(h, decision.share, changed))
            queue = [h for h in refused if self._touches(h, changed)]
        self.refused = Counter(reason for h, reason in refused.items() if self._is_short(h))

    def faces(self, faces: Iterable[int], edges: Iterable[int]) -> None:
        """Collapse every face smaller than a triangle with the shortest sides (P22).

        The option that the paper tried and abandoned. A face collapses edge by edge, each under the rules of
        any edge. Afterwards the short edges among `edges` and the changed ones are counted; where one may
        collapse but its faces are large enough, the reason is `area`.
        """
        queue, seen = list(faces), dict.fromkeys(edges)
        for f in queue:  # it grows as it is worked through
            if self._is_small(f):
                around = self._shrink(f)
                seen |= dict.fromkeys(around)
                queue += dict.fromkeys(self._editor.surface.face[h ^ side] for h in around for side in (0, 1))
        self.refused = Counter(can_collapse(self._editor, h).reason or "area" for h in self._short(seen))

    def _shrink(self, f: int) -> list[int]:
        """Merge the corners of a face as far as possible; return the edges around the merged vertices."""
        surface, around = self._editor.surface, []
        corners = [surface.origin[h] for h in surface.loop(surface.side[f])]
        while True:
            inner = [h & ~1 for v in corners for h in surface.star(v) if surface.origin[h ^ 1] in corners]
            inner = sorted(set(inner), key=lambda h: (self._editor.length(h), h))
            for h in inner:
                decision = can_collapse(self._editor, h)
                if decision.share is not None:
                    corners.remove(surface.origin[h ^ 1])
                    around += self._collapse(h, decision.share, set())
                    break
            else:
                return [h for h in around if surface.origin[h] != OUTSIDE]

    def _collapse(self, h: int, share: float, changed: set[int]) -> list[int]:
        """Collapse an edge, record the corners of changed faces, and return the edges around."""
        surface = self._editor.surface
        vertex = self._editor.collapse(h, share)
        star = surface.star(vertex)
        for k in star:
            changed.update(surface.origin[one] for one in surface.loop(k))
        changed.update(surface.origin[k ^ 1] for k in star)
        return [k & ~1 for k in star]

    def _touches(self, h: int, changed: set[int]) -> bool:
        origin = self._editor.surface.origin
        return origin[h] in changed or origin[h ^ 1] in changed

    def _is_short(self, h: int) -> bool:
        return self._editor.surface.origin[h] != OUTSIDE and self._editor.is_too_short(h)

    def _short(self, edges: Iterable[int]) -> list[int]:
        """Return the edges that are too short, each once by its first half-edge, the shortest first."""
        once = dict.fromkeys(h & ~1 for h in edges)
        return sorted((h for h in once if self._is_short(h)), key=lambda h: (self._editor.length(h), h))

    def _is_small(self, f: int) -> bool:
        surface, limits = self._editor.surface, self._editor.limits
        if f == OUTSIDE or surface.side[f] == OUTSIDE:
            return False
        corners = [surface.origin[h] for h in surface.loop(surface.side[f])]
        least = min(limits.min_edge_length(v, v) for v in corners)
        return 0.5 * norm(self._editor.normal(f)) < _EQUILATERAL * least * least
