"""The folder of a published version: laid whole or not at all, and read-only.

    renders/published/<shot>/v001/frames/<shot>.0001.exr
    renders/published/<shot>/v001/<shot>.mp4
    renders/published/<shot>/v001/notes.json          where the shot has notes
    renders/published/<shot>/v001/provenance.json

Frames are links to files of the store, or copies of them.
"""

from __future__ import annotations

import json
import os
import shutil
import uuid
from collections.abc import Mapping
from pathlib import Path

from pipeline.production.request.provenance import FILE, Provenance
from pipeline.production.store.store import Store
from render.base.atomic_write import disk_errors

_DRAFT = ".draft."

NOTES = "notes.json"
"""The file of notes in the folder of a version."""


def freeze(
    store: Store,
    record: Provenance,
    final: Path,
    copy: bool = False,
    notes: bytes = b"",
    files: Mapping[int, Path] | None = None,
) -> None:
    """Lay the frames and the movie of a version at `final`, with its provenance and notes.

    Frames are links to the files of the store, which take no space. They are copies where links fail, and
    with `copy`. The movie is a copy: the store's stays writable, for Snakemake makes no protected file again.

    files  of frames that are not in the store, by their numbers

    Raises MachineError where the disk refuses; then nothing is left of it.
    """
    draft = final.with_name(f"{_DRAFT}{final.name}.{uuid.uuid4().hex[:8]}")
    freeze_frame = _copy if copy else _link
    with disk_errors(final):
        try:
            for number, frame in record.frames.items():
                source = (files or {}).get(number) or store.path("frame", frame.frame)
                freeze_frame(source, draft / frame.file)
                store.digests.add_copy(final / frame.file, source)
            _copy(store.path("movie", record.movie["key"]), draft / record.movie["file"])
            if notes:
                (draft / NOTES).write_bytes(notes)
                _settle(draft / NOTES)
            text = json.dumps(record.as_data(), indent=1, ensure_ascii=False)
            (draft / FILE).write_text(text + "\n", encoding="utf-8")
            _settle(draft / FILE)
            store.digests.add(final / FILE, draft / FILE)
            draft.rename(final)
        finally:
            shutil.rmtree(draft, ignore_errors=True)


def sweep(home: Path) -> None:
    """Remove drafts of killed processes. Only the holder of the lock may call this."""
    for draft in home.glob(f"{_DRAFT}*"):
        shutil.rmtree(draft, ignore_errors=True)


def _link(source: Path, place: Path) -> None:
    """Link a file, which is read-only as the store's is."""
    place.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, place)
    except OSError:
        _copy(source, place)


def _copy(source: Path, place: Path) -> None:
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy2(source, place)
    _settle(place)


def _settle(place: Path) -> None:
    """Make a file read-only and flush it to the disk."""
    place.chmod(0o444)
    with place.open("rb") as file:
        os.fsync(file.fileno())
