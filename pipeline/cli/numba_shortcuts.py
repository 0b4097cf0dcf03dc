"""Shortcuts through numba, for a process that does nothing but compile kernels.

Numba's own Python takes more time than LLVM. A fifth of the whole goes to events around each call of LLVM, to
comparing the options of functions, and to wrappers of numba's own functions. Compiled code stays the same.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import NoneType
from typing import Any

from numba.core import event, ir
from numba.core.cpu import CPUContext
from numba.core.targetconfig import TargetConfig

_PLAIN = frozenset({bool, float, int, ir.Loc, NoneType, str})


def take_shortcuts() -> None:
    """Change numba in this process, from now on; once."""
    event.start_event = event.end_event = _send_no_event
    ir.Inst._rec_list_vars = _without_plain_values(ir.Inst._rec_list_vars)
    TargetConfig.values = _option_values
    TargetConfig.__eq__, TargetConfig.__hash__ = _same_options, _option_hash
    CPUContext.create_cpython_wrapper = _of_kernels(CPUContext.create_cpython_wrapper)
    CPUContext.create_cfunc_wrapper = _of_kernels(CPUContext.create_cfunc_wrapper)


def _send_no_event(*_: Any, **__: Any) -> None:
    """Replace events, which only numba's timers read."""


def _without_plain_values(list_variables: Callable[[Any, Any], list[Any]]) -> Callable[[Any, Any], list[Any]]:
    """Return numba's search for variables, which tests values for abstract classes, common ones first."""

    def quick(instruction: Any, value: Any) -> list[Any]:
        kind = type(value)
        if kind is ir.Var:
            return [value]
        if kind is dict:
            parts = [part for part in value.values() if type(part) not in _PLAIN]
            return [variable for part in parts for variable in quick(instruction, part)]
        return [] if kind in _PLAIN else list_variables(instruction, value)

    return quick


def _option_values(config: Any) -> dict[str, Any]:
    """Return all options of a function; numba asks a property for each."""
    return _defaults(config.__class__) | config._values


@cache
def _defaults(kind: Any) -> dict[str, Any]:
    return {name: option.default for name, option in kind.options.items()}


def _same_options(config: Any, other: object) -> bool:
    """Compare options, first those that are set."""
    if not isinstance(other, TargetConfig):
        return NotImplemented
    same = type(config) is type(other) and config._values == other._values
    return same or config.values() == other.values()


def _option_hash(config: Any) -> int:
    """Return a hash of the class; numba's is one of the names of all options, and no finer."""
    return hash(type(config))


def _of_kernels(create: Callable[..., None]) -> Callable[..., None]:
    """Return a method that creates wrappers of kernels, and none of numba's functions that kernels call."""

    def create_for_kernel(context: Any, library: Any, function: Any, *others: Any, **options: Any) -> None:
        if not function.modname.startswith("numba."):
            create(context, library, function, *others, **options)

    return create_for_kernel
