"""Shapes that flow like putty: the library's public names, each imported from its module when first used.

    from flowsculpt import Resampler, Thresholds, icosphere

`__init__.pyi` lists them. Everything else lies in the packages `flowsculpt.pipeline` and `flowsculpt.render`,
and may change with any version.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from typing import Any

_HERE = os.path.dirname(os.path.abspath(__file__))  # noqa: PTH100, PTH120  # a Path takes time to import
if not os.path.exists(os.path.join(_HERE, "render", "__init__.py")):  # noqa: PTH110, PTH118
    __path__.append(os.path.dirname(_HERE))  # noqa: PTH120  # in a checkout they lie beside this folder

_PLUGINS = "flowsculpt.pipeline.plugins."


def lazy_names(module: str, file: str) -> tuple[list[str], Callable[[str], Any]]:
    """Return the names in the stub of a module, and the `__getattr__` that imports each when it is used.

    Type checkers and editors read the stub too. Its lines are ``from MODULE import NAME as NAME``. Where a
    plug-in that holds a name is missing, ImportError says so.
    """
    with open(f"{file}i", encoding="utf-8") as stub:  # noqa: PTH123
        imports = [line.split() for line in stub if line.startswith("from ")]
    modules = {name: module for _, module, _, name, *_ in imports}

    def imported(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        home = modules[name]
        try:
            return getattr(import_module(home), name)
        except ModuleNotFoundError as error:
            plugin = home.removeprefix(_PLUGINS).partition(".")[0]
            if error.name not in (_PLUGINS + plugin, home):
                raise
            raise ImportError(
                f"{module}.{name} needs the plug-in {plugin}, which is not installed", name=module
            ) from None

    return sorted(modules), imported


__all__, __getattr__ = lazy_names(__name__, __file__)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
