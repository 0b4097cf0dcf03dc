"""The cache of compiled kernels, and the decorator that compiles the kernels of pictures.

numba files a compiled function under the path of its source, and does not notice an edit in a function that
it calls from another file. `KernelCacheLocator` files it under the name of its module and a digest of every
source that the module imports: an edit compiles the kernels that depend on it and no others, and two
checkouts of the same sources share one cache.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import Cache, UserProvidedCacheLocator

import render
from render.base.errors import MachineError
from render.base.user_cache import readable_cache, writable_cache

F = TypeVar("F", bound=Callable[..., Any])

SOURCES = Path(render.__file__).absolute().parents[1]
"""The folder of the packages `pipeline` and `render`; where they are installed, it holds others too."""

_IMPORT = re.compile(
    r"^(?:from (?P<of>(?:pipeline|render)\b[\w.]*) import (?P<names>\([^)]*\)|.+)"
    r"|import (?P<module>(?:pipeline|render)\b[\w.]*))",
    re.M,
)

_FOLDER = Path("kernels", f"numba-{numba.__version__}" + ("-svml" if numba.config.USING_SVML else ""))
"""The folder of compiled kernels in a cache."""

_KERNEL = re.compile(r"^@(kernel|block_kernel|higher_kernel|compiled|exact|fast)\b", re.M)


def compiled(**options: Any) -> Callable[[F], F]:
    """Return `numba.njit` with our cache, without the interpreter's lock and its errors of division."""

    def decorate(function: F) -> F:
        use_kernel_cache()
        return numba.njit(cache=True, nogil=True, error_model="numpy", **options)(function)

    return decorate


def use_kernel_cache() -> None:
    """Have numba file what it compiles from now on in `cache_folder`, as `KernelCacheLocator` says.

    Raises MachineError where numba is kept from compiling.
    """
    numba.config._config_fname = ""  # see `import_numba_elsewhere`; numba looks again when it compiles
    if numba.config.DISABLE_JIT:
        raise MachineError("NUMBA_DISABLE_JIT is set, and flowsculpt runs compiled kernels; unset it")
    numba.config.CACHE_DIR = str(cache_folder())
    numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{KernelCacheLocator.__name__}"
    Cache._guard_against_spurious_io_errors = lambda self: suppress(OSError)  # a full disk stores none


class KernelCacheLocator(UserProvidedCacheLocator):  # type: ignore[misc]  # numba has no types
    """Names the folder of a kernel's compiled code: its module, and a digest of all sources it depends on."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        file = Path(py_file).absolute()
        if not file.is_relative_to(SOURCES):  # a formula's, which lies in the cache already
            return str(file.parents[1] / UserProvidedCacheLocator.get_suitable_cache_subpath(py_file))
        name = f"{_module_of(file)}-{source_digest(file)[:16]}"
        is_there = os.access(cache_folder(), os.W_OK) or (cache_folder() / name).is_dir()
        return name if is_there else str(_written_folder() / name)

    def ensure_cache_path(self) -> None:
        """Create the folder where that can be done; numba reads one that it cannot write."""
        with suppress(OSError):
            super().ensure_cache_path()


def kernel_modules(package: str) -> list[str]:
    """Return the dotted names of all modules of a package that hold kernels, told by their decorators."""
    sources = sorted((SOURCES / package).rglob("*.py"))
    return [_module_of(file) for file in sources if _KERNEL.search(file.read_text(encoding="utf-8"))]


def imported_modules(module: str) -> set[str]:
    """Return the dotted names of all modules of ours that a module imports itself."""
    file = SOURCES.joinpath(*module.split(".")).with_suffix(".py")
    return {_module_of(imported) for imported in _imported_files(file.read_text(encoding="utf-8"))}


def _module_of(file: Path) -> str:
    """Return the dotted name of a module below `SOURCES`."""
    return ".".join(file.relative_to(SOURCES).with_suffix("").parts)


@cache
def source_digest(file: Path) -> str:
    """Return the SHA-256 of a module and of every module of ours that it imports, directly or not."""
    text = file.read_text(encoding="utf-8")
    digest = hashlib.sha256(text.encode())
    for imported in sorted(_imported_files(text)):
        digest.update(source_digest(imported).encode())
    return digest.hexdigest()


def _imported_files(text: str) -> Iterator[Path]:
    """Yield the files of our modules that a source imports at its top."""
    for match in _IMPORT.finditer(text):
        names = [match["module"]] if match["module"] else [match["of"]]
        if match["names"]:
            imported = re.sub(r"#.*|[()]", "", match["names"]).split(",")
            names += [f"{match['of']}.{name.split()[0]}" for name in imported if name.split()]
        for name in names:
            file = SOURCES.joinpath(*name.split(".")).with_suffix(".py")
            if file.is_file():
                yield file


@cache
def cache_folder() -> Path:
    """Return the folder of compiled kernels, which may be one that is only read."""
    shared = readable_cache() / _FOLDER
    return shared if shared.is_dir() else _written_folder()


def formula_folder() -> Path:
    """Return the folder of the sources of compiled formulas, and create it."""
    folder = _written_folder() / "formulas"
    folder.mkdir(exist_ok=True)
    return folder


def _written_folder() -> Path:
    folder = writable_cache() / _FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    return folder
