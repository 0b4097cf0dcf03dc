"""The address of the remote store, checked and opened as a file system, and requests to it.

Neither holds credentials. Each file system finds them where its own tools do: S3 in `AWS_PROFILE`,
`AWS_ACCESS_KEY_ID` or `~/.aws`, and the server in `AWS_ENDPOINT_URL`.

A request that fails is made again for some seconds. Then a warning is logged, and for a minute, later longer,
nothing is asked: whoever asks gets `UnreachableError` at once.
"""

from __future__ import annotations

import errno
import logging
import random
import re
import shlex
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

from flowsculpt import MachineError, UsageError
from flowsculpt.api import suggest
from flowsculpt.api.files import python_command

LOG = logging.getLogger("flowsculpt.store")
"""Its warnings are passed on to the user."""

OPTION = "--store"

EXAMPLES = "s3://bucket/show, or a folder such as /mnt/share/show"

CONNECT_SECONDS = 5.0  # seconds until a server that does not accept a connection counts as absent
READ_SECONDS = 20.0  # seconds without a byte after which an answer counts as lost


def checked_url(typed: str) -> str:
    """Return the address that a user typed, a folder's made absolute.

    Raises UsageError for an address that cannot be one, MachineError where its package is not installed.
    """
    from fsspec.registry import known_implementations  # takes a moment, and most runs have no remote store

    text = typed.strip()
    where = f"{OPTION} {_without_password(text)}"
    if not text.isprintable() or not text:
        raise UsageError(f"{OPTION} {typed!r}: is empty or contains control characters; write {EXAMPLES}")
    scheme, separator, rest = text.partition("://")
    if not separator:
        return f"file://{_folder(text, where)}"
    if scheme not in known_implementations:
        likely = suggest(scheme, _USUAL)
        raise UsageError(f"{where}: {scheme}:// is not known. {likely}")
    if not rest.strip("/"):
        raise UsageError(f"{where}: a bucket or folder must follow; write {EXAMPLES}")
    _check_host(text, where)
    module = known_implementations[scheme]["class"].partition(".")[0]
    if find_spec(module) is None:
        raise MachineError(
            f"{where}: {scheme}:// needs the package {module}, which is not installed; install it "
            f"for the Python of flowsculpt: {shlex.join(python_command('pip', 'install', module))}"
        )
    return text


def _folder(text: str, where: str) -> Path:
    """Return the absolute path of a folder. Raises UsageError for a mistyped address."""
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:", text):
        raise UsageError(f"{where}: an address has :// after its scheme, as {EXAMPLES}; a folder is ./{text}")
    try:
        return Path(text).expanduser().absolute()
    except RuntimeError as error:  # ~ of a user without a home
        raise UsageError(f"{where}: {error}; write {EXAMPLES}") from None


def _check_host(text: str, where: str) -> None:
    """Raise UsageError where the bucket, the host or the port of an address cannot be one."""
    scheme, _, rest = text.partition("://")
    try:
        parts = urlsplit(text)
        has_password = parts.password is not None
        if scheme not in _BUCKETS:
            _ = parts.port  # parsed when it is asked for
    except ValueError as error:
        raise UsageError(f"{where}: cannot be parsed ({error}); write {EXAMPLES}") from None
    if has_password:
        raise UsageError(
            f"{where}: it contains a password, which would end up in logs; leave it out, and put credentials "
            "in the file system's own settings (docs/farm.md)"
        )
    bucket = rest.partition("/")[0]
    if scheme in _BUCKETS and not re.fullmatch(r"[\w.-]+|arn:[\w:.-]+", bucket, re.ASCII):
        raise UsageError(
            f"{where}: {bucket!r} cannot name a bucket; names have letters, digits, . and -. "
            "Set AWS_ENDPOINT_URL for a server of your own"
        )
    if scheme in ("file", "local") and not rest.startswith("/"):
        raise UsageError(f"{where}: an absolute path must follow, as in file:///mnt/share/show")


def load_package(url: str) -> None:
    """Import the package of an address, which takes a moment. It starts no thread."""
    from fsspec import get_filesystem_class

    with suppress(ImportError, ValueError):  # whoever opens the address says so
        get_filesystem_class(url.partition("://")[0])


def open_url(url: str) -> tuple[Any, str]:
    """Return the fsspec file system of a checked address, and the path in it. Nothing is asked yet.

    Raises MachineError where its package cannot be loaded.
    """
    from fsspec.core import url_to_fs

    scheme, options = url.partition("://")[0], dict[str, Any](use_listings_cache=False)
    if scheme in ("file", "local"):
        options["auto_mkdir"] = True
    elif scheme in ("s3", "s3a"):
        once = {"total_max_attempts": 1}  # trying again is `RemoteStore`'s
        seconds = {"connect_timeout": CONNECT_SECONDS, "read_timeout": READ_SECONDS}
        options |= {"config_kwargs": {**seconds, "retries": once, "max_pool_connections": 64}}
    try:
        files, path = url_to_fs(url, **options)
    except (ImportError, TypeError, ValueError) as error:  # TypeError: not a file system of its own
        raise MachineError(f"{url}: cannot be opened: {error}") from error
    if scheme in ("s3", "s3a"):
        files.retries = 1
    return files, path.rstrip("/")


_BUCKETS = ("s3", "s3a")

_USUAL = ("s3", "file", "gs", "abfs", "sftp", "smb", "memory")


def _without_password(text: str) -> str:
    """Return an address without the user and the password in it."""
    scheme, separator, rest = text.partition("://")
    host, slash, path = rest.partition("/")
    return f"{scheme}{separator}{host.rpartition('@')[2]}{slash}{path}"


T = TypeVar("T")

PATIENCE = 5.0  # seconds for which a request that failed is tried again

FIRST_PAUSE = 0.25  # seconds before the second try; each further pause is twice as long

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
    """Requests to one file system of fsspec.

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
        self.warn(f"{self.url}: {fault}; continuing without it. New files stay; the next run uploads them")

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
