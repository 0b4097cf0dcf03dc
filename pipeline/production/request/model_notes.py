"""Notes on the model of a shot, each told once: what was repaired in its file, and a place far away."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pipeline.production.store.paths import STATE

if TYPE_CHECKING:
    from pipeline.production.request.render_request import RenderRequest


def new_notes(request: RenderRequest) -> Sequence[str]:
    """Return the notes on a model that this process read, unless its content has had the same before."""
    notes, cache = request.shot.motion.subject.notes, request.source.cache
    told_of = "notes on a model", request.source.summary.inputs, notes
    if not notes or cache.get(*told_of):
        return ()
    if cache.root is not None:
        with contextlib.suppress(OSError):
            (cache.root / STATE).mkdir(parents=True, exist_ok=True)
    cache.put(True, *told_of)
    return notes
