"""Velocity fields: basic ones, and those computed by a function of their own, a block of points at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np

from pipeline.arrays import Points, Vectors
from pipeline.flow import _kernels_opcodes as op
from pipeline.flow import _kernels_velocity as kernels
from pipeline.flow.flow import for_kernels
from pipeline.flow.parameters import shot_name
from pipeline.flow.program import Instruction, Program, kinds_of, table_of
from pipeline.kernels import BlockKernel


class VelocityField(ABC):
    """Velocities in scene units per second, at any point and time, as a program for the kernels."""

    @abstractmethod
    def program(self, time: float) -> Program:
        """What the kernels do for it at a time: the same opcodes, and owners, at all times."""

    @abstractmethod
    def gradient_bound(self, time: float) -> float:
        """A bound of the velocity gradient, in 1/s: it decides the number of sub-steps."""

    def leaves(self, place: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        """The basic fields in it, each with the place that it sees where the whole sees `place` (3,)."""
        yield self, place

    @property
    def name(self) -> str:
        """What error messages call it."""
        return shot_name(type(self))

    def velocity(self, points: Points, time: float) -> Vectors:
        """Velocities (N, 3) at points (N, 3)."""
        points, program = for_kernels(points), self.program(time)
        out = np.empty_like(points)
        kernels.velocities(points, kinds_of(program), table_of(program).ravel(), out)
        return out


class Term(VelocityField):
    """A basic field: one leaf of the kernels and its numbers at a time. The catalogue holds the equations."""

    @property
    @abstractmethod
    def kind(self) -> int:
        """Its opcode."""

    @abstractmethod
    def row(self, time: float) -> tuple[float, ...]:
        """Its numbers at a time, in the kernels' order."""

    def program(self, time: float) -> Program:
        return (Instruction(self.kind, self.row(time)),)


class External(VelocityField):
    """One leaf of a program whose function, and whose arrays, the kernels find by their addresses.

    The field owns both, and its rows own the field.
    """

    @property
    @abstractmethod
    def block(self) -> BlockKernel:
        """Its function."""

    @abstractmethod
    def numbers(self, time: float) -> tuple[float, ...]:
        """What the function is given at a time, addresses among them: at most ten numbers."""

    @abstractmethod
    def identity(self, time: float) -> Any:
        """All that decides its velocities at a time, JSON-able and without any address."""

    def program(self, time: float) -> Program:
        row = (float(self.block.address), time, *self.numbers(time))
        return (Instruction(op.EXTERNAL, row, self.identity(time), self),)

    def alone(self, points: Points, time: float) -> Vectors:
        """Velocities (N, 3) at points (N, 3), by a plain call of its function."""
        columns = np.ascontiguousarray(points.T, np.float64)
        out = np.zeros_like(columns)
        self.block(np.array(self.numbers(time) or (0.0,)), columns, time, out)
        return out.T
