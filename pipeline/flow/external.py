"""Velocity fields that a function of their own computes, a block of points at a time."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from pipeline.arrays import Points, Vectors
from pipeline.flow import _kernels_opcodes as op
from pipeline.flow.program import Instruction, Program
from pipeline.flow.velocity import VelocityField
from pipeline.kernels import BlockKernel


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
