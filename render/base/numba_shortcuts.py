"""Shortcuts through numba, for a process that does nothing but compile kernels.

Most kernels are called by kernels alone, which link them in. These need no wrapper for Python and no machine
code of their own, and are optimised where they are linked in. That, resolving the same call again, and
listing options and variables one by one, take numba two fifths of its time. The results of kernels stay the
same to the bit.

This replaces private parts of numba, of the versions that VERSIONS names: with others no shortcut is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Any

import numba
from numba.core import ir

from flowsculpt.render.base.kernel_cache import KernelCache

if TYPE_CHECKING:
    from numba.core.compiler import CompileResult

VERSIONS = ("0.68.",)
"""What versions of numba begin with whose private parts these are."""


def take_shortcuts(inner: Collection[tuple[str, str]] = ()) -> None:
    """Change numba in this process, from now on; once, and before numba compiles anything.

    inner  module and name of kernels that only kernels call
    """
    if not numba.__version__.startswith(VERSIONS):
        return
    from numba.core.codegen import JITCPUCodegen
    from numba.core.cpu import CPUContext
    from numba.core.dispatcher import Dispatcher
    from numba.core.targetconfig import TargetConfig
    from numba.core.types.functions import BaseFunction

    KernelCache.inner = frozenset(inner)
    JITCPUCodegen._library_class = _library_class()
    _change(JITCPUCodegen, "set_env", _where_code_is)
    for method in ("create_cpython_wrapper", "create_cfunc_wrapper", "get_executable"):
        _change(CPUContext, method, _of_callable)
    _change(Dispatcher, "add_overload", _without_inner)
    _change(BaseFunction, "get_call_type", _remembering)
    _change(TargetConfig, "values", _at_once)
    _change(ir.Inst, "_rec_list_vars", lambda _: _variables_of)


def _change(owner: type, method: str, change: Callable[[Any], Any]) -> None:
    setattr(owner, method, change(getattr(owner, method)))


def _library_class() -> type:
    """Return the class of numba's compiled code, with what is needed later left for later."""
    from numba.core.codegen import JITCodeLibrary

    class _Library(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
        """Compiled code, optimised and made machine code once the address of a function is asked for."""

        _has_code = False

        def _optimize_functions(self, module: Any) -> None:
            module.data_layout = self._codegen._data_layout
            for function in module.functions:
                if not function.is_declaration:
                    passes, builder = self._codegen._function_pass_manager()
                    passes.run(function, builder)

        def _optimize_final_module(self) -> None:
            """Wait: callers of what is linked into others alone are optimised with it."""

        def _finalize_final_module(self) -> None:
            self._finalize_dynamic_globals()
            self._verify_declare_only_symbols()
            self._finalized = True

        def get_pointer_to_function(self, name: str) -> int:
            self._ensure_finalized()
            if not self._has_code:
                self._has_code = True
                self._dynamic_globals.clear()  # found once more
                super()._optimize_final_module()
                super()._finalize_final_module()
            return int(super().get_pointer_to_function(name))

        def serialize_using_object_code(self) -> tuple[str, str, Any]:
            return super().serialize_using_object_code() if self._has_code else self.serialize_using_bitcode()

    return _Library


class _Uncallable:
    """A placeholder for a compiled function that Python does not call."""


def _of_callable(create: Callable[..., Any]) -> Callable[..., Any]:
    """Return a method that makes what Python needs to call a function, where Python calls it."""

    def create_for_callable(context: Any, library: Any, function: Any, *others: Any, **options: Any) -> Any:
        name = function.modname, function.qualname
        if name in KernelCache.inner or function.modname.startswith("numba."):
            return _Uncallable()
        return create(context, library, function, *others, **options)

    return create_for_callable


def _where_code_is(set_env: Callable[[Any, str, Any], None]) -> Callable[[Any, str, Any], None]:
    """Return a method that gives machine code the environment of its function, where there is such code."""

    def set_environment(generator: Any, name: str, environment: Any) -> None:
        if generator._engine.get_global_value_address(name):
            set_env(generator, name, environment)

    return set_environment


def _without_inner(add: Callable[[Any, CompileResult], None]) -> Callable[[Any, CompileResult], None]:
    """Return a method that lists what a function was compiled to, for calls by Python where it can be."""

    def add_overload(dispatcher: Any, result: CompileResult) -> None:
        if isinstance(result.entry_point, _Uncallable):
            dispatcher.overloads[tuple(result.signature.args)] = result
        else:
            add(dispatcher, result)

    return add_overload


def _remembering(resolve: Callable[..., Any]) -> Callable[..., Any]:
    """Return numba's search for the types of a call, which remembers what it has found for a function."""
    from numba.core.targetconfig import ConfigStack

    found: dict[Any, Any] = {}

    def get_call_type(function: Any, context: Any, args: Any, kws: Any) -> Any:
        key = id(function), tuple(args), tuple(kws.items()), ConfigStack.top_or_none()
        if key not in found:
            found[key] = function, resolve(function, context, args, kws)  # lives on, and with it its id
        return found[key][1]

    return get_call_type


def _at_once(list_values: Callable[[Any], dict[str, Any]]) -> Callable[[Any], dict[str, Any]]:
    """Return numba's list of options and their values, made without asking for each."""
    defaults: dict[Any, dict[str, Any]] = {}

    def values(config: Any) -> dict[str, Any]:
        kind = type(config)
        if kind not in defaults:
            defaults[kind] = list_values(kind())
        return {**defaults[kind], **config._values}

    return values


_NO_VARIABLES = (ir.Loc, str, int, float, bool, type(None))


def _variables_of(instruction: Any, value: Any) -> list[Any]:
    """Return the variables in a part of an instruction, or in parts of it."""
    if isinstance(value, ir.Var):
        return [value]
    if isinstance(value, ir.Inst):
        return value.list_vars()
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
    found: list[Any] = []
    for part in parts:
        if type(part) is ir.Var:
            found.append(part)
        elif type(part) not in _NO_VARIABLES:
            found += _variables_of(instruction, part)
    return found
