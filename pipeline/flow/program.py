"""Velocity programs as values: rows of an opcode and numbers, which the kernels run in order."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pipeline.arrays import Floats, Indices
from pipeline.flow.kernels import opcodes as op


class Instruction(NamedTuple):
    """One row of a program.

    opcode      see `kernels.opcodes` and the families of fields
    numbers     its operands at some time, at most COLUMNS
    cache_data  JSON-able data in place of the numbers, where these hold addresses; equal data must mean equal
                motion
    owner       keeps the memory at these addresses, for as long as the row exists
    """

    opcode: int
    numbers: tuple[float, ...] = ()
    cache_data: Any = None
    owner: Any = None

    def as_data(self) -> list[Any]:
        """Return all that decides what the row does, JSON-able and without any address."""
        return [self.opcode, list(self.numbers) if self.cache_data is None else self.cache_data]


Program = tuple[Instruction, ...]
"""A velocity field at one time: the same opcodes at all times, with numbers that may change."""


def grouped(inside: Program, closing: Instruction) -> Program:
    """Return a program that is summed apart, and added as a closing instruction says."""
    return (Instruction(op.OPEN), *inside, closing)


def scaled(inside: Program, factor: float) -> Program:
    """Return a program with its velocities times a factor."""
    return grouped(inside, Instruction(op.CLOSE, (factor,)))


def placed(inside: Program, centre: tuple[float, ...], matrix: Floats) -> Program:
    """Return a program in a frame: its origin lies at `centre`, its axes are the columns of `matrix` (3, 3).

    A point x moves to centre + matrix · x, and velocities transform likewise. Raises numpy.linalg.LinAlgError
    for a matrix without an inverse.
    """
    into = (*centre, *np.linalg.inv(matrix).ravel().tolist())
    out_of = (0.0, 0.0, 0.0, *np.asarray(matrix, dtype=np.float64).ravel().tolist())
    return (Instruction(op.PLACE, into), *inside, Instruction(op.UNPLACE, out_of))


def opcodes_of(program: Program) -> Indices:
    """Return the opcodes (K,)."""
    return np.array([row.opcode for row in program], dtype=np.int32)


def table_of(program: Program) -> Floats:
    """Return the numbers (K, COLUMNS) as the kernels take them."""
    table = np.zeros((len(program), op.COLUMNS))
    for k, row in enumerate(program):
        table[k, : len(row.numbers)] = row.numbers
    return table
