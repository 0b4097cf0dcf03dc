"""The command `clean`: free the disk of what nobody needs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import typer

from pipeline.cli.options import Common, Settings
from pipeline.cli.output import answer, warn
from pipeline.errors import FlowsculptError
from pipeline.production.execution.project import Project
from pipeline.production.execution.run import exclusive
from pipeline.production.maintenance.clean import Sweep, sweep
from pipeline.production.planning.frame_states import is_begun
from pipeline.production.request.lookup import find_shot, shot_names
from pipeline.production.request.render_request import RenderRequest
from render.scene.quality import QUALITIES


def clean(
    common: Common,
    keep: Annotated[
        int, typer.Option(min=0, metavar="N", help="Keep what the last N runs of each shot were about.")
    ] = 2,
    settings: Settings = None,
) -> None:
    """Free the disk of what nobody needs.

    What today's shots ask for stays, at every quality that was begun, and so do what renders/ shows and what
    the last runs were about, which makes going back to them free. --dry-run tells how much would go.
    """
    project = Project(common.root, common.cores, settings=tuple(settings or ()))
    requests = list(_begun(project))
    if common.dry_run:
        done = sweep(project.store, requests, keep, only_tell=True)
    else:
        with exclusive(common.root):
            done = sweep(project.store, requests, keep, only_tell=False)
    facts = {"removed": len(done.gone), "freed_bytes": done.freed, "kept": done.kept}
    answer(_swept(done, common.dry_run), facts, common.json)


def _begun(project: Project) -> Iterator[RenderRequest]:
    """Today's shots, at every quality that was begun; one that cannot be read is told."""
    for name in shot_names():
        try:
            requests = [project.request(find_shot(name), quality) for quality in QUALITIES]
        except FlowsculptError as error:
            warn(str(error))
            continue
        begun = [request for request in requests if is_begun(request, project.store)]
        yield from begun or requests[:1]


def _swept(done: Sweep, only_told: bool) -> str:
    would = "would free" if only_told else "freed"
    return f"{would.capitalize()} {_bytes(done.freed)} in {len(done.gone)} files; {done.kept} files stay."


def _bytes(count: int) -> str:
    size, unit = float(count), "bytes"
    for larger in ("kB", "MB", "GB", "TB"):
        if size < 1000.0:
            break
        size, unit = size / 1000.0, larger
    return f"{size:.3g} {unit}"
