# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the extension's zip: `python3 blender/build_extension.py`. Equal sources give equal bytes."""

from __future__ import annotations

import sys
import tomllib
import zipfile
from pathlib import Path

SOURCES = Path(__file__).resolve().parent
DATE = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip can say


def build_extension(folder: Path) -> Path:
    """Write the zip of the extension into a folder and return its path."""
    manifest = tomllib.loads((SOURCES / "blender_manifest.toml").read_text(encoding="utf-8"))
    target = folder / f"{manifest['id']}-blender-{manifest['version']}.zip"
    modules = [path for path in SOURCES.glob("*.py") if path.name != Path(__file__).name]
    files = [SOURCES / "blender_manifest.toml", SOURCES / "LICENSE", *modules]
    folder.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as packed:
        for path in sorted(files, key=lambda path: path.name):
            entry = zipfile.ZipInfo(path.name, DATE)
            entry.create_system, entry.external_attr = 3, 0o644 << 16  # on Windows as elsewhere
            entry.compress_type = zipfile.ZIP_DEFLATED
            packed.writestr(entry, path.read_bytes().replace(b"\r\n", b"\n"))
    return target


if __name__ == "__main__":
    print(build_extension(Path(sys.argv[1]) if len(sys.argv) > 1 else SOURCES.parent / "dist"))
