"""What a half-done picture has found so far, in a file, so that another process goes on from there.

A file appears under its name whole or not at all, and holds sums as they were added up, in float64: the
picture that goes on from it is, to the last bit, the one that was never disturbed.
"""

from __future__ import annotations

import contextlib
import time
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.base.atomic_write import atomic_write
from render.base.errors import MachineError

State = Mapping[str, NDArray[Any]]

SECONDS = 10.0
"""Between two writings, at least: a picture that takes less is never kept, and pays nothing."""

LEAST_WORK = 50.0
"""How many times longer than its writing took a picture is rendered before the next, which so costs 2%."""


@dataclass
class Checkpoint:
    """Where the passes of one picture are kept while it is rendered.

    path     the file; its name says which picture this is, with all that decides it
    draft    what it is written to before it takes that name, on the same disk
    warn     is told, once each, what went wrong; a picture never fails for it
    urgent   whether the process is about to end
    seconds  between two writings, at least
    taken_up how many passes `load` has found
    """

    path: Path
    draft: Path
    warn: Callable[[str], None] = field(default=lambda message: None)
    urgent: Callable[[], bool] = field(default=lambda: False)
    seconds: float = SECONDS
    taken_up: int = field(default=0, init=False)
    _due: float = field(default=0.0, init=False)
    _refused: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        self._due = time.monotonic() + self.seconds

    def load(self) -> dict[str, NDArray[Any]] | None:
        """What was kept, `done` being the number of passes, or None. A file that cannot be read to its end is
        told of and removed."""
        try:
            with self.path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                found = {name: arrays[name] for name in arrays.files}
            self.taken_up = int(found["done"])
        except (FileNotFoundError, NotADirectoryError):
            return None
        except (OSError, zipfile.BadZipFile, ValueError, KeyError, EOFError, AttributeError) as error:
            self.warn(f"{self.path} cannot be read ({error}); its picture is rendered from the start")
            self.remove()
            return None
        return found

    def offer(self, state: Callable[[], State]) -> None:
        """Keep what passes have found, where that is due."""
        now = time.monotonic()
        if self._refused or not (self.urgent() or now >= self._due):
            return
        try:
            with atomic_write(self.path, self.draft, flush=False) as draft, draft.open("wb") as file:
                np.savez(file, allow_pickle=False, **state())  # a path would be given another suffix
        except MachineError as error:
            self._refused = True
            self.warn(f"{error}; if interrupted, its picture starts anew")
        spent = time.monotonic() - now
        self._due = now + spent + max(self.seconds, LEAST_WORK * spent)

    def remove(self) -> None:
        """Nothing is kept any more; what cannot be removed is left to the next run."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)
