"""Compiled kernels in the remote store, so that a farm's nodes do not compile what another machine has.

They are one archive for each set of sources, versions and level of processor. It holds pickles, which run as
code, and whoever may write to a remote store could put others there. So a machine takes an archive only where
its digest is in the plan that it works by, or where its user asks for it by `flowsculpt doctor --prepare`.
"""

from __future__ import annotations

import re
import tempfile
import zipfile
from pathlib import Path

from flowsculpt.api.files import atomic_write
from flowsculpt.api.frames import LOG, RemoteStore, digest_of, note_all_compiled
from flowsculpt.pipeline.plugins.remote.fetched_content import KERNELS
from flowsculpt.pipeline.production.store.remote_store import has_kernels, is_read_only, kernels_key
from flowsculpt.render.base.user_cache import kernel_homes

_FILE = re.compile(r"[^/\\:]+\.kernel")


def send_kernels(remote: RemoteStore) -> str:
    """Upload the kernels of this machine where the remote store lacks them; return `KEY.DIGEST`.

    Return an empty string where not all are compiled, or the remote store does not take them. Raises
    MachineError where the disk refuses the archive.
    """
    if not has_kernels(key := kernels_key()):
        return ""
    archive = kernel_homes()[1] / f"{key}.zip"
    if not archive.exists():
        _pack(archive)
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
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "kernels.zip"
        found = remote.fetch(KERNELS, key, draft)
        if found is None or found != (digest or found):
            return False
        if not _unpack(draft):
            LOG.warning(
                f"{remote.url}: the archive of kernels {key} holds other files; nothing of it is used"
            )
            return False
    note_all_compiled()
    return True


def _pack(archive: Path) -> None:
    """Write all kernels of this machine to an archive."""
    from flowsculpt.render.base.kernel_cache import all_kernels, kernel_folders

    files = {
        f"{name}/{path.name}": path
        for folder in kernel_folders()
        for name in all_kernels()
        for path in sorted((folder / name).glob("*.kernel"))
    }
    with (
        atomic_write(archive, flush=False) as draft,
        zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as packed,
    ):
        for name, path in files.items():
            info = zipfile.ZipInfo(name)  # without a time: the same kernels are the same archive everywhere
            packed.writestr(info, path.read_bytes(), zipfile.ZIP_DEFLATED)


def _unpack(archive: Path) -> bool:
    """Write the kernels of an archive to where this machine looks for its own; return whether it has done so.

    Nothing is written of an archive that holds any other file.
    """
    from flowsculpt.render.base.kernel_cache import all_kernels, folder_name

    with zipfile.ZipFile(archive) as packed:
        names = [name.partition("/")[::2] for name in packed.namelist()]
        if any(folder not in all_kernels() or not _FILE.fullmatch(file) for folder, file in names):
            return False
        for folder, file in names:
            with atomic_write(kernel_homes()[1] / folder_name() / folder / file, flush=False) as draft:
                draft.write_bytes(packed.read(f"{folder}/{file}"))
    return True
