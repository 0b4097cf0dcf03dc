"""Reading what production made."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pipeline.errors import FrameError
from pipeline.production.request.render_request import Take
from pipeline.production.store.store import CorruptFileError, Store

T = TypeVar("T")


def stored(take: Take, store: Store, kind: str, number: int, reader: Callable[[Path], T]) -> T:
    """The `mesh` or the `normals` of a frame. A corrupt one is forgotten, so that it is made anew.

    Raises FrameError.
    """
    key = take.mesh_key(number) if kind == "mesh" else take.normals_key(number)
    try:
        return reader(store.path(kind, key))
    except (CorruptFileError, FileNotFoundError) as error:
        store.discard(kind, key)
        place = take.place(kind, number)
        raise FrameError(f"{place} cannot be read to its end; run again to make it anew") from error
