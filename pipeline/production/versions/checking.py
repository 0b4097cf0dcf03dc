"""Whether what was published is still what it was: every file against the digest in its provenance.

Nothing is mended: a version is frozen, and what is to stand in the place of its files is for people to say.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

from pipeline.errors import MissingInputError
from pipeline.frames import FrameRange
from pipeline.production.store.paths import PUBLISHED, repeated
from pipeline.production.versions.provenance import FILE, Provenance, records
from pipeline.shot.yaml.lookup import digest_of_file, is_there


@dataclass(frozen=True)
class PublishedFile:
    """A file of a version, at `path`.

    record  what the version was made from; None where its provenance itself is at fault, which is the file
    number  the frame that it is; None if it is none
    digest  SHA-256 that it had when it was published
    fault   what is wrong with it, if anything
    """

    path: Path
    record: Provenance | None
    number: int | None = None
    digest: str = ""
    fault: str | None = None

    @property
    def version(self) -> Path:
        """The folder of its version."""
        return self.path.parents[0 if self.number is None else 1]


def published_files(root: Path) -> Iterator[PublishedFile]:
    """The files of all versions under a root, not looked at yet, of provenances those that cannot be read."""
    for home in sorted((root / PUBLISHED).glob("*")):
        for place, record in records(home):
            if isinstance(record, Provenance):
                for number, frame in record.frames.items():
                    yield PublishedFile(place / frame.file, record, number, frame.sha256)
                yield PublishedFile(place / record.movie["file"], record, None, record.movie["sha256"])
            else:
                yield PublishedFile(place / FILE, None, fault=str(record).removeprefix(f"{place / FILE}: "))


def checked(files: Iterable[PublishedFile], threads: int) -> Iterator[PublishedFile]:
    """The same files with what is wrong with them; changes nothing."""
    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(_checked, files)


def remedies(faulty: Iterable[PublishedFile], root: Path) -> Iterator[str]:
    """For each version among faulty files, a line that says how these are had again."""
    for version, files in groupby(faulty, key=lambda file: file.version):
        damaged = list(files)
        record, numbers = damaged[0].record, [file.number for file in damaged if file.number is not None]
        if record is None:
            yield f"{version}: nothing but its {FILE} tells what it was made from; restore that from a backup"
            continue
        only_frames = f" -f {FrameRange.of(numbers)}" if len(numbers) == len(damaged) else ""
        yield (
            f"{version}: flowsculpt render --from {version / FILE}{only_frames} makes it again, in "
            f"{root / repeated(record.shot, record.version)}; published files are never written to"
        )


def _checked(file: PublishedFile) -> PublishedFile:
    return replace(file, fault=file.fault or _fault(file))


def _fault(file: PublishedFile) -> str | None:
    if not is_there(file.path):
        return "is gone, and was published"
    try:
        found = digest_of_file(file.path)
    except MissingInputError as error:
        return str(error).removeprefix(f"{file.path}: ")
    return None if found == file.digest else "is not what was published: damaged, or altered since"
