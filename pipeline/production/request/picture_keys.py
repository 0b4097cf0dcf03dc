"""The keys of a take's pictures: what is rendered, and what is made of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pipeline.production.keys.digest import Key
from pipeline.production.request.cameras import CameraFile
from pipeline.production.store.store import Store

if TYPE_CHECKING:
    from pipeline.production.request.render_request import RenderRequest


@dataclass(frozen=True)
class FrameKeys:
    """Of what was rendered, and of what was made of it with what was rendered of the pictures in `window`."""

    raw: Key
    frame: Key
    window: tuple[int, ...]


class PictureKeys(Mapping[int, FrameKeys]):
    """The keys of a take's pictures, each found when it is asked for: most runs are about few of them.

    Those of what is rendered are looked up in the ledger first, and `note` notes those that it lacks.
    """

    def __init__(self, request: RenderRequest, store: Store, cameras: CameraFile) -> None:
        self._take, self._store, self._cameras = request, store, cameras
        self._ledger = request.source.ledger
        self._asked_for = set(request.requested)
        known = None if self._ledger is None else self._ledger.recall(*self._found_from)
        self._raws: dict[int, Key] = {int(number): key for number, key in (known or {}).items()}
        self._noted = len(self._raws)
        self._found: dict[int, FrameKeys] = {}

    def __getitem__(self, number: int) -> FrameKeys:
        if number not in self._found:
            window = self._take.window(number, self._is_there)
            around = [self._raw(n) for n in window] if len(window) > 1 else []
            raw = self._raw(number)
            self._found[number] = FrameKeys(raw, self._take.frame_key(raw, around), window)
        return self._found[number]

    def __iter__(self) -> Iterator[int]:
        return iter(self._take.angles)

    def __len__(self) -> int:
        return len(self._take.angles)

    def note(self) -> None:
        """Remember what was found beyond what the ledger knew."""
        if self._ledger is not None and len(self._raws) > self._noted:
            self._ledger.note(self._raws, *self._found_from)
            self._noted = len(self._raws)

    @property
    def _found_from(self) -> tuple[str, ...]:
        return "raw", self._take.identity, self._cameras.key

    def _is_there(self, number: int) -> bool:
        """Whether a picture was asked for, or was rendered before."""
        if number in self._asked_for:
            return True
        return number in self._take.angles and self._store.holds("raw", self._raw(number))

    def _raw(self, number: int) -> Key:
        if number not in self._raws:
            self._raws[number] = self._take.raw_key(number, self._cameras)
        return self._raws[number]
