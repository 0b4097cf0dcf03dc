"""Commands that look after what was made: verify, clean."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated

import typer
from rich.progress import track

from pipeline.cli.arguments import Settings
from pipeline.cli.options import Common
from pipeline.cli.runs import carried_out
from pipeline.cli.say import answer, complain, err, warn
from pipeline.errors import FlowsculptError
from pipeline.production.care.cleaning import Sweep, sweep
from pipeline.production.care.state import is_begun
from pipeline.production.care.verifying import Checked, damages, verified
from pipeline.production.files.store import Store
from pipeline.production.runs.run import exclusive
from pipeline.production.runs.workflow import Studio
from pipeline.production.takes.folder import find_shot, shot_names
from pipeline.production.takes.take import Take
from render.quality import QUALITIES


def verify(common: Common, settings: Settings = None) -> None:
    """Decode every file that was made, and make those again that are not what they should be.

    Truncated, foreign and damaged meshes, pictures and movies are found and forgotten; what of them today's
    shots show is then made anew. With --dry-run they are only told.
    """
    store = Store(common.root)
    faulty = _faulty(common, store)
    if common.dry_run or not faulty:
        facts = {"faulty": [_facts(each) for each in faulty], "healed": False}
        answer(_found(len(faulty), "; nothing was changed" if faulty else ""), facts, common.json)
        raise typer.Exit(1 if faulty else 0)
    studio = Studio(common.root, common.cores, settings=tuple(settings or ()))
    damaged = list(damages(_begun(studio), store, {(each.kind, each.key) for each in faulty}))
    with exclusive(common.root):
        for each in faulty:
            store.discard(each.kind, each.key)
    outcome = carried_out(common, lambda: studio.mended(damaged))
    facts = {"faulty": [_facts(each) for each in faulty], "healed": not outcome.unfinished}
    answer(_found(len(faulty), "; what of it today's shots show is whole again"), facts, common.json)
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)


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
    studio = Studio(common.root, common.cores, settings=tuple(settings or ()))
    takes = list(_begun(studio))
    if common.dry_run:
        done = sweep(studio.store, takes, keep, only_tell=True)
    else:
        with exclusive(common.root):
            done = sweep(studio.store, takes, keep, only_tell=False)
    facts = {"removed": len(done.gone), "freed_bytes": done.freed, "kept": done.kept}
    answer(_swept(done, common.dry_run), facts, common.json)


def _faulty(common: Common, store: Store) -> list[Checked]:
    """What is wrong in the store, told file by file."""
    total = sum(1 for _ in store.entries())
    looked_at: Iterable[Checked] = verified(store, common.cores)
    if common.progress:
        looked_at = track(looked_at, "verifying", total, console=err)
    faulty = [each for each in looked_at if each.fault is not None]
    for each in faulty:
        complain(f"{each.path.relative_to(common.root)}: {each.fault}")
    return faulty


def _found(count: int, more: str) -> str:
    if not count:
        return "Every file is what it should be."
    if count == 1:
        return f"1 file is not what it should be{more}."
    return f"{count} files are not what they should be{more}."


def _facts(each: Checked) -> dict[str, str | None]:
    return {"kind": each.kind, "file": str(each.path), "fault": each.fault}


def _begun(studio: Studio) -> Iterator[Take]:
    """Today's shots, at every quality that was begun; one that cannot be read is told."""
    for name in shot_names():
        try:
            takes = [studio.take(find_shot(name), quality) for quality in QUALITIES]
        except FlowsculptError as error:
            warn(str(error))
            continue
        begun = [take for take in takes if is_begun(take, studio.store)]
        yield from begun or takes[:1]


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
