"""Collect garbage: delete stored files that neither shots, nor renders/, nor the last runs need."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from flowsculpt import FlowsculptError, MachineError
from flowsculpt.api import ShotExtras
from flowsculpt.api.files import remove_file, sweep_hidden_drafts
from flowsculpt.api.frames import Folders, RenderRequest, Runs, Store
from flowsculpt.pipeline.plugins.maintenance.store_repair import FORMS, by_digest, last_requests
from flowsculpt.pipeline.plugins.maintenance.verify import inode, shown_files


@dataclass(frozen=True)
class Collected:
    """The outcome of a collection, done or only planned.

    removed  files of the store
    kept     how many files of it stay
    freed    bytes
    linked   how many copies in renders/ became links
    others   what plug-ins did not need any more, in words: how many files, and their bytes
    """

    removed: tuple[Path, ...]
    kept: int
    freed: int
    linked: int = 0
    others: Mapping[str, tuple[int, int]] = field(default_factory=dict)


def collect_garbage(store: Store, requests: Iterable[RenderRequest], keep: int, dry_run: bool) -> Collected:
    """Remove stored files that neither `requests` nor the last `keep` runs of each shot need.

    Files that renders/ shows stay; copies of them become links where the disk has links, except COPIED
    kinds. What plug-ins need no more goes too. Unless `dry_run`, only the holder of the root's lock may call
    this.
    """
    requests = (*requests, *last_requests(store.root, keep))
    copies = _shown_copies(store)
    needed = {name for request in requests for name in _needs(request, store)} | set(copies.values())
    linked, freed = (0, 0) if dry_run else _link_copies(store, copies)
    renders = Folders.of_root(store.root).renders
    shown = set(_inodes(renders))
    removed: list[Path] = []
    kept = 0
    for kind, key, path in store.entries():
        facts = path.lstat()
        if (kind, key) in needed or (facts.st_dev, facts.st_ino) in shown:
            kept += 1
            continue
        removed.append(path)
        freed += facts.st_size
        if not dry_run:
            store.discard(kind, key)
    if not dry_run:
        sweep_hidden_drafts(renders, "**/")
        Runs(store.root).forget(keep)
        store.digests.prune()
    return Collected(tuple(removed), kept, freed, linked, _others(store.root, requests, dry_run))


def _others(root: Path, requests: Iterable[RenderRequest], dry_run: bool) -> dict[str, tuple[int, int]]:
    """Remove what plug-ins need no more; return how many files and bytes, by what they are."""
    others = {}
    for extras in ShotExtras.of_plugins().values():
        what, files = extras.unneeded(root, requests)
        sizes = []
        for path in files:
            with contextlib.suppress(FileNotFoundError):  # another root's `clean` was faster
                sizes.append(path.stat().st_size)
            if not dry_run:
                remove_file(path, prune=True)
        if sizes:
            others[what] = (len(sizes), sum(sizes))
    return others


def _needs(request: RenderRequest, store: Store) -> Iterator[tuple[str, str]]:
    """Yield kind and key of every file on the way to the pictures of a request."""
    with contextlib.suppress(FlowsculptError):  # a shot that cannot be read any more needs nothing
        for angle in request.angles.values():
            for part in request.parts:
                yield "mesh", part.keys.mesh(angle.mesh)
                yield "normals", part.keys.normals(angle.mesh)
        yield "cameras", request.keys.cameras
        keys = request.keys.pictures(store)
        if keys is None:
            return
        for number in request.angles:
            yield from (("raw", key) for key in (keys[number].raw, *keys[number].staged.values()))
            yield "frame", keys[number].frame
            yield from ((form, request.keys.still(form, keys[number].frame)) for form in FORMS)
        for part in (request, request.whole()):
            yield "movie", part.keys.movie([keys[n].frame for n in sorted(part.requested)])


def _shown_copies(store: Store) -> dict[Path, tuple[str, str]]:
    """Return the files in renders/ that are copies of stored files, with the kind and key of each.

    Disks without links have such copies, and a store that was moved to another disk leaves them.
    """
    names, known = by_digest(store), cache(store.digests.in_folder)
    stored = {inode(path) for _, _, path in store.entries()}
    copies = {}
    for path in shown_files(store.root):
        digests, place = known(path.parent).get(path.name), path.relative_to(store.root)
        name = names.get(digests[-1]) if digests and inode(path) not in stored else None
        if name is not None and store.shows(*name, place):
            copies[place] = name
    return copies


def _link_copies(store: Store, copies: Mapping[Path, tuple[str, str]]) -> tuple[int, int]:
    """Replace copies by links, unless the disk has none; return how many, and the bytes freed."""
    freed = []
    for place, name in copies.items():
        if name[0] in store.COPIED:
            continue
        size = (store.root / place).stat().st_size
        with contextlib.suppress(MachineError):  # a full disk; the rest of `clean` frees it
            store.link(*name, place, replace=True)
        if inode(store.root / place) != inode(store.path(*name)):
            break
        freed.append(size)
    return len(freed), sum(freed)


def _inodes(folder: Path) -> Iterator[tuple[int, int]]:
    for path in folder.rglob("*"):
        with contextlib.suppress(OSError):
            facts = path.stat()
            yield facts.st_dev, facts.st_ino
