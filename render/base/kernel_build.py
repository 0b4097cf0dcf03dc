"""Compile all kernels at set-up, in as many processes as there are cores.

The unit is a module, for kernels of one module share those that they call. A module waits for those it
imports: its kernels then read theirs from the cache instead of compiling them once more.
"""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from graphlib import TopologicalSorter
from multiprocessing import forkserver, get_context
from typing import TypeGuard

from flowsculpt.render.base.kernel_cache import (
    BLOCK_KERNELS,
    DECLARED,
    DECORATORS,
    SOURCES,
    KernelCache,
    imported_modules,
    kernel_modules,
    module_of,
    source_of,
)
from flowsculpt.render.base.render_errors import MachineError

PREPARED = (
    "flowsculpt.render.frame.feature_edges",
    "flowsculpt.render.frame.fireflies",
    "flowsculpt.render.frame.sample_sums",
    "flowsculpt.render.movie.movie_frames",
    "flowsculpt.render.post.colour",
    "flowsculpt.render.post.half_floats",
    "flowsculpt.render.raster",
)
"""Modules whose function `prepare` compiles the kernels of pictures, and bakes the tables of displays."""

LATER = (
    "flowsculpt.pipeline.mesh.kernels.triangulation",
    "flowsculpt.pipeline.plugins.",
    "flowsculpt.pipeline.resample.refinement",
    "flowsculpt.render.raster",
)
"""What the names of units begin with that most films do without: polygons of models, flows and files of
plug-ins, one mesh for all frames, previews."""

ANYWHERE = "*"
"""Stands for the name of an unknown module."""


def build_kernels(calls: Mapping[str, set[str]], processes: int, advance: Callable[[], None]) -> None:
    """Compile what the cache does not hold, in so many processes; first those that most others wait for.

    calls    of `kernel_calls`
    advance  is called when a unit is done

    Raises MachineError where a process is killed, as it is when memory runs out.
    """
    context = get_context("forkserver")
    context.set_forkserver_preload(["flowsculpt.render.base.kernel_compiler"])
    try:
        with ProcessPoolExecutor(processes, context) as pool:
            _build_all(calls, processes, pool, advance)
    finally:
        forkserver._forkserver._stop()  # type: ignore[attr-defined]  # else it keeps its memory while we live


def _build_all(
    calls: Mapping[str, set[str]], processes: int, pool: ProcessPoolExecutor, advance: Callable[[], None]
) -> None:
    order = TopologicalSorter(calls)
    order.prepare()
    chain = _longest_chains(calls)
    ready: list[str] = []
    running: dict[Future[None], str] = {}
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


def film_calls(calls: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Return those of `kernel_calls` without which no film is rendered."""
    return {unit: called for unit, called in calls.items() if not unit.startswith(LATER)}


def kernels_called_by_kernels() -> set[tuple[str, str]]:
    """Return module and name of the kernels that Python does not call: no other code mentions them.

    One whose name something else has in the same module is left out, which costs time and nothing more.
    """
    texts = {
        module_of(source): source.read_text(encoding="utf-8")
        for package in ("pipeline", "render")
        for source in (SOURCES / package).rglob("*.py")
    }
    holders = {*kernel_modules("pipeline"), *kernel_modules("render")}
    trees = {module: ast.parse(texts[module]) for module in holders}
    kernels = {
        (module, statement.name)
        for module, tree in trees.items()
        for statement in tree.body
        if _is_kernel(statement)
    }
    names = {(module.rpartition(".")[2], name) for module, name in kernels}
    for module in texts.keys() - holders:
        words = set(re.findall(r"\w+", texts[module]))
        if any(holder in words and name in words for holder, name in names):  # parsing all takes a second
            trees[module] = ast.parse(texts[module])
    mentioned = set[tuple[str, str]]().union(*(_mentions(module, tree) for module, tree in trees.items()))
    return {(m, name) for m, name in kernels if not {(m, name), (ANYWHERE, name)} & mentioned}


def _is_kernel(statement: ast.stmt) -> TypeGuard[ast.FunctionDef]:
    decorators = statement.decorator_list if isinstance(statement, ast.FunctionDef) else []
    called = [node.func if isinstance(node, ast.Call) else node for node in decorators]
    return any(isinstance(node, ast.Name) and node.id in DECORATORS for node in called)


def _mentions(module: str, tree: ast.Module) -> set[tuple[str, str]]:
    """Return module and name of what a module mentions outside of its kernels, its imports apart.

    The module is ANYWHERE where the source does not tell it: of what a package hands on, and of `a.b.name`.
    """
    imported = {
        alias.asname or alias.name: (node.module or "", alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    sources = {of: of if source_of(of).is_file() else ANYWHERE for of, _ in imported.values()}
    mentioned: set[tuple[str, str]] = set()
    for statement in tree.body:
        for node in () if _is_kernel(statement) else ast.walk(statement):
            match node:
                case ast.Name(id=name):
                    of, original = imported.get(name, (module, name))
                    mentioned.add((sources.get(of, of), original))
                case ast.Attribute(value=ast.Name(id=holder), attr=name):
                    mentioned.add((".".join(imported.get(holder, "")), name))
                case ast.Attribute(attr=name):
                    mentioned.add((ANYWHERE, name))
    return mentioned


def _build(unit: str) -> None:
    """Compile the kernels of one unit; in a process of the pool."""
    if unit in PREPARED:
        importlib.import_module(unit).prepare()
    else:
        compile_module(unit)


def compile_module(name: str) -> None:
    """Compile every kernel of a module for its declared types, and the kernels that it calls.

    Those that only kernels call are compiled where a kernel that calls them is, and is not in the cache.
    Raises MachineError where one could not be stored.
    """
    importlib.import_module(name)
    for dispatcher, arguments in DECLARED:
        function = dispatcher.py_func
        if function.__module__ == name and (name, function.__name__) not in KernelCache.inner:
            dispatcher.compile(arguments)  # a call finds in the cache what was filed under arguments alone
            if not dispatcher._cache.is_stored(arguments, dispatcher.targetctx):
                raise MachineError(
                    f"{dispatcher._cache.cache_path}: compiled kernels cannot be stored there; "
                    "free space on that disk, or set XDG_CACHE_HOME to a folder on another"
                )
    for block in BLOCK_KERNELS:
        if block.module == name:
            _ = block.address  # asking for it compiles it


def _longest_chains(calls: Mapping[str, Iterable[str]]) -> dict[str, int]:
    """Return the bytes of source of each unit and of the longest chain of units that wait for it."""
    chain: dict[str, int] = {}
    for unit in reversed([*TopologicalSorter(calls).static_order()]):
        following = (chain[other] for other in chain if unit in calls[other])
        chain[unit] = _source_size(unit) + max(following, default=0)
    return chain


def _source_size(unit: str) -> int:
    """Return the bytes of a module's source, or of all sources of a package."""
    module = source_of(unit)
    package = module.with_suffix("")
    sources = package.glob("*.py") if package.is_dir() else [module]
    return sum(source.stat().st_size for source in sources)
