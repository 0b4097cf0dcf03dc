"""Paths of files and folders, relative to the root."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

STATE = Path(".flowsculpt")
PLANS = STATE / "plans"
EVENTS = STATE / "events"
LOGS = STATE / "logs"
DONE = STATE / "done"
"""Files by which Snakemake sees that jobs are done; each lists the keys of what its job has made."""
CHECKPOINTS = STATE / "checkpoints"
PUBLISHED = Path("renders") / "published"

_KINDS = {
    "mesh": ("meshes", ".npz"),
    "normals": ("normals", ".npz"),
    "raw": ("{}/raw", ".exr"),
    "frame": ("{}/frames", ".exr"),
    "png": ("{}/png", ".png"),
    "png16": ("{}/png16", ".png"),
    "jpeg": ("{}/jpeg", ".jpg"),
    "statistics": ("{}/statistics", ".json"),
}
"""Folder and suffix of numbered files by kind; pictures lie in the folder of their quality."""


@dataclass(frozen=True)
class Folders:
    """The folders of one sequence of frames, of a shot or a turntable.

    home  renders/<shot>, or renders/turntable/<name>
    name  the part of file names before the frame number
    """

    home: Path
    name: str

    @classmethod
    def of_shot(cls, name: str) -> Folders:
        return cls(Path("renders") / name, name)

    @classmethod
    def of_turntable(cls, name: str, look: str | None = None) -> Folders:
        """Return the folders of a turntable; one of several looks has a folder of its own."""
        home = Path("renders") / "turntable" / name
        return cls(home / look if look else home, name)

    def numbered(self, kind: str, quality: str, numbers: Iterable[int]) -> list[str]:
        """Return the paths of numbered files of a kind; `quality` matters for pictures only.

        They are strings: a plan names so many that making Path objects would take most of its time.
        """
        within, suffix = _KINDS[kind]
        begin = f"{self.home}/{within.format(quality)}/{self.name}."
        return [f"{begin}{number:04d}{suffix}" for number in numbers]

    def cameras(self) -> Path:
        return self.home / f"{self.name}.cameras.json"

    def movie(self, quality: str, frames: str | None = None) -> Path:
        """The movie of all frames, or of a range: `<shot>.10-20x2.mp4`."""
        return self.home / quality / (f"{self.name}.{frames}.mp4" if frames else f"{self.name}.mp4")


def film(quality: str, name: str) -> Path:
    """The film of an edit; it is named like the edit."""
    return Path("renders") / "film" / quality / f"{name}.mp4"


def published(name: str) -> Path:
    """The folder of a shot's published versions."""
    return PUBLISHED / name


def repeated(name: str, version: str) -> Path:
    """The root in which a published version is made again."""
    return Path("renders") / "repeated" / f"{name}.{version}"


def wedge(name: str) -> Path:
    """The folder of a shot's wedges: cells and sheets."""
    return Path("renders") / "wedge" / name
