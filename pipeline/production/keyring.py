"""The keys of a take's pictures: what is rendered, and what is made of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pipeline.production.framing import Framing
from pipeline.production.keys import Key
from pipeline.production.store import Store

if TYPE_CHECKING:
    from pipeline.production.take import Take


@dataclass(frozen=True)
class PictureKeys:
    """Of what was rendered, and of what was made of it with what was rendered of the pictures in `window`."""

    raw: Key
    frame: Key
    window: tuple[int, ...]


class Keyring(Mapping[int, PictureKeys]):
    """The keys of a take's pictures, each found when it is asked for: most runs are about few of them."""

    def __init__(self, take: Take, store: Store, framings: Mapping[int, Framing]) -> None:
        self._take, self._store, self._framings = take, store, framings
        self._asked_for = set(take.requested)
        self._raws: dict[int, Key] = {}
        self._found: dict[int, PictureKeys] = {}

    def __getitem__(self, number: int) -> PictureKeys:
        if number not in self._found:
            window = self._take.window(number, self._is_there)
            around = [self._raw(n) for n in window] if len(window) > 1 else []
            raw = self._raw(number)
            self._found[number] = PictureKeys(raw, self._take.frame_key(raw, around), window)
        return self._found[number]

    def __iter__(self) -> Iterator[int]:
        return iter(self._take.poses)

    def __len__(self) -> int:
        return len(self._take.poses)

    def _is_there(self, number: int) -> bool:
        """Whether a picture was asked for, or was rendered before."""
        if number in self._asked_for:
            return True
        return number in self._take.poses and self._store.holds("raw", self._raw(number))

    def _raw(self, number: int) -> Key:
        if number not in self._raws:
            self._raws[number] = self._take.raw_key(number, self._framings)
        return self._raws[number]
