"""The published versions of a shot as sequences of pictures."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.errors import FlowsculptError
from pipeline.production.picture_sequences import (
    PLAIN,
    PictureDisplay,
    PictureSequence,
    SequenceQuery,
    display_of,
)
from pipeline.production.request.provenance import Provenance, records, restored
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.paths import published


def published_sequences(query: SequenceQuery) -> Iterator[PictureSequence]:
    """Yield the frames of every published version of a shot."""
    name = query.path.stem
    for place, record in records(query.project.root / published(name)):
        if isinstance(record, Provenance) and query.includes(record.quality):
            files = {number: place / frame.file for number, frame in record.frames.items()}
            yield PictureSequence(
                shot=name,
                kind="version",
                label=f"{record.version} {record.quality}",
                quality=record.quality,
                subject=name,
                numbers=tuple(sorted(record.frames)),
                files={number: path for number, path in files.items() if path.is_file()},
                display=_display_of(record, query.project.allow_code),
                faults={},
                seconds={number: frame.seconds for number, frame in record.frames.items()},
                note=_note_of(record),
                source=record.source,
            )


def _display_of(record: Provenance, allow_code: bool) -> PictureDisplay:
    try:
        return display_of(RenderRequest(restored(record, allow_code), record.quality, record.variant, ()))
    except FlowsculptError:
        return PLAIN


def _note_of(record: Provenance) -> str:
    """Return the note of a version, and of a patch which frames it replaced."""
    notes = [record.note] if record.note else []
    if record.patch:
        notes.append("patch of {version}: frames {frames} are new".format(**record.patch))
    return "; ".join(notes)
