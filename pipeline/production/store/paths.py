"""Paths of files and folders, relative to the root."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from flowsculpt.pipeline.errors import MachineError
from flowsculpt.render.base.root_files import guard

STATE = Path(".flowsculpt")
STORE = STATE / "store"
"""The store; it may be a link to a folder on another disk, or another disk itself."""
PLANS = STATE / "plans"
EVENTS = STATE / "events"
LOGS = STATE / "logs"
DONE = STATE / "done"
"""Files by which Snakemake sees that jobs are done; each lists the keys of what its job has made."""
DIGESTS = STATE / "digests"
CHECKPOINTS = STATE / "checkpoints"

RENDERS = Path("renders")
PUBLISHED = RENDERS / "published"
REPEATED = RENDERS / "repeated"
NOTES = Path("notes")
"""The notes of reviewers, production data that `clean` leaves alone."""

SUFFIXES = {
    "mesh": ".npz",
    "normals": ".npz",
    "refined": ".npz",
    "cameras": ".json",
    "raw": ".exr",
    "frame": ".exr",
    "movie": ".mp4",
    "mov": ".mov",
    "mkv": ".mkv",
    "webp": ".webp",
    "avif": ".avif",
    "gif": ".gif",
    "png": ".png",
    "png16": ".png",
    "jpeg": ".jpg",
    "measures": ".json",
    "statistics": ".json",
}
"""Suffixes by kind of file."""

_NUMBERED = {
    "mesh": "meshes",
    "normals": "normals",
    "raw": "{}/raw",
    "frame": "{}/frames",
    "png": "{}/png",
    "png16": "{}/png16",
    "jpeg": "{}/jpeg",
    "statistics": "{}/statistics",
}
"""Folders of numbered files by kind; pictures lie in the folder of their quality."""


class RootFolders(NamedTuple):
    """The folders of a root.

    state      what runs keep for themselves: store, plans, logs, digests
    digests    records of what was written
    renders    what people look at
    published  versions of shots, which nothing overwrites
    repeated   roots in which versions are made again, each SHOT.VERSION
    notes      notes of reviewers
    """

    state: Path
    digests: Path
    renders: Path
    published: Path
    repeated: Path
    notes: Path


@dataclass(frozen=True)
class Folders:
    """The folders of one sequence of frames.

    home     renders/<shot>, or a folder within renders/<kind> for frames that a plug-in shows of a shot
    name     the part of file names before the frame number
    subject  the one of several subjects whose meshes have a folder of their own
    """

    home: Path
    name: str
    subject: str = ""

    @staticmethod
    def of_root(root: Path) -> RootFolders:
        """Return the folders below a root, whether they are there or not."""
        return RootFolders(*(root / place for place in (STATE, DIGESTS, RENDERS, PUBLISHED, REPEATED, NOTES)))

    @classmethod
    def of_shot(cls, name: str) -> Folders:
        """Return the folders of a shot."""
        return cls(RENDERS / name, name)

    @classmethod
    def of_kind(cls, kind: str, name: str) -> Folders:
        """Return the folders of frames that a plug-in shows of a shot, or of a file."""
        return cls(RENDERS / kind / name, name)

    @property
    def title(self) -> str:
        """The name in events and messages: with the subject, or the folder if it is of another name."""
        folder = "" if self.home.name == self.name else self.home.name
        detail = self.subject or folder
        return f"{self.name} ({detail})" if detail else self.name

    @property
    def part_name(self) -> str:
        """The part of file names before the frame number where each subject has files in one folder."""
        return f"{self.name}.{self.subject}" if self.subject else self.name

    def numbered(self, kind: str, quality: str, numbers: Iterable[int]) -> list[str]:
        """Return the paths of numbered files of a kind; `quality` matters for pictures only.

        They are strings: a plan names so many that making Path objects would take most of its time.
        """
        of_plugin = "." in kind  # the name of a plug-in's stage, whose files are raw
        within = f"{quality}/{kind}" if of_plugin else _NUMBERED[kind].format(quality)
        suffix = SUFFIXES["raw" if of_plugin else kind]
        if self.subject and kind in ("mesh", "normals"):
            within = f"{within}/{self.subject}"
        begin = f"{self.home}/{within}/{self.name}."
        return [f"{begin}{number:04d}{suffix}" for number in numbers]

    def cameras(self) -> Path:
        return self.home / f"{self.name}.cameras.json"

    def movie(self, quality: str, frames: str | None = None) -> Path:
        """The movie of all frames, or of a range: `<shot>.10-20x2.mp4`."""
        return self.home / quality / (f"{self.name}.{frames}.mp4" if frames else f"{self.name}.mp4")


def film(quality: str, name: str) -> Path:
    """The film of an edit; it is named like the edit."""
    return Path("renders") / "film" / quality / f"{name}.mp4"


def require_store(root: Path) -> None:
    """Guard a root. Raise MachineError where its store is a link to a folder that is not there."""
    guard(root)
    store = root / STORE
    if store.is_symlink() and not store.is_dir():
        raise MachineError(
            f"{store}: links to {store.readlink()}, which is not a folder; mount its disk, or change the link"
        )


def of_edit(shot: str, edit: str) -> Path:
    """The folder of a shot in an edit that has a picture of its own."""
    return RENDERS / "edit" / shot / edit
