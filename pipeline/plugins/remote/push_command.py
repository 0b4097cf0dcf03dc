"""The command `push`: upload stored files that the remote store lacks."""

from __future__ import annotations

from functools import cache

import typer

from flowsculpt import MachineError, UsageError
from flowsculpt.api import plural
from flowsculpt.api.commands import print_result
from flowsculpt.api.frames import Locks, Store
from flowsculpt.api.options import Common


def push(common: Common) -> None:
    """Upload stored files that the remote store lacks, such as those made before there was one.

    Runs upload what they make, and what an earlier run could not. `flowsculpt push --store s3://bucket/show`
    uploads the rest; `--dry-run` counts the files. `flowsculpt verify` repairs damaged files first.
    """
    store = Store(common.root)
    if store.remote is None:
        raise UsageError("push: no remote store is set; name one with --store or FLOWSCULPT_STORE")
    if not store.may_upload:
        raise UsageError(
            f"push: {store.url} may only be read here; leave out --store-read-only and "
            "FLOWSCULPT_STORE_READ_ONLY"
        )
    if fault := store.remote.fault():
        raise MachineError(f"{store.url}: {fault}")
    if common.dry_run:
        sent, unsent = len(lacking_names(store)), 0
    else:
        with Locks(common.root).hold_with_writers(common.wait):
            sent, unsent = store.upload_missed(lacking_names(store))
    verb = "Would upload" if common.dry_run else "Uploaded"
    words = f"{verb} {plural(sent, 'file')} to {store.url}."
    if unsent:
        words += f" It did not take {unsent}; run again."
    print_result(words, {"uploaded": sent, "refused": unsent}, common.json)
    raise typer.Exit(MachineError.exit_code if unsent else 0)


def lacking_names(store: Store) -> list[tuple[str, str]]:
    """Return kind and key of the stored files that the remote store lacks, without reading them."""
    if store.remote is None:
        return []
    there = cache(store.remote.digests)
    return [(kind, key) for kind, key, _ in store.entries() if key not in there(kind)]
