"""The command `verify`: check every stored file."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

import typer

from pipeline.cli.commands.clean import begun_requests
from pipeline.cli.execution import execute
from pipeline.cli.options import Common, Settings, project_of
from pipeline.cli.output import print_error, print_result, print_warning, progress_bars
from pipeline.production.maintenance.verify import (
    PublishedFile,
    StoredFile,
    checked,
    damages,
    published_files,
    remedies,
    repairs,
)
from pipeline.production.maintenance.verify import verify as verify_store
from pipeline.production.store.locks import exclusive
from pipeline.production.store.store import Store
from render.base.plural import plural

File = TypeVar("File", StoredFile, PublishedFile)


def verify(common: Common, settings: Settings = None) -> None:
    """Check every stored file, and make damaged ones again.

    Every mesh, picture and movie of the store is decoded to its end. Truncated, foreign and damaged files are
    evicted, and made again where today's shots need them. `flowsculpt verify --dry-run` only lists them.

    Published files are compared with the digests in their provenance.json. They are never written to: a
    damaged, altered or missing one is listed with the command that reproduces it (exit code 1).
    """
    store = Store(common.root)
    damaged = _reported(
        common, "verifying", verify_store(store, common.cores), sum(1 for _ in store.entries())
    )
    files = list(published_files(common.root))
    altered = _reported(common, "verifying versions", checked(files, common.cores), len(files))
    for remedy in remedies(altered, common.root):
        print_warning(remedy)
    facts = {
        "faulty": [{"kind": file.kind, "file": str(file.path), "fault": file.fault} for file in damaged],
        "published": [
            {"version": str(file.version), "file": str(file.path), "frame": file.number, "fault": file.fault}
            for file in altered
        ],
    }
    if common.dry_run or not damaged:
        words = _summary(len(damaged), len(altered), "; nothing was changed")
        print_result(words, {**facts, "healed": False}, common.json)
        raise typer.Exit(1 if damaged or altered else 0)
    project = project_of(common, settings)
    names = {(file.kind, file.key) for file in damaged}
    damaged_requests = list(damages(begun_requests(project), store, names))
    with exclusive(common.root):
        for kind, key in names:
            store.discard(kind, key)
    outcome = execute(common, lambda: repairs(project, damaged_requests))
    words = _summary(len(damaged), len(altered), "; those that today's shots need are made again")
    print_result(words, {**facts, "healed": not outcome.unfinished}, common.json)
    if outcome.exit_code or altered:
        raise typer.Exit(outcome.exit_code or 1)


def _reported(common: Common, name: str, files: Iterable[File], total: int) -> list[File]:
    """Check files with a progress bar; report and return the faulty ones."""
    faulty = []
    with progress_bars(common.progress and total > 0) as bar:
        advance = bar(name, total)
        for file in files:
            advance()
            if file.fault is not None:
                faulty.append(file)
    for file in faulty:
        print_error(f"{file.path.relative_to(common.root)}: {file.fault}")
    return faulty


def _summary(damaged: int, altered: int, what_became: str) -> str:
    """`what_became`: of the damaged files, those that are not published."""
    if not (damaged or altered):
        return "Every file is what it should be."
    sentences = [f"{_count(damaged)} damaged{what_became}."] if damaged else []
    sentences += [f"{_count(altered, ' of published versions')} not what was published."] if altered else []
    return " ".join(sentences)


def _count(number: int, of: str = "") -> str:
    return f"{plural(number, f'file{of}', f'files{of}')} {'is' if number == 1 else 'are'}"
