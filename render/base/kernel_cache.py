"""The cache of compiled kernels, and the decorator that compiles the kernels of pictures.

numba files a compiled function under the path and time of its source, and does not notice an edit in a
function that it calls from another file. `KernelCache` files it under the name of its module and a digest of
every source that the module imports: an edit compiles the kernels that depend on it and no others, and all
checkouts and machines with the same sources may share what one of them has compiled.

So that machines can share, kernels are compiled for a named level of x86-64, not for the very processor. No
kernel whose results are kept lets the compiler contract or reorder operations, so levels differ in speed
alone.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import pickle
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, wraps
from pathlib import Path
from typing import IO, Any, NamedTuple, TypeVar

import llvmlite
import llvmlite.binding
import numba
from numba.core.caching import Cache
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.serialize import dumps

from flowsculpt import render
from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.python_process import is_own
from flowsculpt.render.base.remaining_kernels import is_in_background
from flowsculpt.render.base.render_errors import MachineError
from flowsculpt.render.base.user_cache import kernel_homes, readable_cache, writable_cache

F = TypeVar("F", bound=Callable[..., Any])

SOURCES = Path(render.__file__).absolute().parents[1]
"""The folder that holds the packages `pipeline` and `render`."""

LEVEL = "FLOWSCULPT_CPU"
"""The environment variable that names what kernels are compiled for: one of LEVELS, or HOST."""

HOST = "host"
"""Compile for the processor of this machine, as where it lacks what a level asks for."""

_V3 = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")

LEVELS = {
    "x86-64-v3": _V3,
    "x86-64-v4": (*_V3, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"),
}
"""Levels of x86-64, by default the first, and the features that a processor needs for them, in LLVM's words.
Source: https://gitlab.com/x86-psABIs/x86-64-ABI"""

_IMPORT = re.compile(
    r"^(?:from (?P<of>flowsculpt\b[\w.]*) import (?P<names>\([^)]*\)|.+)"
    r"|import (?P<module>flowsculpt\b[\w.]*))",
    re.M,
)

DECORATORS = ("kernel", "block_kernel", "higher_kernel", "compiled", "exact", "fast")
"""The names of decorators that make kernels."""

_KERNEL = re.compile(rf"^@({'|'.join(DECORATORS)})\b", re.M)

_DIGEST_BYTES = 32


def compiled(**options: Any) -> Callable[[F], F]:
    """Return `numba.njit` with our cache, without the interpreter's lock and its errors of division."""

    def decorate(function: F) -> F:
        return cached_kernel(function, error_model="numpy", **options)

    return decorate


def cached_kernel(function: F, **options: Any) -> F:
    """Return the dispatcher of `numba.njit` of a function, with our cache and without the interpreter's lock.

    Raises MachineError where numba is kept from compiling.
    """
    use_kernel_cache()
    # Nobody takes the address of a kernel: the wrapper for that is a tenth of the time of compiling.
    dispatcher: Any = numba.njit(nogil=True, no_cfunc_wrapper=True, **options)(function)
    dispatcher._cache = KernelCache(function)
    dispatcher.compile = release_after(dispatcher.compile)
    return dispatcher


DECLARED: list[tuple[Any, Any]] = []
"""Every kernel of the pipeline that is imported so far, and the types it is compiled for."""

BLOCK_KERNELS: list[Any] = []
"""Every `BlockKernel` that is imported so far, without the formulas of shots."""

_starting = threading.Lock()


def _renew_lock() -> None:
    """Let a fork begin with a free lock, since a thread that holds it is not in the fork."""
    global _starting
    _starting = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_lock)


def one_at_a_time(function: F) -> F:
    """Have one thread at a time call a kernel that starts threads.

    Where numba finds no OpenMP, two such kernels at once end the process.
    """

    @wraps(function)
    def call(*arguments: Any) -> Any:
        with _starting:
            return function(*arguments)

    return call  # type: ignore[return-value]


def use_kernel_cache() -> None:
    """Have numba compile for `cpu_level`; called before it makes its compiler.

    Raises MachineError where numba is kept from compiling. Other settings of numba are those of a process of
    our own: caches of a user's functions lie in our folder too. The environment of another program may name a
    layer of threads that is not installed: the best that numba can load starts threads here, or `workqueue`,
    which it always has.
    """
    if numba.config.DISABLE_JIT:
        raise MachineError("NUMBA_DISABLE_JIT is set, but flowsculpt needs compiled kernels; unset it")
    if cpu_level() != HOST:
        numba.config.CPU_NAME, numba.config.CPU_FEATURES = cpu_level(), ""
    if not is_own():
        return
    numba.config._config_fname = ""  # see `python_process`; numba looks again when it compiles
    if numba.config.THREADING_LAYER != "workqueue":
        numba.config.THREADING_LAYER = "default"
    numba.config.THREADING_LAYER_PRIORITY = ["tbb", "omp", "workqueue"]
    numba.config.CACHE_DIR = str(_written_folder())
    Cache._guard_against_spurious_io_errors = lambda self: suppress(OSError)  # a full disk stores none


