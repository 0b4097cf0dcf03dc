"""The surface of a subject seen from one side, as heights over a plane: smooth, and defined everywhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flowsculpt.api.meshes import Floats, Indices

NODES = 96
"""Nodes along the longer side of a subject."""

PAD = 4
"""Nodes around it, so that splines fall there already."""


EVEN = 1e-12
"""Heights are multiples of it, in sizes of the subject, so that a flat side is exactly flat."""


@dataclass(frozen=True)
class Heights:
    """Heights of a subject over a plane, for `height_at`.

    Nodes take the heights of the faces above them. Around them heights fall by parabolas, so edges are round,
    and holes are filled by the parabolas that meet there. Cubic B-splines lie between the nodes.
    """

    numbers: Floats

    @classmethod
    def of(cls, points: Floats, faces: Indices, fall: float) -> Heights:
        """Return the heights of faces (F, 3) of points (V, 3), a, up, b; `fall` is that of `round_off`."""
        from flowsculpt.pipeline.plugins.contact.height_kernels import raise_to_faces, round_off, widen_flat

        seen = np.ascontiguousarray(points.T)  # so that numpy finds limits several times as fast
        low, high = seen.min(axis=1), seen.max(axis=1)
        grain = EVEN * (float((high - low).max()) or 1.0)
        low, high = low[::2], high[::2]
        cell = float((high - low).max()) / (NODES - 1) or 1.0
        columns, rows = (int(np.ceil(round(float(n), 6))) + 1 + 2 * PAD for n in (high - low) / cell)
        first_a, first_b = (float(x) - PAD * cell for x in low)
        nodes = np.full((rows, columns), -np.inf)
        raise_to_faces(
            np.ascontiguousarray(points), np.ascontiguousarray(faces, np.int32), first_a, first_b, cell, nodes
        )
        if not np.isfinite(nodes).any():  # too thin for the nodes
            nodes[rows // 2, columns // 2] = points[:, 1].max()
        for _ in range(2):  # rows, then columns: parabolas of distances along both add up
            round_off(nodes, fall * cell * cell)
            nodes = np.ascontiguousarray(nodes.T)
        nodes = np.round(nodes / grain) * grain
        highest = float(nodes.max())
        row, column = (int(np.mean(each)) for each in np.nonzero(nodes == highest))
        flat = np.array([column, row, column, row], np.int32)
        if nodes[row, column] == highest:
            widen_flat(nodes, flat)
        # between them, splines have four nodes of that height on each side
        a, b, c, d = (float(n) for n in cell * (flat + np.array([1, 1, -1, -1])))
        sides = [first_a + a, first_b + b, first_a + c, first_b + d]
        head = [highest, fall, columns, rows, first_a, first_b, cell, *sides]
        return cls(np.concatenate([head, nodes.ravel()]))

    def moved(self, by: Floats) -> Heights:
        """Return the heights of the subject once it is moved by so much along a, up and b."""
        from flowsculpt.pipeline.plugins.contact.height_kernels import CELL, FIRST, FLAT, HIGHEST, NODES

        numbers = self.numbers.copy()
        numbers[FIRST:CELL] += by[::2]
        numbers[FLAT:NODES] += np.tile(by[::2], 2)
        numbers[HIGHEST] += by[1]
        numbers[NODES:] += by[1]
        return Heights(numbers)

    def at(self, points: Floats) -> Floats:
        """Return the heights (N,) under points (N, 3), a, up and b."""
        from flowsculpt.pipeline.plugins.contact.height_kernels import write_heights

        a, b = np.ascontiguousarray(points.T[::2])
        heights = np.empty(len(points))
        write_heights(self.numbers, a, b, np.empty(7 * len(points)), heights)
        return heights
