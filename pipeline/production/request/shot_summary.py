"""The summary of a shot for planning: its frames, the files it reads, the keys of its meshes and normals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import MissingInputError, UsageError
from pipeline.production.store.paths import STATE
from pipeline.production.store.store import Key, key_of
from pipeline.shot.yaml.lookup import digest_of_file

if TYPE_CHECKING:
    from pipeline.shot import Shot

InputDigests = tuple[tuple[str, str], ...]
"""Paths of the files that a shot reads, in order, and the SHA-256 of their contents."""


@dataclass(frozen=True)
class ShotSummary:
    """A shot as planning sees it.

    inputs           the files that it reads, and their digests
    listings         folders of these files, and digests of the names in them: a name with * may match more
    runs_python      True if its flows are Python files of the user's
    rate, shown_as   frames per second; the display transform, plain data
    meshes, normals  keys by frame
    """

    inputs: InputDigests
    listings: tuple[tuple[str, str], ...]
    runs_python: bool
    frames: tuple[int, ...]
    rate: str
    shown_as: Mapping[str, Any]
    meshes: Mapping[int, Key]
    normals: Mapping[int, Key]

    @classmethod
    def of(cls, shot: Shot) -> ShotSummary:
        from pipeline.flow.flow import python_flows
        from pipeline.production.request.keys import mesh_keys, normals_keys

        inputs, meshes = input_digests(shot.files), mesh_keys(shot.motion)
        return cls(
            inputs=inputs,
            listings=_listings(inputs),
            runs_python=any(True for _ in python_flows(shot.motion.flow)),
            frames=shot.frames.numbers,
            rate=str(shot.rate),
            shown_as=shot.picture.display_data(),
            meshes=meshes,
            normals=normals_keys(shot, meshes),
        )

    @property
    def is_current(self) -> bool:
        """True if all files that the shot reads, shot files aside, are as they were."""
        return next(_changed(self.inputs), None) is None and _listings(self.inputs) == self.listings


def can_be_cached(shot: Shot) -> bool:
    """Tell whether the digests cover all that was read; a colour config may find tables in any folder."""
    return not shot.picture.view.digest


def input_digests(files: Iterable[tuple[Path, str]]) -> InputDigests:
    """Return paths and digests in the order of the paths."""
    return tuple(sorted((str(path), digest) for path, digest in files))


def require_unchanged(inputs: InputDigests) -> None:
    """Raise UsageError for the first file that is not as it was."""
    for path in _changed(inputs):
        raise _changed_since(path)


def require_same(inputs: InputDigests, others: InputDigests) -> None:
    """Raise UsageError for the first file that only one of both has, or with other contents."""
    differing = sorted(set(inputs) ^ set(others))
    if differing:
        raise _changed_since(differing[0][0])


def _changed(inputs: InputDigests) -> Iterator[str]:
    for path, digest in inputs:
        try:
            now = digest_of_file(Path(path))
        except MissingInputError:
            now = ""
        if now != digest:
            yield path


def _changed_since(path: str) -> UsageError:
    return UsageError(f"{path}: it was changed since the work was planned; run again")


def _listings(inputs: InputDigests) -> tuple[tuple[str, str], ...]:
    folders = sorted({str(Path(path).parent) for path, _ in inputs})
    return tuple((folder, _names_in(folder)) for folder in folders)


def _names_in(folder: str) -> str:
    try:
        return key_of(sorted(path.name for path in Path(folder).iterdir() if path.name != STATE.name))
    except OSError:
        return ""
