"""The files that a shot reads, pinned: what a plan was made for is what its jobs read, or they say so."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from pipeline.errors import MissingInputError, UsageError
from pipeline.shot.yaml.lookup import digest_of_file

InputDigests = tuple[tuple[str, str], ...]
"""Paths and the SHA-256 of their contents, in the order of the paths."""


def pins_of(files: Iterable[tuple[Path, str]]) -> InputDigests:
    return tuple(sorted((str(path), digest) for path, digest in files))


def are_unchanged(pins: InputDigests) -> bool:
    """Whether every file is what it was."""
    return next(_changed_files(pins), None) is None


def require_unchanged(pins: InputDigests) -> None:
    """Raises UsageError for the first file that is not what it was."""
    for path in _changed_files(pins):
        raise _changed(path)


def _changed_files(pins: InputDigests) -> Iterator[str]:
    for path, digest in pins:
        try:
            now = digest_of_file(Path(path))
        except MissingInputError:
            now = ""
        if now != digest:
            yield path


def require_same(pins: InputDigests, others: InputDigests) -> None:
    """Raises UsageError for the first file that is in one of both only, or with other contents."""
    differing = sorted(set(pins) ^ set(others))
    if differing:
        raise _changed(differing[0][0])


def _changed(path: str) -> UsageError:
    return UsageError(f"{path}: it was changed since the work was planned; run again")
