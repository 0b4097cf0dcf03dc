"""Checkpoints of frames: the sums of their sample batches so far, from which another process resumes."""

from __future__ import annotations

import contextlib
import time
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.render_errors import MachineError
from flowsculpt.render.base.root_files import remove_file
from flowsculpt.render.base.state_files import UNUSABLE

SECONDS = 10.0
"""Least time between two checkpoints: a frame that takes less has none and pays nothing."""

MIN_WORK = 50.0
"""Least rendering time between two checkpoints, over the time that writing one took: they cost 2%."""


@dataclass
class Checkpoint:
    """The checkpoint of one frame: a file, written atomically, with the sums as added, in float64.

    A resumed frame is the same to the last bit as one that was never interrupted.

    path     the file; its name must say everything that decides the picture
    draft    temporary file on the same file system
    warn     is called with a message, once per fault; a frame never fails by its checkpoint
    urgent   True if the process is about to end
    seconds  least time between two checkpoints
    resumed  sample batches that `load` has read
    """

    path: Path
    draft: Path
    warn: Callable[[str], None] = field(default=lambda message: None)
    urgent: Callable[[], bool] = field(default=lambda: False)
    seconds: float = SECONDS
    resumed: int = field(default=0, init=False)
    _due: float = field(default=0.0, init=False)
    _refused: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        self._due = time.monotonic() + self.seconds

    def load(self) -> dict[str, NDArray[Any]] | None:
        """Return the stored state, with the number of batches as `done`, or None.

        A damaged file is reported by `warn` and removed.
        """
        try:
            with self.path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                state = {name: arrays[name] for name in arrays.files}
            self.resumed = int(state["done"])
        except (FileNotFoundError, NotADirectoryError):
            return None
        except (*UNUSABLE, zipfile.BadZipFile, zlib.error, EOFError) as error:
            self.warn(f"{self.path} cannot be read ({error}); its picture is rendered from the start")
            self.remove()
            return None
        return state

    def save_if_due(self, state: Callable[[], Mapping[str, NDArray[Any]]]) -> None:
        """Write a checkpoint if one is due. `state` is called only then."""
        now = time.monotonic()
        if self._refused or not (self.urgent() or now >= self._due):
            return
        try:
            with atomic_write(self.path, self.draft, flush=False) as draft, draft.open("wb") as file:
                np.savez(file, allow_pickle=False, **state())  # a path would be given another suffix
        except MachineError as error:
            self._refused = True
            self.warn(f"{error}; if interrupted, its picture starts again")
        spent = time.monotonic() - now
        self._due = now + spent + max(self.seconds, MIN_WORK * spent)

    def remove(self) -> None:
        """Remove the file. One that cannot be removed is left to the next run."""
        with contextlib.suppress(OSError):
            remove_file(self.path)
