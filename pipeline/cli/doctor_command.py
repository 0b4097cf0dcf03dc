"""The command `doctor`: what is installed, and what would make it faster."""

from __future__ import annotations

import platform
from importlib.metadata import version
from typing import Annotated, Any

import typer

from flowsculpt.pipeline.cli.options import Common
from flowsculpt.pipeline.cli.output import print_result, print_warning, progress_bars
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.production.store.shared_kernels import (
    fetch_kernels,
    has_kernels,
    kernels_key,
    note_all_compiled,
    send_kernels,
)
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.base.kernel_build import build_kernels, film_calls, kernel_calls
from flowsculpt.render.base.kernel_cache import cache_folder
from flowsculpt.render.base.plural import plural
from flowsculpt.render.base.remaining_kernels import note_remaining_kernels
from flowsculpt.render.base.render_errors import MachineError
from flowsculpt.render.graphics import three_js
from flowsculpt.render.mitsuba import engine

PACKAGES = ("numba", "mitsuba", "pyoidn", "OpenImageIO", "av", "snakemake")


def doctor(
    common: Common,
    prepare: Annotated[
        bool, typer.Option("--prepare", help="Finish the installation: libLLVM, three.js, compiled kernels.")
    ] = False,
    background: Annotated[
        bool,
        typer.Option(
            "--background",
            help="With --prepare: compile what films need; the first run starts a process for the rest.",
        ),
    ] = False,
) -> None:
    """Show the renderer and packages in use, and what would make rendering faster.

    `flowsculpt doctor --prepare` finishes an installation, as by `uv tool install`: it fetches a libLLVM
    where none works (on Debian and Ubuntu) and three.js for pages, and compiles all kernels, on as many
    cores as -j says, so that no later command waits for them. Where --store names a remote store, kernels
    that it holds are fetched and others uploaded: compiled kernels are code, so name one that only people
    you trust may write to. With --background only kernels that films need are compiled; the first command
    that renders has a process of the lowest priority compile the others, for previews, polygons of models and
    flows of plug-ins. The exit code is 4 if no renderer works.
    """
    if background and not prepare:
        raise UsageError("--background needs --prepare, which compiles kernels")
    store = Store(common.root)
    remote = store.remote
    if prepare and not common.dry_run:
        _complete_environment()
        with progress_bars(common.progress) as bar:
            if remote is not None:
                fetch_kernels(remote)
            some_may_wait = background and not has_kernels(kernels_key())
            calls = film_calls(kernel_calls()) if some_may_wait else kernel_calls()
            build_kernels(calls, common.cores, bar("compiling kernels", len(calls)))
            note_remaining_kernels() if some_may_wait else note_all_compiled()
            if remote is not None:
                send_kernels(remote)
    renderer = engine.facts()
    facts: dict[str, Any] = {
        "flowsculpt": version("flowsculpt"),
        "python": platform.python_version(),
        "cores": common.cores,
        **renderer,
        "kernels": str(cache_folder()),
        "packages": {name: version(name) for name in PACKAGES},
        "root": str(common.root),
        "free_gigabytes": round(store.free_bytes() / 1e9, 1),
        "remote_store": None if remote is None else {"url": remote.url, "fault": remote.fault()},
    }
    print_result(_diagnosis(facts), facts, common.json)
    raise typer.Exit(4 if renderer["renderer"] == "none" else 0)


def _complete_environment() -> None:
    """Fetch what no package index has for this environment; what cannot be had only makes less possible."""
    engine.provide_llvm()
    try:
        three_js.fetch()
    except MachineError as error:
        print_warning(str(error))


def _diagnosis(facts: dict[str, Any]) -> str:
    packages = ", ".join(f"{name} {number}" for name, number in facts["packages"].items())
    lines = [
        f"flowsculpt {facts['flowsculpt']} on Python {facts['python']}, {plural(facts['cores'], 'core')}",
        f"Renderer: {facts['renderer']} ({facts['why']})",
        f"Faster:   {facts['faster'] or 'nothing to be done'}",
        f"Packages: {packages}",
        f"Kernels:  {facts['kernels']}",
        f"Root:     {facts['root']}, {facts['free_gigabytes']} GB free",
    ]
    if store := facts["remote_store"]:
        lines.append(f"Store:    {store['url']} ({store['fault'] or 'it answers'})")
    return "\n".join(lines)
