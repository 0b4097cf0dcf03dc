"""Velocity fields: basic ones, which the kernels know, and external ones with a compiled function."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np

from pipeline.arrays import Points, Vectors
from pipeline.flow.kernels import opcodes as op
from pipeline.flow.kernels import streamlines as kernels
from pipeline.flow.parameters import shot_name
from pipeline.flow.program import Instruction, Program, opcodes_of, table_of
from pipeline.flow.vectors import kernel_points
from pipeline.kernels import BlockKernel


class VelocityField(ABC):
    """Velocities in scene units per second, at any point and time, as a program for the kernels."""

    @abstractmethod
    def program(self, time: float) -> Program:
        """Return the field's program at a time: the same opcodes, and owners, at all times."""

    @abstractmethod
    def gradient_bound(self, time: float) -> float:
        """Return a bound of the velocity gradient's norm, in 1/s: it decides the number of sub-steps."""

    def leaves(self, point: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        """Yield the fields it is composed of, each with a point (3,) in that field's coordinates."""
        yield self, point

    @property
    def name(self) -> str:
        """The name in error messages."""
        return shot_name(type(self))

    def velocity(self, points: Points, time: float) -> Vectors:
        """Return velocities (N, 3) at points (N, 3)."""
        points, program = kernel_points(points), self.program(time)
        out = np.empty_like(points)
        kernels.velocities(points, opcodes_of(program), table_of(program).ravel(), out)
        return out


class BasicField(VelocityField):
    """A field with an equation in the kernels: one row of a program."""

    @property
    @abstractmethod
    def opcode(self) -> int:
        """The opcode of its equation; a class variable where it is always the same."""

    @abstractmethod
    def row(self, time: float) -> tuple[float, ...]:
        """Return the numbers of its equation at a time, in the order of the equation's docstring."""

    def program(self, time: float) -> Program:
        return (Instruction(self.opcode, self.row(time)),)


class ExternalField(VelocityField):
    """A field with a compiled function of its own, which the kernels call by its address.

    The field owns the function and its arrays, and the rows of its programs own the field.
    """

    @property
    @abstractmethod
    def block(self) -> BlockKernel:
        """The function, from a block of points to velocities."""

    @abstractmethod
    def numbers(self, time: float) -> tuple[float, ...]:
        """Return the function's numbers at a time, at most ten; some may be addresses of arrays."""

    @abstractmethod
    def cache_data(self, time: float) -> Any:
        """Return all that decides its velocities at a time, JSON-able and without any address."""

    def program(self, time: float) -> Program:
        row = (float(self.block.address), time, *self.numbers(time))
        return (Instruction(op.EXTERNAL, row, self.cache_data(time), self),)

    def alone(self, points: Points, time: float) -> Vectors:
        """Return velocities (N, 3) at points (N, 3), by a direct call of its function."""
        columns = np.ascontiguousarray(points.T, np.float64)
        out = np.zeros_like(columns)
        self.block(np.array(self.numbers(time) or (0.0,)), columns, time, out)
        return out.T
