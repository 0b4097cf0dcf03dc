"""Shortcuts through numba, for a process that does nothing but compile kernels.

Most kernels are called by kernels alone, which link them in. These need no wrapper for Python and no machine
code of their own, and are optimised where they are linked in. That, searching for garbage, sending events,
resolving the same call again and analysing what nobody reads take numba half of its time. The results of
kernels stay the same to the bit.

This replaces private parts of numba, of the versions that VERSIONS names: with others no shortcut is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import cache
from types import NoneType
from typing import Any

import numba
from numba.core import base, codegen, event, ir, transforms
from numba.core.annotations.type_annotations import TypeAnnotation
from numba.core.compiler import CompileResult
from numba.core.compiler_machinery import PassManager, _pass_registry
from numba.core.cpu import CPUContext
from numba.core.dispatcher import Dispatcher
from numba.core.postproc import PostProcessor, VariableLifetime
from numba.core.targetconfig import ConfigStack, TargetConfig
from numba.core.types.functions import BaseFunction

from flowsculpt.render.base.kernel_cache import KernelCache

VERSIONS = ("0.68.",)
"""What versions of numba begin with whose private parts these are."""

_PLAIN = frozenset({bool, float, int, ir.Loc, NoneType, str})


def take_shortcuts(inner: Collection[tuple[str, str]] = ()) -> None:
    """Change numba in this process, from now on; once, and before numba compiles anything.

    inner  module and name of kernels that only kernels call
    """
    if not numba.__version__.startswith(VERSIONS):
        return
    event.start_event = event.end_event = _send_no_event
    PassManager._runPass = _run_pass
    TypeAnnotation.__str__ = _no_listing
    _change(ir.Inst, "_rec_list_vars", _without_plain_values)
    _change(PostProcessor, "run", _without_entry_variables)
    TargetConfig.values = _option_values
    TargetConfig.__eq__, TargetConfig.__hash__ = _same_options, _option_hash
    _change(BaseFunction, "get_call_type", _remembering)
    base._has_loc = cache(base._has_loc)
    KernelCache.inner = frozenset(inner)
    codegen.JITCPUCodegen._library_class = _Library
    _change(codegen.JITCPUCodegen, "set_env", _where_code_is)
    for method in ("create_cpython_wrapper", "create_cfunc_wrapper", "get_executable"):
        _change(CPUContext, method, _of_callable)
    _change(Dispatcher, "add_overload", _without_inner)


def _change(owner: type, method: str, change: Callable[[Any], Any]) -> None:
    setattr(owner, method, change(getattr(owner, method)))


class _Library(codegen.JITCodeLibrary):  # type: ignore[misc]  # numba has no types
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
    found: dict[Any, Any] = {}

    def get_call_type(function: Any, context: Any, args: Any, kws: Any) -> Any:
        key = id(function), tuple(args), tuple(kws.items()), ConfigStack.top_or_none()
        if key not in found:
            found[key] = function, resolve(function, context, args, kws)  # lives on, and with it its id
        return found[key][1]

    return get_call_type


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


def _run_pass(manager: Any, _: int, step: Any, state: Any) -> None:
    """Run a pass, which numba also times, describes for messages and searches for faults."""
    step.analysis = manager._analysis
    has_changed = step.run_initialization(state)
    has_changed |= step.run_pass(state)
    has_changed |= step.run_finalizer(state)
    if _pass_registry.get(step.__class__).mutates_CFG:
        if has_changed:
            PostProcessor(state.func_ir).run()
        else:
            state.func_ir.blocks = transforms.canonicalize_cfg(state.func_ir.blocks)


def _without_entry_variables(run: Callable[..., None]) -> Callable[..., None]:
    """Return numba's last step of each pass, which lists variables that generators alone need."""

    def quick(step: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        function = step.func_ir
        if function.is_generator:
            return run(step, emit_dels, extend_lifetimes)
        function.blocks = transforms.canonicalize_cfg(function.blocks)
        function.variable_lifetime = VariableLifetime(function.blocks)  # computed once it is read
        if emit_dels:
            step._insert_var_dels(extend_lifetimes=extend_lifetimes)
        return None

    return quick


def _no_listing(annotation: Any) -> str:
    """Replace the listing of a function's source and types, which numba files with its machine code."""
    return ""


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
