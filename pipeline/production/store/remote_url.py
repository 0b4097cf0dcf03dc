"""The address of the remote store: read from the environment, checked, and opened as a file system.

Credentials are no part of it. Each file system finds them where its own tools do: S3 in `AWS_PROFILE`,
`AWS_ACCESS_KEY_ID` or `~/.aws`, and the server in `AWS_ENDPOINT_URL`.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from pipeline.errors import MachineError, UsageError, suggestion

VARIABLE = "FLOWSCULPT_STORE"
"""The environment variable that holds the address. Processes and farms pass it on to their jobs."""

OPTION = "--store"

EXAMPLES = "s3://bucket/show, or a folder such as /mnt/share/show"

CONNECT_SECONDS = 5.0
"""Seconds until a server that does not accept a connection counts as absent."""

READ_SECONDS = 20.0
"""Seconds without a byte after which an answer counts as lost."""


def store_url() -> str | None:
    """Return the address of the remote store that the environment names, or None."""
    return os.environ.get(VARIABLE) or None


def checked_url(text: str) -> str:
    """Return the address that a user typed, a folder's made absolute.

    Raises UsageError for an address that cannot be one, MachineError where its package is not installed.
    """
    from fsspec.registry import known_implementations  # takes a moment, and most runs have no remote store

    scheme, separator, rest = text.partition("://")
    if not separator:
        return f"file://{Path(text).expanduser().absolute()}"
    if scheme not in known_implementations:
        likely = suggestion(scheme, _USUAL)
        raise UsageError(f"{OPTION} {_without_password(text)}: {scheme}:// is not known. {likely}")
    if not rest.strip("/"):
        raise UsageError(f"{OPTION} {text}: a bucket or folder must follow; write {EXAMPLES}")
    if urlsplit(text).password is not None:
        raise UsageError(
            f"{OPTION} {_without_password(text)}: it holds a password, which would end up in logs; leave it "
            "out, and give credentials to the file system's own settings (docs/farm.md)"
        )
    module = known_implementations[scheme]["class"].partition(".")[0]
    if find_spec(module) is None:
        raise MachineError(
            f"{OPTION} {text}: {scheme}:// needs the package {module}, which is not installed; install it "
            f"for the Python of flowsculpt: {sys.executable} -m pip install {module}"
        )
    return text


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
    except (ImportError, ValueError) as error:
        raise MachineError(f"{url}: cannot be opened: {error}") from error
    if scheme in ("s3", "s3a"):
        files.retries = 1
    return files, path.rstrip("/")


_USUAL = ("s3", "file", "gs", "abfs", "sftp", "smb", "memory")


def _without_password(text: str) -> str:
    """Return an address without the user and the password in it."""
    scheme, separator, rest = text.partition("://")
    host, slash, path = rest.partition("/")
    return f"{scheme}{separator}{host.rpartition('@')[2]}{slash}{path}"
