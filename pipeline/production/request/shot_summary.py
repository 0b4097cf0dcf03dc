"""What planning asks of a shot again and again, found once: its frames, its files, the keys of its meshes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.production.keys.digest import Key, key_of
from pipeline.production.request.input_digests import InputDigests, are_unchanged, pins_of
from pipeline.production.store.paths import STATE

if TYPE_CHECKING:
    from pipeline.shot import Shot


@dataclass(frozen=True)
class ShotSummary:
    """A shot as planning sees it.

    pins             the files that it reads, and what they held
    listings         the folders that these lie in, and keys of what is there: a name with a * may fit more
    runs_python      whether its flows are Python files of the user's
    rate, shown_as   frames per second, and what is between its light and the pictures of a display
    meshes, normals  keys by frame
    """

    pins: InputDigests
    listings: tuple[tuple[str, Key], ...]
    runs_python: bool
    frames: tuple[int, ...]
    rate: str
    shown_as: Mapping[str, Any]
    meshes: Mapping[int, Key]
    normals: Mapping[int, Key]

    @classmethod
    def of(cls, shot: Shot) -> ShotSummary:
        from pipeline.flow.python_file import python_flows
        from pipeline.production.keys.mesh_keys import mesh_keys, normals_keys

        pins, meshes = pins_of(shot.files), mesh_keys(shot.motion)
        return cls(
            pins=pins,
            listings=_listings(pins),
            runs_python=any(True for _ in python_flows(shot.motion.flow)),
            frames=shot.frames.numbers,
            rate=str(shot.rate),
            shown_as=shot.picture.display_data(),
            meshes=meshes,
            normals=normals_keys(shot, meshes),
        )

    @property
    def holds(self) -> bool:
        """Whether all that the shot read beside shot files is as it was."""
        return are_unchanged(self.pins) and _listings(self.pins) == self.listings

    def as_data(self) -> dict[str, Any]:
        return dict(vars(self))

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> ShotSummary:
        return cls(
            pins=_pairs(data["pins"]),
            listings=_pairs(data["listings"]),
            runs_python=data["runs_python"],
            frames=tuple(data["frames"]),
            rate=data["rate"],
            shown_as=data["shown_as"],
            meshes=_numbered(data["meshes"]),
            normals=_numbered(data["normals"]),
        )


def can_be_remembered(shot: Shot) -> bool:
    """Whether its pins tell all that was read: a colour config may find tables in any folder below it."""
    return not shot.picture.view.digest


def _pairs(data: Iterable[list[str]]) -> tuple[tuple[str, str], ...]:
    return tuple((path, key) for path, key in data)


def _numbered(data: Mapping[str, Key]) -> dict[int, Key]:
    return {int(number): key for number, key in data.items()}


def _listings(pins: InputDigests) -> tuple[tuple[str, Key], ...]:
    folders = sorted({str(Path(path).parent) for path, _ in pins})
    return tuple((folder, _names_in(folder)) for folder in folders)


def _names_in(folder: str) -> Key:
    try:
        return key_of(sorted(path.name for path in Path(folder).iterdir() if path.name != STATE.name))
    except OSError:
        return ""
