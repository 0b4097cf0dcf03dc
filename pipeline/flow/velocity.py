"""Velocity fields, the programs by which the kernels compute them, and what their costs follow from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, is_dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from flowsculpt.pipeline.arrays import Floats, Indices, Points, Vectors
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.flow.kernels import instructions as op
from flowsculpt.pipeline.flow.kernels.field_kernels import velocities
from flowsculpt.pipeline.flow.parameters import kernel_points, number_at, parameters_of, shot_name
from flowsculpt.pipeline.kernels import BlockKernel, in_threads

T = TypeVar("T")


class Instruction(NamedTuple):
    """One row of a program.

    opcode      see `kernels.instructions` and `kernels.field_kernels`
    numbers     its operands at some time, at most COLUMNS
    cache_data  JSON-able data in place of numbers that hold addresses; equal data must mean equal motion
    owner       keeps the memory at these addresses
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


def transformed(inside: Program, centre: tuple[float, ...], matrix: Floats) -> Program:
    """Return a program in a frame: its origin lies at `centre`, its axes are the columns of `matrix` (3, 3).

    A point x moves to centre + matrix · x, and velocities transform likewise. Raises numpy.linalg.LinAlgError
    for a matrix without an inverse.
    """
    into = (*centre, *np.linalg.inv(matrix).ravel().tolist())
    out_of = (0.0, 0.0, 0.0, *np.asarray(matrix, dtype=np.float64).ravel().tolist())
    return (Instruction(op.PLACE, into), *inside, Instruction(op.UNPLACE, out_of))


def opcodes_of(program: Program) -> Indices:
    return np.array([row.opcode for row in program], dtype=np.int32)


def table_of(program: Program) -> Floats:
    """Return the numbers (K, COLUMNS) as the kernels take them."""
    table = np.zeros((len(program), op.COLUMNS))
    for k, row in enumerate(program):
        table[k, : len(row.numbers)] = row.numbers
    return table


class StableProperty(cached_property[T]):
    """A property computed when first used, whose first value stays: kernels know its memory by address.

    Threads that compute it at once all get the value that was there first.
    """

    def __get__(self, instance: Any, owner: Any = None) -> Any:
        return self if instance is None else vars(instance).setdefault(self.attrname, self.func(instance))


