"""The version of the contract with plug-ins, and checks that a part of one keeps the contract of its door.

A contract is a class beside the code that uses it, which the class of a part extends. Parts are checked when
they are read.
"""

from __future__ import annotations

import inspect
from collections.abc import Collection, Iterable, Mapping
from dataclasses import is_dataclass
from difflib import get_close_matches
from functools import cache
from inspect import Parameter, Signature
from typing import Any, get_args, get_origin, get_type_hints

OURS = "flowsculpt."
"""How the names of modules with contracts begin."""


class ContractError(Exception):
    """A plug-in, or a part of it, breaks its contract: the fact and the remedy, in a sentence."""


def fault_of_types(values: Any) -> str | None:
    """Return which field of a dataclass has a value of another type than it says; None where none has."""
    kind_of_values: Any = type(values)
    for name, kind in _types_of(kind_of_values).items():
        if not _fits(getattr(values, name), kind):
            return f"its field {name} is not {_in_words(kind)}"
    return None


@cache
def _types_of(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind)


def _fits(value: Any, kind: Any) -> bool:
    """Return whether a value is of the type of a field, with all that it holds."""
    holds = get_args(kind)
    if get_origin(kind) is Mapping:
        return isinstance(value, Mapping) and all(
            isinstance(name, str) and _fits(each, holds[1]) for name, each in value.items()
        )
    if holds:  # a union
        return any(_fits(value, each) for each in holds)
    if isinstance(value, kind) and is_dataclass(value):
        types: Any = type(value)
        return all(_fits(getattr(value, name), each) for name, each in _types_of(types).items())
    return isinstance(value, kind)


def _in_words(kind: Any) -> str:
    """Return the type of a field: `a dict of names and Command objects`."""
    if get_origin(kind) is not Mapping:
        return {int: "a whole number", str: "text"}[kind]
    each = get_args(kind)[1]
    return "a dict of names and " + ('"module:name"' if each is str else f"{each.__name__} objects")


def require_class(part: Any, *contracts: type) -> None:
    """Require that a part is a class that extends one of some contracts and has the methods that they say.

    Raises ContractError for the first method that is missing or takes other arguments.
    """
    names = [contract.__name__ for contract in contracts]
    if not isinstance(part, type):
        raise ContractError(f"it is a {type(part).__name__}; name a class that extends {' or '.join(names)}")
    if not issubclass(part, contracts):
        kinds = f"neither a {' nor a '.join(names)}" if len(names) > 1 else f"not a {names[0]}"
        raise ContractError(f"it is {kinds}; write class {part.__name__}({names[0]})")
    lacking = getattr(part, "__abstractmethods__", frozenset[str]())
    members = _members(part.__mro__[1:])
    if all(not getattr(ours, "__isabstractmethod__", False) for _, ours in members.values()):
        _require_spelling(part, members)
    for name, (contract, ours) in members.items():
        if name in lacking:
            raise ContractError(f"it lacks {_call(name, ours)}; add it as {contract.__name__} describes it")
        theirs = inspect.getattr_static(part, name)
        if theirs is not ours:
            _require_arguments(name, theirs, ours)


def _require_spelling(part: type, known: Collection[str]) -> None:
    """Require that no method has nearly the name of one that a class may override: it would not be called."""
    own = [name for name, value in vars(part).items() if name not in known and inspect.isfunction(value)]
    for name in own:
        if close := get_close_matches(name, known, 1, 0.88):
            raise ContractError(f"it has no {close[0]}, but {name}; correct the name, or take one less alike")


def require_function(part: Any, name: str, contract: Any) -> None:
    """Require that a part is a function with the arguments of a contract's method, `self` left out.

    name  what messages call it

    Raises ContractError.
    """
    if not callable(part):
        raise ContractError(
            f"its {name} is a {type(part).__name__}, not a function; write def {_call(name, contract)}"
        )
    _require_arguments(name, staticmethod(part), contract)


