"""State of modules that functions change: each is listed here with what makes it safe in two threads."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.needed_plugins import is_of_installed

ROOT = Path(__file__).parents[1]

SAFE = {
    "pipeline/plugins/python/python_flow.py:_current": "each thread has its own",
    "pipeline/plugins/fields/grid_files.py:_LAST": "replaced; a value taken is kept, read twice at worst",
    "pipeline/plugin.py:_LOADING": "changed by the thread that holds a lock",
    "pipeline/plugins/interchange/fbx_files.py:_SCENES": "only appended to, never read",
    "pipeline/plugins/lettering/outline_process.py:_known": "of commands, which have one thread",
    "pipeline/production/store/locks.py:_OPEN": "of commands; one change of a set is whole",
    "pipeline/production/tasks/job.py:_PROCESS_CLOCK": "of jobs, one after another in their process",
    "pipeline/shot/subjects.py:_latest": "replaced; who takes a value keeps it, read twice at worst",
    "pipeline/plugin.py:_LEFT_OUT": "only appended to",
    "render/base/kernel_cache.py:_compiled_seconds": "changed under numba's lock of compilations",
    "render/base/kernel_cache.py:_reserved": "changed under numba's lock of compilations",
    "render/base/kernel_cache.py:_starting": "a lock, renewed in forks, which begin with one thread",
    "render/base/root_files.py:_roots": "of commands; only added to, before threads begin",
    "render/integrator/light_sampler.py:_latest": "of renders, one after another in their process",
    "render/mitsuba/loading.py:_scene_kind": "of renders, one after another in their process",
}

_CHANGES = {"append", "add", "update", "setdefault", "pop", "popitem", "clear", "extend", "insert", "remove"}


def changed_state(module: ast.Module) -> Iterator[str]:
    """Yield the names at the top of a module whose values its functions replace or change."""
    tops = [node for node in module.body if isinstance(node, ast.Assign | ast.AnnAssign)]
    targets = [
        target for node in tops for target in getattr(node, "targets", [getattr(node, "target", None)])
    ]
    names = {target.id for target in targets if isinstance(target, ast.Name)}
    for function in ast.walk(module):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        for node in ast.walk(function):
            match node:
                case ast.Global(names=replaced):
                    yield from replaced
                case ast.Call(func=ast.Attribute(value=ast.Name(id=name), attr=change)) if change in _CHANGES:
                    yield from {name} & names
                case ast.Subscript(value=ast.Name(id=name)) | ast.Attribute(value=ast.Name(id=name)):
                    yield from {name} & names if not isinstance(node.ctx, ast.Load) else ()


def test_all_state_of_modules_that_functions_change_is_known_to_be_safe_in_threads() -> None:
    files = sorted(
        file for folder in ("flowsculpt", "pipeline", "render") for file in (ROOT / folder).rglob("*.py")
    )
    found = {
        f"{file.relative_to(ROOT)}:{name}"
        for file in files
        for name in changed_state(ast.parse(file.read_text(encoding="utf-8")))
    }
    assert found == {*filter(is_of_installed, SAFE)}
