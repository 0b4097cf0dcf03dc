"""Shapes that flow like putty: the library's public names, each imported from its module when first used.

    from flowsculpt import Resampler, Thresholds, icosphere

`__init__.pyi` lists them, for type checkers and for this file. Everything else lies in the packages
`flowsculpt.pipeline` and `flowsculpt.render`, and may change with any version.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import Any

_HERE = os.path.dirname(os.path.abspath(__file__))  # noqa: PTH100, PTH120  # a Path takes time to import
if not os.path.exists(os.path.join(_HERE, "render", "__init__.py")):  # noqa: PTH110, PTH118
    __path__.append(os.path.dirname(_HERE))  # noqa: PTH120  # in a checkout they lie beside this folder


def _modules() -> dict[str, str]:
    """Return the module of each public name: lines of `__init__.pyi` read ``from MODULE import N as N``."""
    with open(os.path.join(_HERE, "__init__.pyi"), encoding="utf-8") as stub:  # noqa: PTH118, PTH123
        imports = [line.split() for line in stub if line.startswith("from ")]
    return {name: module for _, module, _, name, *_ in imports}


_MODULE_OF = _modules()

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
