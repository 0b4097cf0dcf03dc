"""The interface of flows, mappings of points during a step of time; and Python functions as flows.

A Python flow opens only the files that its shot names, for their contents decide keys.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
import site
import sys
import threading
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.flow.parameters import Vector
from flowsculpt.render.base.input_files import InputFile

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


Displacement = Callable[[Points, float, float], Points]
"""Any callable `points, time, dt -> points` (P1)."""


class Flow(ABC):
    """A mapping of points into points, as it acts during a step of time.

    A flow is a value: pure, without memory, and it neither knows nor cares whether the points are
    particles, control points or the vertices of a mesh (P4).
    """

    @abstractmethod
    def displace(self, points: Points, time: float, dt: float) -> Points:
        """Return the positions of points (N, 3) `dt` seconds after `time`.

        `time` counts seconds from the start of the shot. The given points are not changed. `dt` may be
        negative: the flow then runs backwards.
        """

    @abstractmethod
    def cache_data(self, time: float, dt: float) -> Any:
        """Return all that decides `displace` over this step, JSON-able: equal data, equal motion."""

    def steps(self, time: float, dt: float) -> Iterator[FlowStep]:
        """Yield the flows that act one after another within this step: `displace` is all of them in order."""
        yield FlowStep(self, time, dt)

    @property
    def members(self) -> tuple[Flow, ...]:
        """The flows that act one after another: those of a sequence, else this one alone."""
        return (self,)

    @property
    def plugin_flow(self) -> Flow:
        """The flow as its plug-in made it, without what the core wraps around it."""
        return self

    def with_max_step(self, max_step: float) -> Flow:
        """Return the flow with no sub-step along velocities longer than `max_step` units."""
        return self

    def of_subject(self, subject: Any, place: Vector, before: Sequence[Flow]) -> Flow:
        """Return the flow as it acts on a subject that stands at a place, after flows `before` it.

        Only flows of a list of flows are asked; compositions refuse flows that define this.
        """
        return self

    def findings(self) -> Iterator[tuple[str, bool]]:
        """Yield what to know of the flow before frames are made, and whether that is a warning.

        By default that of the flows in it. Raises FlowsculptError where the frames would fail.
        """
        for name in getattr(self, "__dataclass_fields__", ()):
            value = getattr(self, name)
            for part in value if isinstance(value, tuple) else (value,):
                if isinstance(part, Flow):
                    yield from part.findings()

    def facts(self, time: float) -> Mapping[str, Any]:
        """Return what the headers of frames at `time` say of the flow, JSON-able; by default nothing."""
        return {}

    @property
    def faces_follow_normals(self) -> bool:
        """True where the resampler lets no face look against the normals that the flow carries.

        Other flows may make a surface thinner than its edges are long, where some faces must.
        """
        return False

    @property
    def rest_interval(self) -> int | None:
        """Frames after which the present surface becomes the one at rest, where the shot names none.

        None leaves it to `Resampling`. A flow that stretches a surface tenfold stretches errors at rest too.
        """
        return None

    @property
    def name(self) -> str:
        """The name in error messages."""
        return type(self).__name__.lower()


class FlowStep(NamedTuple):
    """A flow that acts from `time` on, for `dt` seconds."""

    flow: Flow
    time: float
    dt: float


@dataclass(frozen=True)
class Function(Flow):
    """Any Python callable `points, time, dt -> points` as a flow (P1). It may write over its points."""

    displacement: Displacement

    def displace(self, points: Points, time: float, dt: float) -> Points:
        return self.displacement(points.copy(), time, dt)

    def cache_data(self, time: float, dt: float) -> Any:
        return {"function": self.name, "time": time, "dt": dt}

    @property
    def name(self) -> str:
        return getattr(self.displacement, "__qualname__", type(self.displacement).__name__)


@dataclass(frozen=True)
class PluginMap(Flow):
    """A map of a plug-in.

    origin  the plug-in, its version and the map's name, which are part of what decides it
    """

    flow: Flow
    origin: tuple[str, str, str]

    @property
    def plugin_flow(self) -> Flow:
        return self.flow

    def displace(self, points: Points, time: float, dt: float) -> Points:
        return self.flow.displace(points, time, dt)

    def cache_data(self, time: float, dt: float) -> Any:
        return {"plugin": self.origin, "data": self.flow.cache_data(time, dt)}

    def of_subject(self, subject: Any, place: Vector, before: Sequence[Flow]) -> Flow:
        plain = [flow.plugin_flow for flow in before]
        return dataclasses.replace(self, flow=self.flow.of_subject(subject, place, plain))

    def findings(self) -> Iterator[tuple[str, bool]]:
        return self.flow.findings()

    def facts(self, time: float) -> Mapping[str, Any]:
        return self.flow.facts(time)

    @property
    def faces_follow_normals(self) -> bool:
        return self.flow.faces_follow_normals

    @property
    def rest_interval(self) -> int | None:
        return self.flow.rest_interval

    @property
    def name(self) -> str:
        return self.origin[2]


def as_flow(flow: Flow | Displacement) -> Flow:
    """Return a flow unchanged, and any other callable wrapped as one."""
    return flow if isinstance(flow, Flow) else Function(flow)


@dataclass(frozen=True)
class PythonFlow(Flow):
    """A function `points, time, dt -> points` of a Python file, run only with permission.

    digest   SHA-256 of the file, for keys; the modules it imports do not count
    allowed  True if the file may run; otherwise every step fails
    reads    digests of the `files` that it may open
    """

    function: str
    digest: str
    path: Path = field(default=Path(), compare=False)
    allowed: bool = field(default=False, compare=False)
    reads: tuple[str, ...] = ()
    files: tuple[Path, ...] = field(default=(), compare=False)

    @property
    def name(self) -> str:
        return f"{self.function} of {self.path}"

    def displace(self, points: Points, time: float, dt: float) -> Points:
        require_permission(self)
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


def python_flows(flow: Flow) -> Iterator[PythonFlow]:
    """Yield the Python flows of a composed flow."""
    stack: list[Any] = [flow]
    while stack:
        part = stack.pop(0)
        if isinstance(part, PythonFlow):
            yield part
        elif isinstance(part, tuple | list):
            stack += part
        elif dataclasses.is_dataclass(part):
            stack += [getattr(part, f.name) for f in dataclasses.fields(part)]


def require_permission(flow: Flow) -> None:
    """Raise UsageError for the first Python flow without permission."""
    for part in python_flows(flow):
        if not part.allowed:
            raise UsageError(
                f"{part.path}: the shot would run this Python file, which can do anything you can; "
                "that needs permission. Read the file, then add --allow-code "
                "(for snakemake, --config allow_code=true)."
            )


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
