"""Checks that a fetched file has content of its kind, made for the requested key.

The digest in a file's name shows that it arrived as it was sent, not that an honest machine sent it: who may
write to the remote store names it as he likes. Pictures and arrays hold their keys; of other kinds only the
form can be checked. What `flowsculpt audit` finds is whether the values are right.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from zipfile import ZipFile

from pipeline.production.store.paths import SUFFIXES
from pipeline.production.store.store import Key

KERNELS = "kernels"
"""The kind of archives of compiled kernels, which stores of roots do not have."""

_BEGINNINGS = {
    ".mp4": rb".{4}ftyp",
    ".mov": rb".{4}(ftyp|moov|wide|mdat)",
    ".mkv": rb"\x1a\x45\xdf\xa3",
    ".webp": rb"RIFF.{4}WEBP",
    ".avif": rb".{4}ftypavi[fs]",
    ".gif": rb"GIF8[79]a",
    ".png": rb"\x89PNG\r\n\x1a\n",
    ".jpg": rb"\xff\xd8\xff",
}
"""How files without a key begin, by suffix."""


def suffix_of(kind: str) -> str:
    """Return the suffix that files of a kind have in a remote store."""
    return ".zip" if kind == KERNELS else SUFFIXES[kind]


def fault_of(kind: str, key: Key, path: Path) -> str | None:
    """Return what is wrong with a fetched file, in words; None where it can be what was asked for."""
    suffix = suffix_of(kind)
    try:
        if suffix == ".json":
            json.loads(path.read_bytes())
        elif suffix == ".zip":
            with ZipFile(path) as packed:
                if (damaged := packed.testzip()) is not None:
                    return f"is damaged at {damaged}"
        elif suffix in (".exr", ".npz"):
            found = _key_of_picture(path) if suffix == ".exr" else _key_of_arrays(path)
            return None if found == key else f"is the content of another file, {found}"
        else:
            with path.open("rb") as file:
                if not re.match(_BEGINNINGS[suffix], file.read(16), re.DOTALL):
                    return f"is not a {suffix} file"
    except Exception as error:  # libraries raise all kinds for what they cannot read
        return f"cannot be read ({type(error).__name__})"
    return None


def _key_of_picture(path: Path) -> object:
    from render.post.image import read_header  # OpenImageIO, which other kinds do not need

    return read_header(path).get("key")


def _key_of_arrays(path: Path) -> Key:
    from pipeline.production.store.readers import key_in

    return key_in(path)