@cache
def cpu_level() -> str:
    """Return the level of x86-64 that kernels are compiled for, or HOST where this processor lacks it.

    Raises MachineError where FLOWSCULPT_CPU names none.
    """
    named = os.environ.get(LEVEL) or next(iter(LEVELS))
    if named not in (*LEVELS, HOST):
        raise MachineError(f"{LEVEL}={named}: unknown level; set it to {', '.join(LEVELS)} or {HOST}")
    if named == HOST or "NUMBA_CPU_NAME" in os.environ or not numba.config.ENABLE_AVX:
        return HOST
    features: dict[str, bool] = {}
    with suppress(RuntimeError):  # of processors that LLVM cannot ask
        features = llvmlite.binding.get_host_cpu_features()
    return named if all(features.get(feature) for feature in LEVELS[named]) else HOST


class KernelCache(Cache):  # type: ignore[misc]  # numba has no types
    """The compiled files of one kernel: one for each of its types, with the digest of its content.

    Files are pickles, which run as code: they are read from folders that nobody else may write to. A damaged
    file counts as none. Of processes that lack the same one at once, one compiles and the others wait.
    """

    inner: frozenset[tuple[str, str]] = frozenset()
    """Kernels that only kernels call, by module and name, in a process that does nothing but compile: their
    files hold what callers link in, no machine code, and no other process reads them."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._py_func = function

    @property
    def cache_path(self) -> str:
        """The folder that new files of the kernel go to."""
        return str(_written_folder() / _folder_of(inspect.getfile(self._py_func)))

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return the compiled function for a signature, or None where no folder holds a whole one.

        Then numba compiles it and calls `save_overload`; others wait until that ends (`release_after`).
        """
        target.refresh()
        with suppress(OSError):  # of a source that was removed
            place = self._place(signature, target.codegen())
            content = _stored_content(place)
            if content is None:
                reserve_kernel(place)
                content = _stored_content(place)  # by another process
            if content is not None:
                return CompileResult._rebuild(target, *pickle.loads(content))
        return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """File a compiled function; a disk that refuses it costs only time."""
        if result.library.has_dynamic_globals:
            return
        with suppress(OSError, MachineError):
            place = self._place(signature, result.codegen)
            if place.suffix == ".kernel":  # so that machine code is filed, not what is yet to be optimised
                result.library.get_pointer_to_function(result.fndesc.llvm_func_name)
            content = dumps(result._reduce())
            with atomic_write(_written_folder() / place, flush=False) as draft:
                draft.write_bytes(hashlib.sha256(content).digest() + content)

    def is_stored(self, signature: Any, target: Any) -> bool:
        """Tell whether a folder holds a file for a signature. Raises OSError where there is no source."""
        place = self._place(signature, target.codegen())
        return any((folder / place).is_file() for folder in kernel_folders())

    def flush(self) -> None:
        """Forget nothing: the names of files hold all that they depend on."""

    def _place(self, signature: Any, codegen: Any) -> Path:
        """Return the file of a signature, relative to a folder of kernels. Raises OSError."""
        key = repr(self._index_key(signature, codegen))  # with the processor, and a digest of the function
        name = re.sub(r"\W", "", self._py_func.__name__)
        kind = "inner" if (self._py_func.__module__, self._py_func.__name__) in self.inner else "kernel"
        file = f"{name}-{hashlib.sha256(key.encode()).hexdigest()[:24]}.{kind}"
        return Path(_folder_of(inspect.getfile(self._py_func)), file)


class _Reserved(NamedTuple):
    """A kernel that this process compiles, since when, and the open file whose lock others wait for."""

    place: Path
    began: float
    lock: IO[bytes] | None


_reserved: list[_Reserved] = []
"""The kernels that this process compiles now: each is called by the one before it."""

_compiled_seconds = 0.0

MOST_WAITING = 120.0
"""Seconds after which a process no longer waits for another, but compiles itself."""


