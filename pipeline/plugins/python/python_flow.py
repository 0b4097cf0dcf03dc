"""Functions of Python files as flows; they open only the files that their shot names, which decide keys."""

from __future__ import annotations

import hashlib
import os
import site
import sys
import threading
import traceback
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from flowsculpt import Flow, FrameError, UsageError
from flowsculpt.api.files import InputFile
from flowsculpt.api.meshes import Floats

Displacement = Callable[[Floats, float, float], Floats]

_CODE = (".py", ".pyc", ".so", ".nbi", ".nbc", ".kernel", ".pth")
"""Modules, and what caches compile from them; keys do not hold imports."""

_current = threading.local()


@contextmanager
def only_declared(flow: Path, files: Collection[Path]) -> Iterator[None]:
    """Let this thread read no data but those files while it runs the code of a flow.

    Opening another one raises a FrameError that names it. Files of Python, of packages and of the system may
    be read.
    """
    _watch()
    before = getattr(_current, "allowed", None)
    _current.allowed = flow, {os.path.realpath(file) for file in files}
    try:
        yield
    finally:
        _current.allowed = before


@cache
def _watch() -> None:
    sys.addaudithook(_check)


@cache
def _system() -> tuple[str, ...]:
    python = (sys.prefix, sys.base_prefix, site.getusersitepackages())
    return (
        *(f"{folder}/" for folder in {*python, *map(os.path.realpath, python)}),
        "/proc/",
        "/sys/",
        "/dev/",
        "/etc/",
        "/usr/",
        "/lib/",
    )


def _check(event: str, arguments: tuple[Any, ...]) -> None:
    if event != "open" or getattr(_current, "allowed", None) is None:
        return
    name, mode, flags = arguments
    writes = set(mode) & set("wax") if isinstance(mode, str) else flags & (os.O_WRONLY | os.O_RDWR)
    if writes or not isinstance(name, str | bytes | os.PathLike):
        return
    flow, files = _current.allowed
    path = os.path.realpath(os.fsdecode(name))
    if path in files or path.endswith(_CODE) or path.startswith(_system()) or not Path(path).is_file():
        return
    raise FrameError(
        f"{flow}: it opens {path}, which its shot does not name: changes to it would not update frames. "
        f"Write reads: [{Path(path).name}], with its folder, beside function."
    )


@dataclass(frozen=True)
class PythonFlow(Flow):
    """A function `points, time, dt -> points` of a Python file, run only with permission.

    digest   SHA-256 of the file, for keys; the modules it imports do not count
    allowed  True if the file may run; otherwise every step fails
    reads    digests of the `files` that it may open
    """

    runs_code = True

    function: str
    digest: str
    path: Path = field(default=Path(), compare=False)
    allowed: bool = field(default=False, compare=False)
    reads: tuple[str, ...] = ()
    files: tuple[Path, ...] = field(default=(), compare=False)

    @property
    def name(self) -> str:
        return f"{self.function} of {self.path}"

    def require_permission(self) -> None:
        """Raise UsageError where the file may not run."""
        if not self.allowed:
            raise UsageError(
                f"{self.path}: the shot would run this Python file, which can do anything you can; "
                "that needs permission. Read the file, then add --allow-code "
                "(for snakemake, --config allow_code=true)."
            )

    def displace(self, points: Floats, time: float, dt: float) -> Floats:
        self.require_permission()
        with only_declared(self.path, self.files):
            function = _function(self.path, self.digest, self.function)
            try:
                return function(np.array(points, np.float64), time, dt)
            except FrameError:
                raise
            except (Exception, SystemExit) as error:
                fact = f"{self.function} raised {_described(error, self.path)} at {time:g} s"
                rule = "a flow takes points (N, 3), time and dt and returns points (N, 3)"
                raise FrameError(f"{self.path}: {fact}; {rule}. Call it alone with these.") from error

    def cache_data(self, time: float, dt: float) -> Any:
        reads = {"reads": self.reads} if self.reads else {}
        return {"python": self.digest, "function": self.function, "time": time, "dt": dt, **reads}

    def findings(self) -> Iterator[tuple[str, bool]]:
        text = (
            f"flow {self.name} runs in Python; if that is too slow, write it as a formula, which is compiled "
            "and runs on all cores, or decorate the function with numba.njit(cache=True)."
        )
        yield text, False


MOST_CODE = 4 << 20  # size of the largest Python file


def _function(path: Path, digest: str, name: str) -> Displacement:
    """Return a function of a file with that digest. Raises FrameError."""
    function: Displacement | None = getattr(_module(path, digest), name, None)
    if not callable(function):
        raise FrameError(f"{path}: it does not define function {name}; correct the name in the shot")
    return function


@lru_cache(maxsize=64)
def _module(path: Path, digest: str) -> ModuleType:
    """Run a file as a module in sys.modules, where dataclasses look up their own."""
    source = InputFile(path, MOST_CODE).content()
    if hashlib.sha256(source).hexdigest() != digest:
        raise FrameError(f"{path}: it was changed since the work was planned; run again")
    module = ModuleType(f"flowsculpt_flow_{digest}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module
    try:
        exec(compile(source, str(path), "exec", dont_inherit=True), vars(module))
    except BaseException as error:
        sys.modules.pop(module.__name__, None)  # or another thread has
        if not isinstance(error, Exception | SystemExit):
            raise
        raise FrameError(
            f"{path}: running it raised {_described(error, path)}; a flow's file defines functions"
        ) from error
    return module


def _described(error: BaseException, path: Path) -> str:
    """Return an exception's text with the last line of the file that it passed."""
    lines = [
        frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)
    ]
    if isinstance(error, SyntaxError):
        lines = [error.lineno]
    text = " ".join(str(error.msg if isinstance(error, SyntaxError) else error).split())
    at = f" (line {lines[-1]})" if lines else ""
    return f"{type(error).__name__}: {text}{at}"
