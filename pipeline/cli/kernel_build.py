"""Compile all kernels at set-up, in as many processes as there are cores.

The unit is a module, for kernels of one module share those that they call. A module waits for those it
imports: its kernels then read theirs from the cache instead of compiling them once more.
"""

from __future__ import annotations

import gc
import importlib
import signal
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from graphlib import TopologicalSorter
from multiprocessing import get_context

from pipeline.cli.numba_shortcuts import take_shortcuts
from pipeline.errors import MachineError
from pipeline.kernels import compile_module
from render.base.kernel_cache import SOURCES, imported_modules, kernel_modules

PREPARED = (
    "render.frame.feature_edges",
    "render.frame.fireflies",
    "render.frame.sample_sums",
    "render.movie.planes",
    "render.post.colour",
    "render.raster",
)
"""Modules whose function `prepare` compiles the kernels of pictures, and bakes the tables of displays."""


def build_kernels(calls: Mapping[str, set[str]], processes: int, advance: Callable[[], None]) -> None:
    """Compile what the cache does not hold, in so many processes; first those that most others wait for.

    calls    of `kernel_calls`
    advance  is called when a unit is done

    Raises MachineError where a process is killed, as it is when memory runs out.
    """
    order = TopologicalSorter(calls)
    order.prepare()
    chain = _longest_chains(calls)
    ready: list[str] = []
    running: dict[Future[None], str] = {}
    with ProcessPoolExecutor(processes, get_context("spawn"), _begin_process) as pool:
        while order.is_active():
            ready = sorted([*ready, *order.get_ready()], key=chain.__getitem__)
            while ready and len(running) < processes:
                unit = ready.pop()
                running[pool.submit(_build, unit)] = unit
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                order.done(running.pop(future))
                try:
                    future.result()
                except BrokenProcessPool:
                    raise MachineError(
                        "a process that compiles kernels was killed, as happens when memory runs out; "
                        "run `flowsculpt -j 1 doctor --prepare`, which goes on from there with one process"
                    ) from None
                advance()


def kernel_calls() -> dict[str, set[str]]:
    """Return all units, each with those whose kernels its own may call."""
    modules = set(kernel_modules("pipeline"))
    calls = {name: modules & imported_modules(name) for name in modules}
    return calls | {name: set() for name in PREPARED}


def _begin_process() -> None:
    """Leave Ctrl-C to the process that started this one, which then starts no further unit.

    What a compiler holds is needed to the end: only new objects are searched for garbage.
    """
    gc.set_threshold(1_000_000, 100_000)
    take_shortcuts()
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _build(unit: str) -> None:
    """Compile the kernels of one unit; in a process of the pool."""
    if unit in PREPARED:
        importlib.import_module(unit).prepare()
    else:
        compile_module(unit)


def _longest_chains(calls: Mapping[str, Iterable[str]]) -> dict[str, int]:
    """Return the bytes of source of each unit and of the longest chain of units that wait for it."""
    chain: dict[str, int] = {}
    for unit in reversed([*TopologicalSorter(calls).static_order()]):
        following = (chain[other] for other in chain if unit in calls[other])
        chain[unit] = _source_size(unit) + max(following, default=0)
    return chain


def _source_size(unit: str) -> int:
    """Return the bytes of a module's source, or of all sources of a package."""
    path = SOURCES.joinpath(*unit.split("."))
    sources = path.glob("*.py") if path.is_dir() else [path.with_suffix(".py")]
    return sum(source.stat().st_size for source in sources)
