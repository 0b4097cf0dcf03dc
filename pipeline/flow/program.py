"""Velocity programs as values: rows of an opcode and numbers, which the kernels obey in order."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pipeline.arrays import Floats, Indices
from pipeline.flow import _kernels_opcodes as op


class Instruction(NamedTuple):
    """One row of a program.

    kind      an opcode of `_kernels_opcodes`
    numbers   what it works with at some time, at most COLUMNS
    identity  JSON-able data that stands for the numbers in keys, where these hold addresses; equal data must
              mean equal motion
    owner     what keeps the memory at these addresses, for as long as the row is there
    """

    kind: int
    numbers: tuple[float, ...] = ()
    identity: Any = None
    owner: Any = None


Program = tuple[Instruction, ...]
"""What a velocity field does at a moment: the same opcodes at all times, with numbers that may change."""


def grouped(inside: Program, closing: Instruction) -> Program:
    """A program summed apart, and added as a closing instruction says."""
    return (Instruction(op.OPEN), *inside, closing)


def scaled(inside: Program, factor: float) -> Program:
    """A program with its velocities times a factor."""
    return grouped(inside, Instruction(op.CLOSE, (factor,)))


def placed(inside: Program, centre: tuple[float, ...], matrix: Floats) -> Program:
    """A program in a frame: its origin lies at `centre`, its axes are the columns of `matrix` (3, 3).

    What was at x is now at centre + matrix · x, and so are its velocities turned and scaled. Raises
    numpy.linalg.LinAlgError for a matrix without an inverse.
    """
    into = (*centre, *np.linalg.inv(matrix).ravel().tolist())
    out_of = (0.0, 0.0, 0.0, *np.asarray(matrix, dtype=np.float64).ravel().tolist())
    return (Instruction(op.PLACE, into), *inside, Instruction(op.UNPLACE, out_of))


def kinds_of(program: Program) -> Indices:
    """The opcodes (K,)."""
    return np.array([row.kind for row in program], dtype=np.int32)


def table_of(program: Program) -> Floats:
    """The numbers (K, COLUMNS) as the kernels take them."""
    table = np.zeros((len(program), op.COLUMNS))
    for k, row in enumerate(program):
        table[k, : len(row.numbers)] = row.numbers
    return table


def owners_of(program: Program) -> tuple[Any, ...]:
    """What must live as long as its numbers are used."""
    return tuple(row.owner for row in program if row.owner is not None)


def identity_of(program: Program) -> list[Any]:
    """All that decides what it does, as JSON-able data without any address."""
    return [[row.kind, list(row.numbers) if row.identity is None else row.identity] for row in program]
