"""The files of a version: written beside their place and renamed into it, all at once, and read-only."""

from __future__ import annotations

import json
import os
import shutil
import uuid
from pathlib import Path

from pipeline.production.store.store import Store
from pipeline.production.versions.provenance import FILE, Provenance
from render.base.atomic_write import disk_errors

_DRAFT = ".draft."


def freeze(store: Store, record: Provenance, final: Path, copy: bool = False) -> None:
    """Have the frames and the movie of a version at `final`, and its provenance beside them.

    They are links to the files of the store, which take no space, or where no links can be, copies. With
    `copy` they are copies in any case.

    Raises MachineError where the disk refuses; then nothing is left of it.
    """
    draft = final.with_name(f"{_DRAFT}{final.name}.{uuid.uuid4().hex[:8]}")
    freeze_one = _copied if copy else _linked
    with disk_errors(final):
        try:
            for frame in record.frames.values():
                freeze_one(store.path("frame", frame.frame), draft / frame.file)
            freeze_one(store.path("movie", record.movie["key"]), draft / record.movie["file"])
            _told(record, draft / FILE)
            draft.rename(final)
        finally:
            shutil.rmtree(draft, ignore_errors=True)


def sweep(home: Path) -> None:
    """Remove what killed processes left. Only whoever holds the root's lock may call this."""
    for draft in home.glob(f"{_DRAFT}*"):
        shutil.rmtree(draft, ignore_errors=True)


def _linked(source: Path, place: Path) -> None:
    """Read-only, as the store's file is."""
    place.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, place)
    except OSError:
        _copied(source, place)


def _copied(source: Path, place: Path) -> None:
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy2(source, place)
    _settled(place)


def _told(record: Provenance, place: Path) -> None:
    place.write_text(json.dumps(record.as_data(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    _settled(place)


def _settled(place: Path) -> None:
    """On the disk, and read-only."""
    place.chmod(0o444)
    with place.open("rb") as file:
        os.fsync(file.fileno())