def _members(classes: Iterable[type]) -> dict[str, tuple[type, Any]]:
    """Return methods and properties of contracts among classes, by name, each with its contract."""
    members: dict[str, tuple[type, Any]] = {}
    for each in classes:
        for name, value in vars(each).items() if each.__module__.startswith(OURS) else ():
            is_method = isinstance(value, property) or _arguments(value) is not None
            if is_method and (not name.startswith("_") or getattr(value, "__isabstractmethod__", False)):
                members.setdefault(name, (each, value))
    return members


def _require_arguments(name: str, theirs: Any, ours: Any) -> None:
    """Require that a method takes the arguments that the method of its contract gets."""
    expected, taken = _arguments(ours), _arguments(theirs)
    if expected is None or (taken is None and callable(theirs)):
        return  # a property, or compiled
    if taken is None:
        raise ContractError(f"its {name} is not a method; write def {_call(name, ours)}")
    kinds = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    given = [each for each in expected if each.kind in kinds]
    least = [each for each in given if each.default is Parameter.empty]
    for call in (least, given):
        try:
            Signature(taken).bind(*call)
        except TypeError:
            takes = ", ".join(str(each.replace(annotation=Parameter.empty)) for each in taken)
            raise ContractError(
                f"its {name} takes ({takes}) and is called as {_call(name, ours)}; take these arguments"
            ) from None


def _arguments(method: Any) -> list[Parameter] | None:
    """Return the parameters of a method without `self` or `cls`; None for what is not a method."""
    function = method.__func__ if isinstance(method, classmethod | staticmethod) else method
    if not inspect.isfunction(function) and not inspect.ismethod(function):
        return None
    parameters = list(inspect.signature(function).parameters.values())
    return parameters[0 if isinstance(method, staticmethod) or inspect.ismethod(method) else 1 :]


def _call(name: str, method: Any) -> str:
    arguments = _arguments(method)
    return name if arguments is None else f"{name}({', '.join(each.name for each in arguments)})"


API = 2
"""The version of the contract with plug-ins: names of `flowsculpt.api`, fields of `Plugin`, methods of parts.

It is raised when one of them goes away, or takes or returns something else; not when one is added. A plug-in
says in `api` which version it is built for. Built for a later one, or for one before OLDEST_API, it is left
out, as is a plug-in that uses a field that is gone.
"""

OLDEST_API = 1
"""The oldest version whose plug-ins work, as long as they use no field that has gone since."""

GONE = {
    "layouts": "subjects, which takes layouts of copies too",
    "documents": 'entries={"NAME": ShotEntry("module:Model")}',
    "stages": 'entries={"NAME": ShotEntry("module:Model", PictureStage(…))}',
    "exporters": 'commands={"export NAME": Command(…)}',
    **dict.fromkeys(
        ("watchers", "summaries", "delivered"),
        'observer="module:Class", with a class that extends RunObserver',
    ),
    **dict.fromkeys(
        ("sequences", "animations", "notes", "unneeded", "schemas"),
        'extras="module:Class", with a class that extends ShotExtras',
    ),
    "mesh_formats": 'formats={"SUFFIX": FileFormat(surface="module:READER")}',
    "paints": 'formats={"SUFFIX": FileFormat(paint="module:READER")}, with the surface of that suffix',
    "edits": 'formats={"SUFFIX": FileFormat(edit="module:function")}',
}
"""What plug-ins write in place of fields that went with version 2."""


def fault_of_version(api: Any) -> str | None:
    """Return why a plug-in built for a version of the API cannot be used; None where it can."""
    if not isinstance(api, int):
        return "its field api is not a whole number"
    if api > API:
        return f"it is built for version {api} of the API, and this flowsculpt has {API}; update flowsculpt"
    if api < OLDEST_API:
        return (
            f"it is built for version {api} of the API, and this flowsculpt takes {OLDEST_API} to {API}; "
            "install a newer version of the plug-in"
        )
    return None


def fault_of_fields(given: Iterable[str], known: Collection[str]) -> str | None:
    """Return why fields that a plug-in has been given are unknown; None where all are known."""
    for name in given:
        if name in GONE:
            return f"its field {name} is gone since version 2 of the API; write {GONE[name]}"
        if name not in known:
            return f"Plugin has no field {name}; correct it, or update flowsculpt if a later one has it"
    return None
