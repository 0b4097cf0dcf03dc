"""Checks that a fetched file has content of its kind, made for the requested key.

The digest in a file's name shows that it arrived as it was sent, not that an honest machine sent it: who may
write to the remote store names it as he likes. Surfaces and cameras are read as jobs read them; arrays and
pictures hold their keys; of other kinds only the form can be checked. What `flowsculpt audit` finds is
whether the values are right.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import ZipFile

from flowsculpt.api.files import from_plain
from flowsculpt.api.frames import StoredFiles

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
    return ".zip" if kind == KERNELS else StoredFiles(kind).suffix


def fault_of(kind: str, key: str, path: Path) -> str | None:
    """Return what is wrong with a fetched file, in words; None where it can be what was asked for."""
    suffix = suffix_of(kind)
    try:
        if suffix == ".json":
            read = _reader_of(kind, key)(path)
            if kind == "cameras":
                _require_cameras(read)
            elif not isinstance(read, dict):
                return "cannot be read (TypeError)"
        elif suffix == ".zip":
            with ZipFile(path) as packed:
                if (damaged := packed.testzip()) is not None:
                    return f"is damaged at {damaged}"
        elif suffix in (".exr", ".npz"):
            found = _key_of_picture(path) if suffix == ".exr" else _key_of_arrays(path)
            if found != key:
                return f"is the content of another file, {found}"
            if suffix == ".npz":
                _require_surface(kind, key, path)
        else:
            with path.open("rb") as file:
                if not re.match(_BEGINNINGS[suffix], file.read(16), re.DOTALL):
                    return f"is not a {suffix} file"
    except Exception as error:  # libraries raise all kinds for what they cannot read
        return f"cannot be read ({type(error).__name__})"
    return None


def _key_of_picture(path: Path) -> object:
    from flowsculpt.api.pictures import read_header  # OpenImageIO, which other kinds do not need

    return read_header(path).get("key")


def _key_of_arrays(path: Path) -> str:
    from flowsculpt.api.frames import StoredFiles

    return StoredFiles.key_in(path)


def _reader_of(kind: str, key: str) -> Callable[[Path], Any]:
    from flowsculpt.api.frames import StoredFiles  # takes a moment

    return StoredFiles(kind).reader(key)


def _require_surface(kind: str, key: str, path: Path) -> None:
    """Read a file of arrays to its end. Raises any error where it is not what its kind says."""
    arrays = _reader_of("shading" if kind == "normals" else kind, key)(path)
    if kind != "normals":
        return
    count = len(arrays["vertices"])
    vectors = ["vertices", "material", *(() if "radii" in arrays else ("normals",))]
    if any(arrays[name].shape != (count, 3) for name in vectors) or len(arrays["source_vertex"]) != count:
        raise ValueError("its arrays are not of one surface")
    if "radii" not in arrays:
        corners = arrays["faces"].reshape(-1, 3)
        if corners.size and not 0 <= corners.min() <= corners.max() < count:
            raise ValueError("it has a face without its vertices")


def _require_cameras(data: dict[str, object]) -> None:
    """Read the cameras of all frames. Raises BadInputError, or any error, for what is not a camera."""
    from flowsculpt.api.frames import Framing

    for number, camera in data.items():
        if number.isdecimal():
            from_plain(Framing, camera)
