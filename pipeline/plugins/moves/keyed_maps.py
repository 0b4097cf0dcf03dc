"""Maps of points by numbers that change over time, which can take another time for each point, and back."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from flowsculpt import Bend, Flow, Shear, Streamlines, Stretch, Sum, Taper, Twist, VelocityField
from flowsculpt.api.flows import number_at
from flowsculpt.api.meshes import Floats

RATE = 480.0
"""Samples of the numbers in a second; between them they are smooth."""


class KeyedMap(ABC):
    """A family of maps, each given by K numbers: methods take (N, K), or (1, K) for all points."""

    constants: Any = None
    """What decides the maps besides their numbers, JSON-able."""

    @abstractmethod
    def at(self, time: float) -> Sequence[float]:
        """Return the numbers at a time, seconds from 0 on; at 0 nothing has moved."""

    @abstractmethod
    def apply(self, points: Floats, numbers: Floats) -> Floats:
        """Return moved points (N, 3)."""

    @abstractmethod
    def undo(self, points: Floats, numbers: Floats) -> Floats:
        """Return the points (N, 3) that the maps move to these."""


class DeformationMap(KeyedMap):
    """A twist, taper, stretch, shear or bend, by its amount."""

    def __init__(self, flow: Any) -> None:
        self._flow, self._rest = flow, number_at(flow.amount, 0.0)
        self.constants = flow.cache_data(0.0, 0.0)

    def at(self, time: float) -> Sequence[float]:
        return (number_at(self._flow.amount, time),)

    def apply(self, points: Floats, numbers: Floats) -> Floats:
        moved: Floats = self._flow.between(points, self._rest, numbers[:, 0])
        return moved

    def undo(self, points: Floats, numbers: Floats) -> Floats:
        moved: Floats = self._flow.between(points, numbers[:, 0], self._rest)
        return moved


class AffineMap(KeyedMap):
    """Turns, shifts and scales: the numbers are the rows of a matrix (3, 4), its last column the shift."""

    def apply(self, points: Floats, numbers: Floats) -> Floats:
        a, b, c, shift = _columns(numbers)
        return points[:, :1] * a + points[:, 1:2] * b + points[:, 2:] * c + shift

    def undo(self, points: Floats, numbers: Floats) -> Floats:
        from flowsculpt.pipeline.plugins.moves.map_kernels import undo_affine  # not needed to read shots

        found = np.empty((len(points), 3))
        undo_affine(numbers, np.ascontiguousarray(points), found)
        return found


def _columns(numbers: Floats) -> Sequence[Floats]:
    return [numbers[:, first::4] for first in range(4)]


class LinearFieldMap(AffineMap):
    """The motion along velocities that are linear in the place, from time 0 on."""

    def __init__(self, flow: Streamlines) -> None:
        self._flow = flow
        self._corners: list[Floats] = [np.concatenate([np.zeros((1, 3)), np.eye(3)])]

    def at(self, time: float) -> Sequence[float]:
        whole = int(time * RATE + 1e-9)
        while len(self._corners) <= whole:  # each from the one before, whatever times are asked for
            before = (len(self._corners) - 1) / RATE
            self._corners.append(self._flow.displace(self._corners[-1], before, 1.0 / RATE))
        left = time - whole / RATE
        corners = self._corners[whole]
        if left > 1e-9:
            corners = self._flow.displace(corners, whole / RATE, left)
        return [x for row in np.column_stack([(corners[1:] - corners[0]).T, corners[0]]) for x in row]


def keyed_map(flow: Flow) -> KeyedMap | None:
    """Return a flow as maps by keyed numbers; None for one that is none."""
    if isinstance(flow, Bend | Shear | Stretch | Taper | Twist):
        return DeformationMap(flow)
    return LinearFieldMap(flow) if isinstance(flow, Streamlines) and _is_linear(flow.field) else None


def _is_linear(field: VelocityField) -> bool:
    """Tell whether velocities are linear in the place at all times, as those of a rotation are."""
    if isinstance(field, Sum):
        return all(map(_is_linear, field.fields))
    leaf, _ = next(field.leaves(np.zeros(3), 0.0))
    return leaf is field and field.length_scale(0.0) == math.inf


class MapSequence:
    """Maps one after another, with their numbers at multiples of 1 / RATE seconds, which follow as needed."""

    def __init__(self, maps: Sequence[KeyedMap]) -> None:
        self.maps = tuple(maps)
        self._samples: Floats = np.array([self.exactly(0.0)])

    def apply(self, points: Floats, times: Floats | float) -> Floats:
        """Return points (N, 3) moved by the maps of times (N,), seconds, or exactly by those of one time."""
        numbers = self._numbers(times)
        for each, own in zip(self.maps, numbers, strict=True):
            points = each.apply(points, own)
        return points

    def undo(self, points: Floats, times: Floats | float) -> Floats:
        """Return the points (N, 3) that `apply` moves to these."""
        numbers = self._numbers(times)
        for each, own in zip(self.maps[::-1], numbers[::-1], strict=True):
            points = each.undo(points, own)
        return points

    def samples(self, time: float) -> Floats:
        """Return the numbers (S, K) that decide the motion up to a time."""
        count = math.ceil(max(time, 0.0) * RATE) + 3
        if more := [self.exactly(i / RATE) for i in range(len(self._samples), count)]:
            self._samples = np.concatenate([self._samples, more])
        return self._samples[:count]

    def exactly(self, time: float) -> list[float]:
        return [number for each in self.maps for number in each.at(time)]

    def _numbers(self, times: Floats | float) -> list[Floats]:
        """Return the numbers of each map, (N, K) each; between samples by Catmull and Rom's cubic."""
        if isinstance(times, float):
            numbers = np.array([self.exactly(max(times, 0.0))])
        else:
            from flowsculpt.pipeline.plugins.moves.map_kernels import interpolate

            table = self.samples(float(times.max(initial=0.0)))
            numbers = np.empty((len(times), table.shape[1]))
            interpolate(table, np.maximum(times, 0.0) * RATE, numbers)
        ends = np.cumsum([len(each.at(0.0)) for each in self.maps])
        return np.split(numbers, ends[:-1], axis=1)
