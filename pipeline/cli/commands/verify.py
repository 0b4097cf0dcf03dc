"""The command `verify`: check every file that was made."""

from __future__ import annotations

from collections.abc import Iterable

import typer
from rich.progress import track

from pipeline.cli.commands.clean import _begun
from pipeline.cli.execution import execute
from pipeline.cli.options import Common, Settings
from pipeline.cli.output import answer, complain, err, warn
from pipeline.production.execution.project import Project
from pipeline.production.execution.run import exclusive
from pipeline.production.maintenance.verify import Checked, damages, verified
from pipeline.production.store.store import Store
from pipeline.production.versions.checking import PublishedFile, checked, published_files, remedies


def verify(common: Common, settings: Settings = None) -> None:
    """Decode every file that was made, and make those again that are not what they should be.

    Truncated, foreign and damaged meshes, pictures and movies are found and forgotten; what of them today's
    shots show is then made anew. With --dry-run they are only told.

    What was published is held against the digests in its provenance.json. A version is never written to: a
    file of it that is damaged, altered or gone is told with the command that makes it again (exit code 1).
    """
    store = Store(common.root)
    faulty, altered = _faulty(common, store), _altered(common)
    facts = {"faulty": [_facts(each) for each in faulty], "published": [_facts_of(each) for each in altered]}
    if common.dry_run or not faulty:
        words = _found(len(faulty), len(altered), "; nothing was changed")
        answer(words, {**facts, "healed": False}, common.json)
        raise typer.Exit(1 if faulty or altered else 0)
    project = Project(common.root, common.cores, settings=tuple(settings or ()))
    damaged = list(damages(_begun(project), store, {(each.kind, each.key) for each in faulty}))
    with exclusive(common.root):
        for each in faulty:
            store.discard(each.kind, each.key)
    outcome = execute(common, lambda: project.mended(damaged))
    words = _found(len(faulty), len(altered), "; what of it today's shots show is whole again")
    answer(words, {**facts, "healed": not outcome.unfinished}, common.json)
    if outcome.exit_code or altered:
        raise typer.Exit(outcome.exit_code or 1)


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


def _altered(common: Common) -> list[PublishedFile]:
    """What is wrong with published versions, told file by file, and how it is had again."""
    files = list(published_files(common.root))
    looked_at: Iterable[PublishedFile] = checked(files, common.cores)
    if common.progress and files:
        looked_at = track(looked_at, "verifying versions", len(files), console=err)
    altered = [each for each in looked_at if each.fault is not None]
    for each in altered:
        complain(f"{each.path.relative_to(common.root)}: {each.fault}")
    for remedy in remedies(altered, common.root):
        warn(remedy)
    return altered


def _found(faulty: int, altered: int, more: str) -> str:
    """`more` is what becomes of those that were not published."""
    if not (faulty or altered):
        return "Every file is what it should be."
    told = [f"{_many(faulty, 'is not what it should be', 'are not what they should be')}{more}."]
    told += [
        f"{_many(altered, 'of a published version is', 'of published versions are')} not what was published."
    ]
    return " ".join(words for words, count in zip(told, (faulty, altered), strict=True) if count)


def _many(count: int, of_one: str, of_several: str) -> str:
    return f"1 file {of_one}" if count == 1 else f"{count} files {of_several}"


def _facts(each: Checked) -> dict[str, str | None]:
    return {"kind": each.kind, "file": str(each.path), "fault": each.fault}


def _facts_of(each: PublishedFile) -> dict[str, object]:
    return {"version": str(each.version), "file": str(each.path), "frame": each.number, "fault": each.fault}
