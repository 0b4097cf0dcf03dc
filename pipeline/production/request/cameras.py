"""The file of a take's cameras: each is built when it is asked for."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from pipeline.errors import FrameError
from pipeline.production.keys.digest import Key
from pipeline.production.store.store import Store
from render.base.errors import BadInputError

if TYPE_CHECKING:
    from pipeline.production.render_inputs.framing import Framing


class CameraFile(Mapping[int, "Framing"]):
    """Camera and stage of every picture of a take, by number."""

    def __init__(self, store: Store, key: Key, data: Mapping[int, Any]) -> None:
        self._store, self.key, self._data = store, key, data
        self._built: dict[int, Framing] = {}

    @classmethod
    def of(cls, store: Store, key: Key, numbers: Iterable[int]) -> CameraFile | None:
        """Where the store has it; what cannot be read is forgotten, to be found anew."""
        try:
            data = json.loads(store.path("cameras", key).read_text())
            return cls(store, key, {number: data[str(number)] for number in numbers})
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError):  # cut short
            store.discard("cameras", key)
            return None

    def __getitem__(self, number: int) -> Framing:
        """Raises FrameError where it cannot be read; the file is then forgotten."""
        if number not in self._built:
            from pipeline.production.render_inputs.framing import Framing

            try:
                self._built[number] = Framing.from_data(self._data[number])
            except (ValueError, TypeError, AttributeError, BadInputError) as error:
                self._store.discard("cameras", self.key)
                raise FrameError("its camera cannot be read; run again to frame the shot again") from error
        return self._built[number]

    def __iter__(self) -> Iterator[int]:
        return iter(self._data)

    def __len__(self) -> int:
        return len(self._data)

    def __contains__(self, number: object) -> bool:
        return number in self._data
