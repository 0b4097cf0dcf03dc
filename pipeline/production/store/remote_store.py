"""The remote store as the core sees it: files of many roots under their keys, on another machine.

The plug-in that adds it knows addresses and file systems. Without an address nothing of it is loaded.
"""

from __future__ import annotations

import logging
import os
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugin import plugins

VARIABLE = "FLOWSCULPT_STORE"
"""The environment variable that holds the address. Processes and farms pass it on to their jobs."""

READ_ONLY = "FLOWSCULPT_STORE_READ_ONLY"
"""The environment variable that keeps processes from writing to the remote store, by 1."""

LOG = logging.getLogger("flowsculpt.store")
"""Logger of warnings, which the command line and jobs pass on to the user."""

SIDE_BY_SIDE = 16
"""Requests that are made at once."""


class RemoteStore(Protocol):
    """A remote store. It raises no error where it does not answer: it then holds nothing.

    url   its address
    told  the warnings that this process has logged
    """

    url: str

    @property
    def told(self) -> Collection[str]: ...

    def holds(self, kind: str, key: str) -> bool:
        """Tell whether it has a file of `key` that is not known to be damaged."""
        ...

    def digests(self, kind: str) -> Mapping[str, Sequence[str]]:
        """Return the digests of all files of a kind, by key."""
        ...

    def fault(self) -> str | None:
        """Ask it for a listing; return what is wrong with it, or None."""
        ...

    def fetch(self, kind: str, key: str, draft: Path) -> str | None:
        """Write the file of `key` to `draft`; return its digest, or None where there is no whole one."""
        ...

    def send(self, kind: str, key: str, path: Path, digest: str, replace: bool = False) -> bool:
        """Upload the file of `key`; return whether it is there now. `replace` removes others of `key`."""
        ...

    def reject(self, kind: str, key: str) -> None:
        """Remove the files of `key`: they are what was sent, and cannot be read."""
        ...


class RemoteStores(ABC):
    """The contract of plug-ins that know remote stores by their addresses; made without arguments."""

    @abstractmethod
    def checked(self, typed: str) -> str:
        """Return the address that a user typed. Raises UsageError or MachineError where it cannot be used."""

    @abstractmethod
    def opened(self, url: str) -> RemoteStore:
        """Return the store at an address, one for each process. Raises what `checked` raises."""

    @abstractmethod
    def load(self, url: str) -> None:
        """Import what the store at an address needs, without starting a thread."""


def store_url() -> str | None:
    """Return the address of the remote store that the environment names, or None."""
    return os.environ.get(VARIABLE) or None


def is_read_only() -> bool:
    """Tell whether the environment keeps this process from writing to the remote store."""
    return os.environ.get(READ_ONLY, "") not in ("", "0")


def remote_stores() -> RemoteStores:
    """Return what finds remote stores. Raises UsageError where no plug-in does."""
    contract: Any = RemoteStores  # which is abstract
    stores: list[RemoteStores] = list(plugins().objects("remote_stores", contract).values())
    if not stores:
        remedy = plugins().lacking("--store") or f"Leave out --store, and {VARIABLE} empty."
        raise UsageError(f"no plug-in knows remote stores. {remedy}")
    return stores[0]


def use_store(typed: str | None) -> None:
    """Have this process and those that it starts share the remote store at an address, or none.

    Raises UsageError and MachineError for an address that cannot be used.
    """
    if typed:
        os.environ[VARIABLE] = remote_stores().checked(typed)
    else:
        os.environ.pop(VARIABLE, None)