class VelocityField(ABC):
    """Velocities in scene units per second, at any point and time, as a program for the kernels.

    A field moves nothing by itself: `Streamlines` of it is a flow.
    """

    @abstractmethod
    def program(self, time: float) -> Program:
        """Return the field's program at a time: the same opcodes at all times."""

    @abstractmethod
    def gradient_bound(self, time: float) -> float:
        """Return a bound of the spectral norm of the velocity gradient, in 1/s; it decides the sub-steps."""

    @abstractmethod
    def length_scale(self, time: float) -> float:
        """Return the shortest length over which the velocity varies, scene units; infinite if it is linear.

        A sub-step crosses a part of it only, so that no point passes by a narrow vortex between two stages.
        """

    def leaves(self, point: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        """Yield the fields it is composed of, each with a point (3,) in that field's coordinates."""
        yield self, point

    def kinks(self, time: float, dt: float) -> Iterable[float]:
        """Return the times within a step at which velocities bend in time: sub-steps end there."""
        parts = (leaf for leaf, _ in self.leaves(np.zeros(3), time) if leaf is not self)
        return {kink for part in parts for kink in part.kinks(time, dt)}

    holds_much: bool = False
    """True if its programs hold so much memory that none may outlive a step; of no composed field."""

    can_diagnose: ClassVar[bool] = False
    """True if `diagnose` may say something."""

    def diagnose(self, point: Points, time: float) -> str | None:
        """Return why the velocity at a point (3,) is not finite; None where it is, or where nobody knows."""
        return None

    @property
    def name(self) -> str:
        """The name in error messages."""
        return shot_name(type(self))

    def velocity(self, points: Points, time: float) -> Vectors:
        """Return velocities (N, 3) at points (N, 3)."""
        points, program = kernel_points(points), self.program(time)
        out = np.empty_like(points)
        given = points, opcodes_of(program), table_of(program).ravel(), out
        if len(points) > op.PARALLEL_FROM:
            in_threads(velocities, op.BLOCK, *given)
        else:
            velocities(*given)
        table_of(program)  # its numbers raise what a kernel could not
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

    gains_from_order: ClassVar[bool] = True
    """True if it computes something once for neighbours: blocks then hold points that lie together."""

    @property
    @abstractmethod
    def block(self) -> BlockKernel:
        """The function, from a block of points to velocities; a class variable if it is the same for all."""

    @abstractmethod
    def numbers(self, time: float) -> tuple[float, ...]:
        """Return the function's numbers at a time, at most eleven; some may be addresses of arrays."""

    def __getstate__(self) -> dict[str, Any]:
        """Return what a pickle holds: nothing that is known by address in this process."""
        known = {name for name in vars(self) if isinstance(getattr(type(self), name, None), cached_property)}
        return {name: value for name, value in vars(self).items() if name not in known}

    def cache_data(self, time: float) -> Any:
        """Return all that decides its velocities at a time, JSON-able and without any address."""
        return [time, *self.numbers(time)]

    def program(self, time: float) -> Program:
        row = (float(self.block.address), time, *self.numbers(time))
        return (Instruction(op.EXTERNAL, row, self.cache_data(time), self),)


@dataclass(frozen=True)
class ModifiedField(VelocityField):
    """The base of fields made of another one."""

    field: VelocityField

    def gradient_bound(self, time: float) -> float:
        return self.field.gradient_bound(time)

    def length_scale(self, time: float) -> float:
        return self.field.length_scale(time)

    def leaves(self, point: Points, time: float) -> Iterator[tuple[VelocityField, Points]]:
        return self.field.leaves(point, time)

    @property
    def name(self) -> str:
        return self.field.name


@dataclass(frozen=True)
class PluginField(ModifiedField):
    """A field of a plug-in; `origin`, which decides it too: plug-in, its version, and the field's name."""

    origin: tuple[str, str, str]

    def program(self, time: float) -> Program:
        rows = self.field.program(time)
        for row in rows:
            if len(row.numbers) > op.COLUMNS or any(map(np.ndim, row.numbers)):
                rule = "at most eleven numbers; write *vector for the numbers of a vector"
                raise self._fault(f"numbers() returned {row.numbers[2:]}", rule)
        return tuple(row._replace(cache_data=[*self.origin, row.as_data()]) for row in rows)

    def gradient_bound(self, time: float) -> float:
        return self._length_or_rate("gradient_bound", self.field.gradient_bound(time))

    def length_scale(self, time: float) -> float:
        return self._length_or_rate("length_scale", self.field.length_scale(time))

    def _length_or_rate(self, method: str, value: Any) -> float:
        if not isinstance(value, float | int | np.number) or not value >= 0.0:
            raise self._fault(f"{method}() returned {value!r}", "a number from 0 on")
        return float(value)

    def _fault(self, fact: str, rule: str) -> FrameError:
        return FrameError(f"plug-in {self.origin[0]}: flow {self.name}: {fact}; it must return {rule}")

    @property
    def name(self) -> str:
        return self.origin[2]


CLEARLY = 0.6  # a parameter matters where a factor of two lowers the cost to this share

Settings = tuple[tuple[str, float], ...]
"""Parameters with their values, as in shot files."""


class Sensitivity(NamedTuple):
    """Parameters that lower a cost when they are raised, and those that do when they are lowered."""

    raised: Settings = ()
    lowered: Settings = ()

    def __str__(self) -> str:
        """`size 1, strength 40`; empty where no parameter matters"""
        return ", ".join(f"{name} {value:g}" for name, value in (*self.raised, *self.lowered))

    def __bool__(self) -> bool:
        return bool(self.raised or self.lowered)

    @property
    def remedies(self) -> list[str]:
        """`raise size`, `lower strength`"""
        verbs = ("raise", self.raised), ("lower", self.lowered)
        return [f"{verb} {' or '.join(name for name, _ in named)}" for verb, named in verbs if named]


def sensitivity(field: VelocityField, cost_of: Callable[[VelocityField], float], time: float) -> Sensitivity:
    """Return the parameters of a field, at a time, that lower its cost most clearly."""
    assert is_dataclass(field) and not isinstance(field, type)
    raised, lowered = list[tuple[str, float]](), list[tuple[str, float]]()
    now = cost_of(field)
    for parameter in parameters_of(type(field)):
        if parameter.form not in ("number", "constant"):
            continue
        value = number_at(getattr(field, parameter.name), time)
        for factor, found in ((2.0, raised), (0.5, lowered)):
            if value and cost_of(replace(field, **{parameter.name: factor * value})) < CLEARLY * now:
                found.append((parameter.name, value / parameter.doc.factor))
    return Sensitivity(tuple(raised), tuple(lowered))
