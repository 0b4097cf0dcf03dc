"""Locks of a root, which the system releases when their process ends, however it ends.

Every writer shares the root's lock, task processes too; what removes files from the store (`clean`, `verify`)
holds it alone. A run holds the lock of each shot and quality that it writes. A job that makes files which
qualities share holds a lock of their key: another waits, and then finds them. Reading takes no lock.
"""

from __future__ import annotations

import contextlib
import errno
import getpass
import json
import os
import platform
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from flowsculpt.pipeline.errors import MachineError
from flowsculpt.pipeline.production.store.paths import STATE
from flowsculpt.render.base.atomic_write import disk_errors
from flowsculpt.render.base.root_files import open_file, remove_file, require_own_folders
from flowsculpt.render.base.state_files import read_state
from flowsculpt.render.base.user_cache import user_number

LOCKS = STATE / "locks"
ROOT = STATE / "lock"

POLL_SECONDS = 0.2
_OPEN: set[int] = set()
"""Descriptors of the locks that this process holds. A process that it forks would go on holding them."""

UNSUPPORTED = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)
"""Error numbers of network file systems without locks."""


class TakenError(Exception):
    """Another process holds a lock.

    holder  its user, host, process and time, in words
    """

    def __init__(self, holder: str) -> None:
        super().__init__(holder)
        self.holder = holder


@dataclass(frozen=True)
class Locks:
    """The locks of a root."""

    root: Path

    @staticmethod
    def name(home: str, quality: str) -> str:
        """Return the name of the lock of a shot, or of another folder of pictures, at a quality."""
        return re.sub(r"[^\w.=,-]", "+", f"{home}.{quality}")

    @contextmanager
    def hold_with_writers(self, wait: bool = False) -> Iterator[None]:
        """Hold the lock of the root with all others that write to it.

        Raises MachineError where `clean` or `verify` holds it alone, unless this is to `wait` for them.
        """
        require_own_folders(self.root)
        try:
            with _held(self.root / ROOT, shared=True, wait=(lambda: None) if wait else None):
                yield
        except TakenError as taken:
            raise MachineError(
                f"{self.root}: another flowsculpt run removes files from the store: {taken.holder}. "
                "Wait for it."
            ) from None

    @contextmanager
    def hold_alone(self) -> Iterator[None]:
        """Hold the lock of the root alone. Raises MachineError where anybody writes to it."""
        require_own_folders(self.root)
        try:
            with _held(self.root / ROOT):
                yield
        except TakenError:
            holders = ", ".join(_holders(self.root)) or "its processes are ending"
            raise MachineError(
                f"{self.root}: another flowsculpt run is writing here: {holders}. Wait for it, or stop it."
            ) from None

    @contextmanager
    def hold(self, names: Mapping[str, str], wait: bool = False) -> Iterator[bool]:
        """Hold the locks of what a run writes, by their names; yield whether it had to wait for one.

        names  in words what each lock is for, such as `A010_cube at draft`

        Raises MachineError, with the holder, where another run holds one, unless this is to `wait` for it.
        """
        waited: list[None] = []
        with ExitStack() as locks:
            for name, words in sorted(names.items()):
                try:
                    waits = (lambda: waited.append(None)) if wait else None
                    locks.enter_context(_held(self.root / LOCKS / f"{name}.lock", words, wait=waits))
                except TakenError as taken:
                    raise MachineError(
                        f"{words}: another flowsculpt run is making it: {taken.holder}. Wait for it, or stop "
                        "it; --wait waits."
                    ) from None
            yield bool(waited)

    @contextmanager
    def hold_key(self, key: str, waits: Callable[[], object]) -> Iterator[None]:
        """Hold the lock of files that qualities share; call `waits` now and then while another has it."""
        with _held(self.root / LOCKS / f"{key}.key", wait=waits):
            yield


@contextmanager
def _held(
    path: Path, words: str = "", shared: bool = False, wait: Callable[[], object] | None = None
) -> Iterator[None]:
    """Hold a lock. Raises TakenError where another process does, unless `wait` is given and called."""
    from portalocker import AlreadyLocked, LockException, LockFlags, lock  # not needed to read

    kind = LockFlags.SHARED if shared else LockFlags.EXCLUSIVE
    with disk_errors(path):
        while True:
            descriptor = open_file(path, os.O_RDWR | os.O_CREAT)
            try:
                lock(descriptor, kind | LockFlags.NON_BLOCKING)
            except AlreadyLocked:
                os.close(descriptor)
                if wait is None:
                    raise TakenError(_holder_in(path)) from None
                wait()
                time.sleep(POLL_SECONDS)
                continue
            except LockException as error:
                os.close(descriptor)
                if getattr(error.__cause__, "errno", None) not in UNSUPPORTED:
                    raise error.__cause__ or error from None
                descriptor = -1
                break
            if _is_at(descriptor, path):
                break
            os.close(descriptor)  # removed by its holder meanwhile
        if descriptor >= 0 and not shared:
            with contextlib.suppress(OSError):  # a full disk; `clean` must work there
                os.ftruncate(descriptor, 0)
                os.write(descriptor, json.dumps(_myself(words)).encode())
    if descriptor >= 0:
        _OPEN.add(descriptor)
    try:
        yield
    finally:
        if descriptor >= 0:
            _OPEN.remove(descriptor)
            if not shared and path.name != ROOT.name:
                with suppress(PermissionError):  # Windows keeps files that are open; it holds nobody up
                    remove_file(path)
            os.close(descriptor)


def _leave_to_parent() -> None:
    """Close the locks of the process that forked this one; that one holds them still."""
    for descriptor in _OPEN:
        os.close(descriptor)
    _OPEN.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_to_parent)


def _is_at(descriptor: int, path: Path) -> bool:
    with contextlib.suppress(OSError):
        return os.path.samestat(os.fstat(descriptor), path.stat())
    return False


def _myself(words: str) -> dict[str, str | int]:
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # a process of a container may have no name
        user = str(user_number())
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    return {"user": user, "host": platform.node(), "process": os.getpid(), "since": since, "words": words}


def _holder_in(path: Path) -> str:
    words = "{user} on {host}, process {process}, since {since}"
    return read_state(path, lambda holder: words.format(**holder)) or "a process that has not said who it is"


def _holders(root: Path) -> Iterator[str]:
    """Yield what runs make now, and who they are."""
    for path in sorted((root / LOCKS).glob("*.lock")):
        if (words := read_state(path, lambda holder: str(holder["words"]))) is not None:
            yield f"{words} by {_holder_in(path)}"
