"""Requests to the file system of the remote store, made again where they fail, and its faults in words.

A request that fails is made again for some seconds. Then a warning is logged, and for a minute, later longer,
nothing is asked: whoever asks gets `UnreachableError` at once.
"""

from __future__ import annotations

import errno
import random
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

from pipeline.production.store.remote_store import LOG
from render.base.render_errors import MachineError

T = TypeVar("T")

PATIENCE = 5.0
"""Seconds for which a request that failed is tried again."""

FIRST_PAUSE = 0.25
"""Seconds before the second try; each further pause is twice as long."""

REQUEST_SECONDS = 300.0
"""Seconds that one request may take, the transfer of a file too: of 900 MB at 3 MB/s."""

SILENT_SECONDS = 60.0
"""Seconds for which a remote store that failed is left alone; twice as many each further time, up to
MAX_SILENT_SECONDS."""

MAX_SILENT_SECONDS = 3600.0


class UnreachableError(Exception):
    """Raised where the remote store does not answer; a warning was logged."""


@dataclass(eq=False)
class RemoteRequests:
    """Requests to one file system.

    url    the address of the remote store, for messages
    files  the fsspec file system
    told   the warnings that this process has logged
    fault  what is wrong with the remote store, in words; None where it answered last
    """

    url: str
    files: Any
    told: set[str] = field(default_factory=set)
    fault: str | None = None
    _silent_until: float = 0.0
    _silence: float = SILENT_SECONDS
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def is_silent(self) -> bool:
        """True while the remote store is left alone."""
        return time.monotonic() < self._silent_until

    def call(self, method: str, *arguments: Any, **options: Any) -> Any:
        """Call a method of the file system; one that can be ended ends after REQUEST_SECONDS."""
        if not self.files.async_impl:
            return getattr(self.files, method)(*arguments, **options)
        import asyncio  # takes a moment, and most runs have no remote store

        from fsspec.asyn import sync

        async def bounded() -> Any:
            request = getattr(self.files, f"_{method}")(*arguments, **options)
            return await asyncio.wait_for(request, REQUEST_SECONDS)

        return sync(self.files.loop, bounded)

    def tried(self, request: Callable[[], T]) -> T:
        """Make a request, again and again for PATIENCE seconds. Raises UnreachableError, after a warning."""
        pause, deadline = FIRST_PAUSE, time.monotonic() + (PATIENCE if self.fault is None else 0.0)
        while True:
            if self.is_silent:
                raise UnreachableError
            try:
                answer = request()
            except MachineError:  # of this machine's disk
                raise
            except Exception as error:  # each file system has errors of its own
                fault, is_final = _fault_of(error)
                if is_final or time.monotonic() + pause > deadline:
                    self._leave_alone(fault)
                    raise UnreachableError from error
                time.sleep(pause * random.uniform(0.5, 1.0))
                pause *= 2.0
            else:
                self.fault, self._silence = None, SILENT_SECONDS
                return answer

    def _leave_alone(self, fault: str) -> None:
        """Warn of what is wrong, and ask for nothing for a while."""
        with self._lock:
            self.fault = fault
            if self.is_silent:
                return
            self._silent_until = time.monotonic() + self._silence
            self._silence = min(2.0 * self._silence, MAX_SILENT_SECONDS)
        self.warn(
            f"{self.url}: {fault}; continuing without it. New files stay here, and the next run uploads them"
        )

    def warn(self, message: str) -> None:
        """Log a warning, each once."""
        with self._lock:
            if message in self.told:
                return
            self.told.add(message)
        LOG.warning(message)


NO_FOLDER = "no such bucket or folder; create it, and check the spelling"

_FAULTS: tuple[tuple[str, str, bool], ...] = (
    ("PermissionError|AccessDenied", "permission denied; check its credentials", True),
    ("Credential|ProfileNotFound|TokenRetrieval", "no credentials for it were found", True),
    ("FileNotFoundError|NotADirectoryError", NO_FOLDER, True),
    ("NotImplementedError", "it can only be read", True),
    ("Timeout|Connection|Connect|gaierror|Disconnected", "it does not answer", False),
)
"""Names of classes of errors, what they mean, and whether trying again is useless."""


def _fault_of(error: Exception) -> tuple[str, bool]:
    """Return what an error of a file system means, in words, and whether it is final."""
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "it is full", True
    name = type(error).__name__
    for pattern, words, is_final in _FAULTS:
        if re.search(pattern, name):
            return words, is_final
    text = str(error).strip().partition("\n")[0]
    return f"it answers {text or name!r}", False
