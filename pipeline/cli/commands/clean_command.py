"""The command `clean`: delete stored files that nothing needs."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Annotated

import typer

from pipeline.cli.options import Common, Settings, project_of
from pipeline.cli.output import print_result, print_warning, size
from pipeline.production.maintenance.clean import collect_garbage
from pipeline.production.maintenance.known_requests import begun_requests
from pipeline.production.store.locks import exclusive
from render.base.plural import plural


def clean(
    common: Common,
    keep: Annotated[
        int, typer.Option(min=0, metavar="N", help="Keep the files of the last N runs of each shot.")
    ] = 2,
    settings: Settings = None,
) -> None:
    """Delete stored files that nothing needs, and free the disk.

    Kept are files that today's shots need, at every quality begun so far, files that renders/ shows, and
    those of the last runs, so that undoing an edit renders nothing. `flowsculpt clean --dry-run` says how
    much would be freed; `flowsculpt clean --keep 0` frees the most. Nothing is ever deleted from the remote
    store (--store).
    """
    project = project_of(common, settings)
    requests = list(begun_requests(project, print_warning))
    with nullcontext() if common.dry_run else exclusive(common.root):
        done = collect_garbage(project.store, requests, keep, common.dry_run)
    verb = "Would free" if common.dry_run else "Freed"
    freed = f"{size(done.freed)} in {plural(len(done.removed), 'file')}"
    words = f"{verb} {freed}, and {'keep' if common.dry_run else 'kept'} {plural(done.kept, 'file')}."
    if done.linked:
        words += f" {plural(done.linked, 'copy', 'copies')} in renders/ became links to the store."
    facts = {
        "removed": len(done.removed),
        "freed_bytes": done.freed,
        "kept": done.kept,
        "linked": done.linked,
    }
    print_result(words, facts, common.json)
