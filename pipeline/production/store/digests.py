"""Digests of the files that we write: BLAKE2b, 128 bits, in records below `.flowsculpt/digests`.

A folder has a record for each host that writes to it, with a line for each file: `DIGEST  NAME`, as
`b2sum -l 128` writes them. Lines are only appended, each by one call and before its file takes its name, so a
process may be killed at any moment. A file is whole where any of its lines has its digest: hosts may make one
file at the same moment, and one made again may differ. A file without a line was made before there were
digests, or not by us.
"""

from __future__ import annotations

import hashlib
import os
import platform
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from flowsculpt.pipeline.production.store.paths import DIGESTS
from flowsculpt.render.base.atomic_write import atomic_write, disk_errors
from flowsculpt.render.base.root_files import appended, remove_file

SUFFIX = ".b2"

CHUNK = 1 << 20
"""Bytes that are read and hashed at a time."""

DIGITS = 32
"""Hexadecimal digits of a digest."""

ALTERED = "differs from what the run wrote: damaged, or altered since"


class CorruptFileError(Exception):
    """Raised for a file that cannot be read to its end, or does not hold what was written to it."""


def digest_of(path: Path) -> str:
    """Return the digest of a file's bytes. Raises OSError."""
    digest = hashlib.blake2b(digest_size=DIGITS // 2)
    with path.open("rb", buffering=0) as file:
        while chunk := file.read(CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


@dataclass(frozen=True)
class Digests:
    """The records of one root folder. Files outside of it have none."""

    root: Path

    def add(self, path: Path, content: Path | None = None) -> str:
        """Record the digest of a file under its name, and return it; read `content` where `path` does not
        hold it yet.

        Raises MachineError where the disk refuses.
        """
        digest = digest_of(content or path)
        self.add_known(path, digest)
        return digest

    def add_known(self, path: Path, digest: str) -> None:
        """Record the digest of a file under its name. Raises MachineError where the disk refuses."""
        self._append(path, [digest])

    def add_copy(self, path: Path, source: Path) -> None:
        """Record that `path` holds what was written to `source`. Raises MachineError."""
        self._append(path, self.known(source)[-1:])

    def known(self, path: Path) -> Sequence[str]:
        """Return the digests of what was written to a file, the last at the end; none if not known."""
        return self.in_folder(path.parent).get(path.name, ())

    def in_folder(self, folder: Path) -> Mapping[str, Sequence[str]]:
        """Return the digests of what was written to the files of a folder, by their names."""
        known: defaultdict[str, list[str]] = defaultdict(list)
        for record in self._records(folder):
            for line in record.read_bytes().split(b"\n")[:-1]:
                known[os.fsdecode(line[DIGITS + 2 :])].append(line[:DIGITS].decode("ascii", "replace"))
        return known

    def folders(self) -> Iterator[Path]:
        """Yield the folders that have records, each below the root."""
        top = self.root / DIGESTS
        for home, _, names in os.walk(top):
            if any(name.endswith(SUFFIX) for name in names):
                yield self.root / Path(home).relative_to(top)

    def check(self, path: Path) -> bool:
        """Compare a file with its digest; tell whether it has one.

        Raises CorruptFileError where its content is another, OSError where it cannot be read.
        """
        known = self.known(path)
        if known and digest_of(path) not in known:
            raise CorruptFileError(f"{path}: {ALTERED}")
        return bool(known)

    def prune(self) -> None:
        """Forget files that are gone, and what a file held before.

        Only the holder of the root's lock may call this.
        """
        for folder in self.folders():
            for record in self._records(folder):
                lines = record.read_bytes().split(b"\n")[:-1]
                last = {line[DIGITS + 2 :]: line for line in lines}
                kept = [line for name, line in last.items() if (folder / os.fsdecode(name)).is_file()]
                if not kept:
                    remove_file(record)
                elif len(kept) < len(lines):
                    with atomic_write(record, flush=False) as draft:
                        draft.write_bytes(b"".join(line + b"\n" for line in kept))

    def _append(self, path: Path, digests: Sequence[str]) -> None:
        home = self._home(path.parent)
        if home is None or not digests:
            return
        record, name = home / f"{platform.node()}{SUFFIX}", os.fsencode(path.name)
        with disk_errors(record), appended(record) as file:
            lines = b"".join(b"%s  %s\n" % (digest.encode(), name) for digest in digests)
            if file.tell() and file.seek(-1, os.SEEK_END) >= 0 and file.read(1) != b"\n":
                lines = b"\n" + lines  # a full disk cut the last line short
            while (file.write(lines) or 0) < len(lines):  # it fills up; the next try raises the error
                lines = b"\n" + lines.lstrip()

    def _records(self, folder: Path) -> list[Path]:
        home = self._home(folder)
        with suppress(FileNotFoundError, NotADirectoryError):
            return [path for path in home.iterdir() if path.suffix == SUFFIX] if home else []
        return []

    def _home(self, folder: Path) -> Path | None:
        """Return the folder of the records of a folder; None outside of the root."""
        place = Path(os.path.relpath(folder, self.root))
        return None if place.parts[:1] == (os.pardir,) else self.root / DIGESTS / place