def reserve_kernel(place: Path) -> None:
    """Have other processes wait until this one has compiled a kernel; wait for one that does so already.

    Nobody waits for a process in the background, whose priority is the lowest: who needs its kernel at once
    compiles it too. Nothing but time depends on it: without locks, as on some network file systems, several
    compile it.
    """
    began, lock = time.monotonic(), None
    with suppress(OSError, MachineError, ImportError):  # Windows has no fcntl
        import fcntl

        path = _lock_of(place)
        path.parent.mkdir(exist_ok=True)
        lock = path.open("ab")
        while time.monotonic() < began + MOST_WAITING:
            with suppress(BlockingIOError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            time.sleep(0.02)
        if is_in_background():
            path.unlink(missing_ok=True)
            lock.close()
            lock = None
    _reserved.append(_Reserved(place, began, lock))


def release_after(function: F) -> F:
    """Return a function that compiles; when it ends or fails, the kernels that it reserved are released."""

    @wraps(function)
    def call(*arguments: Any) -> Any:
        with global_compiler_lock:
            before = len(_reserved)
            try:
                return function(*arguments)
            finally:
                _release_kernels(before)

    return call  # type: ignore[return-value]


def _release_kernels(kept: int) -> None:
    """End what `reserve_kernel` has begun, except for the first `kept` of them."""
    global _compiled_seconds
    while len(_reserved) > kept:
        ended, began, lock = _reserved.pop()
        if lock is not None:
            with suppress(OSError, MachineError):
                _lock_of(ended).unlink(missing_ok=True)
            lock.close()
        if not _reserved:
            _compiled_seconds += time.monotonic() - began


def compiled_seconds() -> float:
    """Return the seconds in which this process has compiled kernels, or waited for one that did."""
    return _compiled_seconds


def _lock_of(place: Path) -> Path:
    return _written_folder() / f"{place}.lock"


def _stored_content(place: Path) -> bytes | None:
    """Return the first whole file of that place in the folders of kernels."""
    return next(filter(None, (_whole_content(folder / place) for folder in kernel_folders())), None)


def _whole_content(file: Path) -> bytes | None:
    """Return what `save_overload` wrote to a file, or None where there is none or it is damaged."""
    try:
        data = file.read_bytes()
    except OSError:
        return None
    digest, content = data[:_DIGEST_BYTES], data[_DIGEST_BYTES:]
    return content if hashlib.sha256(content).digest() == digest else None


@cache
def _folder_of(source: str) -> str:
    """Return the name of the folder of a source's kernels. Raises OSError where it cannot be read."""
    file = Path(source).absolute()
    if file.is_relative_to(SOURCES):
        return f"{module_of(file)}-{source_digest(file)[:16]}"
    return f"{file.stem}-{hashlib.sha256(file.read_bytes()).hexdigest()[:16]}"  # of a formula


def kernel_modules(package: str) -> list[str]:
    """Return the dotted names of all modules of a package that hold kernels, told by their decorators."""
    sources = sorted((SOURCES / package).rglob("*.py"))
    return [module_of(file) for file in sources if _KERNEL.search(file.read_text(encoding="utf-8"))]


@cache
def all_kernels() -> tuple[str, ...]:
    """Return the names of the folders of all kernels, which hold a digest of their sources."""
    modules = [*kernel_modules("pipeline"), *kernel_modules("render")]
    return tuple(_folder_of(str(source_of(module))) for module in modules)


def imported_modules(module: str) -> set[str]:
    """Return the dotted names of all modules of ours that a module imports itself."""
    text = source_of(module).read_text(encoding="utf-8")
    return {module_of(imported) for imported in _imported_files(text)}


def source_of(module: str) -> Path:
    """Return the file of a module such as `flowsculpt.render.base.user_cache`."""
    return SOURCES.joinpath(*module.split(".")[1:]).with_suffix(".py")


def module_of(file: Path) -> str:
    """Return the dotted name of a module below `SOURCES`."""
    return ".".join(["flowsculpt", *file.relative_to(SOURCES).with_suffix("").parts])


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
            file = source_of(name)
            if file.is_file():
                yield file


def kernel_folders() -> tuple[Path, ...]:
    """Return the folders that hold compiled kernels for this machine: of the user, and shipped ones."""
    return tuple(dict.fromkeys(home / folder_name() for home in kernel_homes()))


@cache
def folder_name() -> str:
    """Return the name of a folder of kernels: all that decides whether they run here, but their sources."""
    vectors = "-svml" if numba.config.USING_SVML else ""
    versions = f"numba-{numba.__version__}-llvmlite-{llvmlite.__version__}{vectors}"
    return f"{versions}-{sys.implementation.cache_tag}-{cpu_level()}"


@cache
def cache_folder() -> Path:
    """Return the folder of compiled kernels, which may be one that is only read."""
    shared = readable_cache() / "kernels" / folder_name()
    return shared if shared.is_dir() else _written_folder()


def formula_folder() -> Path:
    """Return the folder of the sources of compiled formulas, and create it."""
    folder = _written_folder() / "formulas"
    folder.mkdir(exist_ok=True)
    return folder


def _written_folder() -> Path:
    folder = writable_cache() / "kernels" / folder_name()
    folder.mkdir(parents=True, exist_ok=True)
    return folder
