"""The commands `verify` and `clean`, which check and delete stored files."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, NamedTuple, TypeVar

import typer

from flowsculpt import MachineError
from flowsculpt.api import plural
from flowsculpt.api.commands import (
    execute,
    print_error,
    print_result,
    print_warning,
    progress_bars,
    size_words,
)
from flowsculpt.api.frames import Locks, Runs, Store
from flowsculpt.api.options import Common, ShotOptions, shared_option
from flowsculpt.pipeline.plugins.maintenance.clean import collect_garbage
from flowsculpt.pipeline.plugins.maintenance.store_repair import (
    begun_films,
    begun_requests,
    evict,
    last_requests,
    remedy,
    repairs,
)
from flowsculpt.pipeline.plugins.maintenance.verify import (
    PublishedFile,
    ShownFile,
    StoredFile,
    checked,
    files_without_digest,
    inode,
    published_files,
    refused_folders,
    remedies,
    roots,
    shown_files,
    shown_with_digest,
    verify_shown,
)
from flowsculpt.pipeline.plugins.maintenance.verify import verify as verify_store


def clean(
    common: Common,
    keep: Annotated[
        int, typer.Option(min=0, metavar="N", help="Keep the files of the last N runs of each shot.")
    ] = 2,
    settings: Annotated[list[str] | None, shared_option("settings")] = None,
) -> None:
    """Delete stored files that nothing needs, and free the disk.

    Kept are files that today's shots need, at every quality begun so far, files that renders/ shows, and
    those of the last runs, so that undoing an edit renders nothing. Trials of `breed` go when it was
    interrupted, and fits of `become` that no shot here needs and no shot has used for 30 days.
    `flowsculpt clean --dry-run` says how much would be freed; `flowsculpt clean --keep 0` frees the most.
    Nothing is ever deleted from the remote store (--store).
    """
    project = ShotOptions(settings).project(common)
    requests = list(begun_requests(project, print_warning))
    with nullcontext() if common.dry_run else Locks(common.root).hold_alone():
        done = collect_garbage(project.store, requests, keep, common.dry_run)
    verb = "Would free" if common.dry_run else "Freed"
    freed = f"{size_words(done.freed)} in {plural(len(done.removed), 'file')}"
    words = f"{verb} {freed}, and {'keep' if common.dry_run else 'kept'} {plural(done.kept, 'file')}."
    for what, (count, space) in done.others.items():
        words += f" {verb} {size_words(space)} in {plural(count, 'file')}: {what}."
    if done.linked:
        words += f" {plural(done.linked, 'copy', 'copies')} in renders/ became links to the store."
    facts = {
        "removed": len(done.removed),
        "freed_bytes": done.freed,
        "kept": done.kept,
        "linked": done.linked,
        "others": {what: {"files": n, "bytes": space} for what, (n, space) in done.others.items()},
    }
    print_result(words, facts, common.json)


File = TypeVar("File", StoredFile, ShownFile, PublishedFile)


def verify(common: Common, settings: Annotated[list[str] | None, shared_option("settings")] = None) -> None:
    """Check every file that was written, and make damaged ones again.

    Every stored mesh, picture and movie, and every file in renders/, is compared with the digest taken when
    it was written. Damaged files are evicted, and made again where they were shown. For previews, sheets and
    the like, the command that makes them again is printed (exit code 1). Files of earlier versions have no
    digest: stored ones are decoded to their end, and get one. `flowsculpt verify --dry-run` changes nothing.

    Published files are compared with the digests in their provenance.json. They are never written to: a
    damaged, altered or missing one is listed with the command that reproduces it (exit code 1).

    Files and folders that may not be read are listed and left as they are (exit code 4).
    """
    checks = [_checked(common, Store(root)) for root in roots(common.root)]
    files = list(published_files(Store(common.root)))
    versions = _faulty(_verified(common, checked(files, common.cores), "verifying versions", len(files)))
    _report(common, common.root, versions)
    for line in remedies(versions, common.root):
        print_warning(line)
    faulty = sum(len(check.damaged) + len(check.altered) for check in checks)
    refused = list(dict.fromkeys(message for check in checks for message in check.refused))
    for message in refused:
        print_error(message)
    facts = {
        "faulty": [
            {"kind": file.kind, "file": str(file.path), "fault": file.fault}
            for check in checks
            for file in check.damaged
        ],
        "shown": [
            {"file": str(file.path), "fault": file.fault} for check in checks for file in check.altered
        ],
        "published": [
            {
                "version": str(file.folder),
                "file": str(file.path),
                "frame": file.number,
                "fault": file.fault,
            }
            for file in versions
        ],
        "unchecked": [str(path) for check in checks for path in check.unchecked],
        "refused": refused,
    }
    code, left, became = 0, faulty, "; nothing was changed"
    if faulty and not common.dry_run:
        code, left = _repair(common, settings, checks)
        became = ": made again, or shown again" if not left else f", and {left} not made again: see above"
    words = _summary(faulty, len(versions), became, bool(refused))
    print_result(words, {**facts, "healed": bool(faulty) and not (code or left)}, common.json)
    if refused and not code:
        code = MachineError.exit_code
    if code or left or versions:
        raise typer.Exit(code or 1)


class _Check(NamedTuple):
    """The outcome for a root.

    damaged    of the store
    altered    outside of it
    unchecked  files in renders/ that nothing is known of
    refused    messages about what could not be read
    """

    store: Store
    damaged: list[StoredFile]
    altered: list[ShownFile]
    unchecked: list[Path]
    refused: list[str]


def _checked(common: Common, store: Store) -> _Check:
    """Check a root, report what is damaged, and give a digest to files that had none."""
    count = sum(1 for _ in store.entries())
    stored = _verified(common, verify_store(store, common.cores), "verifying", count)
    paths = shown_with_digest(store)
    shown = _verified(
        common, verify_shown(store, stored, paths, common.cores), "verifying renders/", len(paths)
    )
    _report(common, store.root, [*_faulty(stored), *_faulty(shown)])
    read = [file for file in stored if file.refusal is None]
    undecided = [file.path for file in read if not file.has_digest and file.fault is None]
    unchecked = files_without_digest(store, stored)
    if undecided:
        files = plural(len(undecided), "stored file")
        print_warning(f"{files} without digest, made by an earlier version: decoded to the end instead")
    if unchecked:
        files, first = plural(len(unchecked), "file"), unchecked[0].relative_to(common.root)
        print_warning(f"{files} without digest, not made by this version, could not be checked, as {first}")
    if not common.dry_run:
        for path in undecided:
            store.digests.add(path)
    refusals = [*(file.refusal for file in stored), *(file.refusal for file in shown)]
    refused = [*refused_folders(store.root), *filter(None, refusals)]
    return _Check(store, _faulty(stored), _faulty(shown), unchecked, refused)


def _repair(common: Common, settings: list[str] | None, checks: Sequence[_Check]) -> tuple[int, int]:
    """Repair what is damaged; return the exit code of the run, and how many files it did not make again."""
    project, code = ShotOptions(settings).project(common), 0
    evicted = []
    for check in checks:
        with Locks(check.store.root).hold_alone():
            evicted.append(evict(check.store, check.damaged, check.altered))
    requests, films, lost = [], [], evicted[0].lost
    if lost:
        requests = [*begun_requests(project, print_warning), *last_requests(common.root, Runs.MOST)]
        films = list(begun_films(project))
    while lost:  # pictures are known by their cameras, so these are made again first
        todo = replace(evicted[0], lost=lost)
        code = execute(common, partial(repairs, project, requests, films, todo)).exit_code
        before, lost = lost, tuple(path for path in lost if not (common.root / path).exists())
        lost = () if lost == before else lost
    left = [
        check.store.root / path
        for check, each in zip(checks, evicted, strict=True)
        for path in (*each.lost, *each.altered)
        if path in each.altered or not (check.store.root / path).exists()
    ]
    for path in left:
        print_warning(remedy(path.relative_to(common.root)))
    return code, len(left)


def _verified(common: Common, files: Iterable[File], name: str, total: int) -> list[File]:
    """Check files with a progress bar; return them."""
    checked = []
    with progress_bars(common.progress and total > 0) as bar:
        advance = bar(name, total)
        for file in files:
            advance()
            checked.append(file)
    return checked


def _report(common: Common, root: Path, faulty: Sequence[StoredFile | ShownFile | PublishedFile]) -> None:
    """Report faulty files below a root; those of the store by the names under which renders/ shows them."""
    names: defaultdict[tuple[int, int], list[Path]] = defaultdict(list)
    for path in shown_files(root) if faulty else ():
        names[inode(path)].append(path)
    for file in faulty:
        for path in names.get(inode(file.path)) or [file.path]:
            print_error(f"{path.relative_to(common.root)}: {file.fault}")


def _faulty(files: Iterable[File]) -> list[File]:
    return [file for file in files if file.fault is not None]


def _summary(damaged: int, altered: int, became: str, is_partial: bool) -> str:
    """Return the outcome in words.

    became      says what became of damaged files that are not published
    is_partial  some files could not be read
    """
    if not (damaged or altered):
        files = "Every file that could be read" if is_partial else "Every file"
        return f"{files} is what it should be."
    sentences = [f"{_count(damaged)} damaged{became}."] if damaged else []
    sentences += [f"{_count(altered, ' of published versions')} not as published."] if altered else []
    return " ".join(sentences)


def _count(number: int, of: str = "") -> str:
    return f"{plural(number, f'file{of}', f'files{of}')} {'is' if number == 1 else 'are'}"
