"""Where compiled kernels live, and the decorator that makes one.

numba's on-disk cache does not notice edits in functions that a kernel calls from another file, so
the cache folder is named by a hash of every kernel source. A new source means a new folder and one
compilation (`flowsculpt doctor --compile`, done at set-up); nothing else ever compiles.
"""

from __future__ import annotations

import hashlib
import importlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs

F = TypeVar("F", bound=Callable[..., Any])

_PACKAGE = Path(__file__).parent


def kernel_modules() -> list[str]:
    """The dotted names of all modules that hold kernels: those called `_kernels` or `_kernels_…`."""
    files = sorted(_PACKAGE.rglob("_kernels*.py"))
    return [".".join(("pipeline", *f.relative_to(_PACKAGE).with_suffix("").parts)) for f in files]


@cache
def cache_folder() -> Path:
    """The folder of this version of the sources, under the user's cache or, unwritable, the temporary folder."""
    digest = hashlib.sha256(numba.__version__.encode())
    for file in (Path(__file__), *sorted(_PACKAGE.rglob("_kernels*.py"))):
        digest.update(file.read_bytes())
    name = digest.hexdigest()[:16]
    for base in (platformdirs.user_cache_path("flowsculpt"), Path(tempfile.gettempdir()) / "flowsculpt-cache"):
        folder = base / "kernels" / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="flowsculpt-kernels-"))


def kernel(signature: Any = None, **options: Any) -> Callable[[F], F]:
    """`numba.njit` with our cache folder: ``@kernel()``, or with types so that it compiles on import."""
    numba.config.CACHE_DIR = str(cache_folder())

    def decorate(function: F) -> F:
        compiled = numba.njit(signature, cache=True, **options) if signature else numba.njit(cache=True, **options)
        return compiled(function)  # type: ignore[no-any-return]

    return decorate


def compile_all() -> list[str]:
    """Import every kernel module, which compiles what declares its types; returns their names."""
    names = kernel_modules()
    for name in names:
        importlib.import_module(name)
    return names
