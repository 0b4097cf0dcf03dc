"""Files from outside: models, points, fields, pictures, sounds, code. Whoever reads one opens it here.

They may be anything, also damaged or hostile. A file is regular, of bounded size, and read only as far as its
size says: named pipes, devices and the files of /proc, which have no size, keep nobody waiting.
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import shutil
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from flowsculpt.render.base.render_errors import (
    BadInputError,
    FlowsculptError,
    MachineError,
    MissingInputError,
    reason_of,
)

MOST_BYTES = 8 << 30
"""Size of the largest file that is read."""

_MOST_HASHED = 1 << 40  # size of the largest file that is hashed; movies are of any length

_POINTERS, _LARGEST_POINTER = (b"version https://git-lfs.github.com/spec/", b"version https://hawser."), 1024
"""Beginnings of the pointers that Git LFS puts in place of files, and their largest size, bytes."""

_CONTENTS = (
    (rb"\s*(?:<!--.*?-->\s*)?<(?:!doctype\s+html|html)\b", "an HTML page", ()),
    (rb"PK(?:\x03\x04|\x05\x06)", "a ZIP archive", ("3mf", "usdz", "npz")),
    (rb"\x1f\x8b", "a gzip archive", ()),
    (rb"7z\xbc\xaf\x27\x1c|Rar!\x1a", "a 7z or RAR archive", ()),
    (rb"\0\x05\x16\x07", "a file that macOS writes beside another (AppleDouble)", ()),
    (rb"bplist00", "a property list of macOS, as of a file that is only in iCloud", ()),
    (rb"%PDF-", "a PDF", ()),
    (rb"glTF", "a GLB", ("glb", "gltf")),
    (rb"Kaydara FBX Binary", "an FBX", ("fbx",)),
    (rb"PXR-USDC|#usda ", "a USD stage", ("usd", "usda", "usdc")),
    (rb"BLENDER", "a file of Blender", ()),
    (rb"ply\r?\n", "a PLY", ("ply",)),
    (rb"\x89PNG|\xff\xd8\xff", "a PNG or JPEG", ("png", "jpg", "jpeg")),
    (rb"\xabKTX ", "a KTX texture", ()),
    (rb"....ftyp(?:avif|avis|heic|mif1)", "an AVIF or HEIC picture", ()),
    (rb"\0{128,}\Z", "nothing but bytes of 0, so its copy was not finished", ()),
)
"""Beginnings of contents that files have by mistake, what they are, and suffixes that they belong to."""

_BEGINNING = 1 << 12  # bytes by which contents are known

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def kind_of_path(path: Path) -> str:
    """Return what a path that is no regular file names: `a folder`, `a device`; empty for other paths."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return ""
    return next((kind for is_kind, kind in _KINDS if is_kind(mode)), "")


