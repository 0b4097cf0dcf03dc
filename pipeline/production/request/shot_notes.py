"""Notes on the model and the sounds of a shot, each told once: what was repaired, and where a sound ends."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pipeline.production.store.paths import STATE

if TYPE_CHECKING:
    from pipeline.production.request.render_request import RenderRequest


def new_notes(request: RenderRequest) -> Sequence[str]:
    """Return the notes on the files of a shot, unless the same contents have had the same notes before."""
    shot, cache = request.shot, request.source.cache
    notes = (*(note for part in shot.parts for note in part.motion.subject.notes), *shot.notes)
    told_of = "notes on files", request.source.summary.inputs, notes
    if not notes or cache.get(*told_of):
        return ()
    if cache.root is not None:
        with contextlib.suppress(OSError):
            (cache.root / STATE).mkdir(parents=True, exist_ok=True)
    cache.put(True, *told_of)
    return notes
