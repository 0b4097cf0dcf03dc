"""All compiled kernels of this machine as one archive, for other machines with the same sources and versions.

It holds pickles, which run as code: whoever unpacks one must know where it comes from.
"""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.kernel_cache import all_kernels, folder_name, kernel_folders
from flowsculpt.render.base.user_cache import kernel_homes

_FILE = re.compile(r"[^/\\:]+\.kernel")


def pack_kernels(archive: Path) -> None:
    """Write all kernels of this machine to an archive. Raises MachineError where the disk refuses."""
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


def unpack_kernels(archive: Path) -> bool:
    """Write the kernels of an archive to where this machine looks for its own; return whether it has done so.

    Nothing is written of an archive that holds any other file. Raises MachineError where the disk refuses.
    """
    with zipfile.ZipFile(archive) as packed:
        names = [name.partition("/")[::2] for name in packed.namelist()]
        if any(folder not in all_kernels() or not _FILE.fullmatch(file) for folder, file in names):
            return False
        for folder, file in names:
            with atomic_write(kernel_homes()[1] / folder_name() / folder / file, flush=False) as draft:
                draft.write_bytes(packed.read(f"{folder}/{file}"))
    return True