@dataclass(frozen=True)
class InputFile:
    """A file from outside, of up to `most` bytes.

    Each method that reads it raises MissingInputError if no regular file is there, or only a pointer of Git
    LFS; BadInputError if it is larger; and MachineError if the disk fails.
    """

    path: Path
    most: int = MOST_BYTES

    def is_there(self) -> bool:
        """Tell whether the path names a file; a name too long for a file does not."""
        try:
            return self.path.is_file()
        except OSError as error:
            if error.errno in (errno.EIO, errno.ESTALE):
                raise MachineError.of_path(self.path, error, "read") from None
            return False
        except ValueError:
            return False

    def size(self) -> int:
        """Return its number of bytes."""
        path = self.path
        kind = kind_of_path(path)
        if kind:
            raise MissingInputError(f"{path}: it is {kind}; it must be a regular file. Name another.")
        try:
            size = path.stat().st_size
            is_pointer = 0 < size <= _LARGEST_POINTER and path.read_bytes().startswith(_POINTERS)
        except FileNotFoundError:
            raise MissingInputError(f"{path}: file not found; check the path") from None
        except (OSError, ValueError) as error:
            raise _unreadable(path, error) from None
        if is_pointer:
            fact = "it is a pointer of Git LFS, and the file itself is not there"
            raise MissingInputError(f"{path}: {fact}. Run git lfs pull.")
        if size > self.most:
            limit = size_of(self.most)
            raise BadInputError(f"{path}: it has {size_of(size)}; files of up to {limit} are read")
        return size

    @contextmanager
    def open(self) -> Iterator[tuple[BinaryIO, int]]:
        """Open it; yield it with the number of bytes to read of it.

        An OSError of the block is a MissingInputError too: it reads the file.
        """
        self.size()
        try:
            file = open(self.path, "rb", opener=_without_waiting)  # noqa: SIM115  # Path.open takes no opener
        except (OSError, ValueError) as error:
            raise _unreadable(self.path, error) from None
        try:
            with file:
                facts = os.fstat(file.fileno())
                if not stat.S_ISREG(facts.st_mode) or facts.st_size > self.most:  # replaced in between
                    raise BadInputError(f"{self.path}: it was changed while it was opened; run again")
                yield file, facts.st_size
        except OSError as error:
            raise _unreadable(self.path, error) from None

    def content(self) -> bytes:
        """Return all of it."""
        with self.open() as (file, size):
            return file.read(size)

    def digest(self) -> str:
        """Return the SHA-256 of its content, however large it is."""
        digest = hashlib.sha256()
        with replace(self, most=_MOST_HASHED).open() as (file, size):
            while size > 0 and (block := file.read(min(size, 1 << 20))):
                digest.update(block)
                size -= len(block)
        return digest.hexdigest()


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # a named pipe would wait for its writer


@contextmanager
def copied_to_memory(path: Path) -> Iterator[Path]:
    """Yield the path of a copy of a file in memory; its own path where the system has no files in memory.

    For libraries that take a read that was interrupted, or gave less than was asked for, for the end of a
    file: network file systems do both. Raises OSError.
    """
    if not hasattr(os, "memfd_create"):
        yield path
        return
    with path.open("rb") as source, os.fdopen(os.memfd_create(path.suffix), "wb") as copy:
        shutil.copyfileobj(source, copy, 1 << 20)
        copy.flush()
        yield Path(f"/proc/self/fd/{copy.fileno()}")


def other_content(path: Path) -> str:
    """Return what the content of a file is where its suffix says otherwise: `an HTML page`; else nothing."""
    try:
        with InputFile(path).open() as (file, _):
            head = file.read(_BEGINNING)
    except FlowsculptError:
        return ""
    suffix = path.suffix.lower().lstrip(".")
    for beginning, name, own in _CONTENTS:
        if re.match(beginning, head, re.DOTALL | re.IGNORECASE):
            return "" if suffix in own else name
    return ""


def joint_digest(digests: Sequence[str]) -> str:
    """Return the digest of several files: of one alone its own, else the SHA-256 of all digests."""
    return digests[0] if len(digests) == 1 else hashlib.sha256("\n".join(digests).encode()).hexdigest()


@contextmanager
def parsing(path: Path, kind: str, remedy: str) -> Iterator[None]:
    """Turn every error of a parser into a BadInputError with the file, its expected kind, and the reason."""
    try:
        yield
    except FlowsculptError:
        raise
    except Exception as error:  # parsers and decompressors raise anything
        other = other_content(path)
        reason = f"it is {other}" if other else reason_of(error)
        raise BadInputError(f"{path}: cannot be read as {kind} ({reason}). {remedy}") from error


def size_of(count: int) -> str:
    """Return a number of bytes for a message: `12 bytes`, `8 GiB`."""
    for shift, unit in ((30, "GiB"), (20, "MiB"), (10, "KiB")):
        if count >> shift:
            return f"{count >> shift} {unit}"
    return f"{count} byte{'' if count == 1 else 's'}"


def _unreadable(path: Path, error: Exception) -> FlowsculptError:
    """Return the error of a file that is there: of the machine where its disk fails, else of the input."""
    if isinstance(error, OSError) and error.errno in (errno.EIO, errno.ESTALE):
        return MachineError.of_path(path, error, "read")
    reason = error.strerror if isinstance(error, OSError) else str(error)
    return MissingInputError(f"{path}: it cannot be read ({reason}); check its permissions")
