"""Compiled kernels in the remote store, so that a farm's nodes do not compile what another machine has.

They are one archive for each set of sources, versions and level of processor. It holds pickles, which run as
code, and whoever may write to a remote store could put others there. So a machine takes an archive only where
its digest is in the plan that it works by, or where its user asks for it by `flowsculpt doctor --prepare`.
"""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path

from flowsculpt.pipeline.production.store.digests import DIGITS, digest_of
from flowsculpt.pipeline.production.store.remote_store import LOG, RemoteStore, is_read_only
from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.remaining_kernels import note_no_remaining_kernels
from flowsculpt.render.base.user_cache import kernel_homes

KERNELS = "kernels"
"""The kind of archives of compiled kernels, which stores of roots do not have."""


def send_kernels(remote: RemoteStore) -> str:
    """Upload the kernels of this machine where the remote store lacks them; return `KEY.DIGEST`.

    Return an empty string where not all are compiled, or the remote store does not take them. Raises
    MachineError where the disk refuses the archive.
    """
    if not has_kernels(key := kernels_key()):
        return ""
    archive = kernel_homes()[1] / f"{key}.zip"
    if not archive.exists():
        from flowsculpt.render.base.kernel_archive import pack_kernels

        pack_kernels(archive)
    digest = digest_of(archive)
    there = digest in remote.digests(KERNELS).get(key, ())
    sent = there or (not is_read_only() and remote.send(KERNELS, key, archive, digest))
    return f"{key}.{digest}" if sent else ""


def fetch_kernels(remote: RemoteStore, planned: str | None = None) -> bool:
    """Fetch the kernels for this machine from the remote store, if it lacks some; return whether it did.

    planned  `KEY.DIGEST` of those that may be taken; None to trust whoever may write to the remote store

    Raises MachineError where the disk refuses them.
    """
    key, _, digest = (planned or kernels_key()).partition(".")
    if has_kernels(key) or key != kernels_key():  # for other processors or sources
        return False
    from flowsculpt.render.base.kernel_archive import unpack_kernels

    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "kernels.zip"
        found = remote.fetch(KERNELS, key, draft)
        if found is None or found != (digest or found):
            return False
        if not unpack_kernels(draft):
            LOG.warning(
                f"{remote.url}: the archive of kernels {key} holds other files; nothing of it is used"
            )
            return False
    note_all_compiled()
    return True


def has_kernels(key: str) -> bool:
    """Tell whether this machine has all kernels of a key of `kernels_key`, without importing numba."""
    return any((home / f"complete-{key}").exists() for home in kernel_homes())


def kernels_key() -> str:
    """Return the digest of all that decides what is compiled on this machine."""
    from flowsculpt.render.base.kernel_cache import (  # numba, which many jobs never need
        all_kernels,
        folder_name,
    )

    parts = "\n".join([folder_name(), *all_kernels()])
    return hashlib.blake2b(parts.encode(), digest_size=DIGITS // 2).hexdigest()


def note_all_compiled() -> None:
    """Note that this machine has all kernels. Raises MachineError where the disk refuses."""
    if not has_kernels(key := kernels_key()):
        with atomic_write(kernel_homes()[1] / f"complete-{key}", flush=False) as draft:
            draft.touch()
    note_no_remaining_kernels()
