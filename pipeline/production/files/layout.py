"""Where things lie under the root, as paths relative to it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

STATE = Path(".flowsculpt")
PLANS = STATE / "plans"
EVENTS = STATE / "events"
LOGS = STATE / "logs"
MARKS = STATE / "jobs"
"""Of jobs that are done while a run lasts: what Snakemake goes by."""
HALVES = STATE / "half"
PUBLISHED = Path("renders") / "published"


@dataclass(frozen=True)
class Folders:
    """The folders of one sequence of frames: a shot's, or a turntable's.

    home      renders/<shot>, or renders/turntable/<name>
    name      what files are called before the frame number
    """

    home: Path
    name: str

    @classmethod
    def of_shot(cls, name: str) -> Folders:
        return cls(Path("renders") / name, name)

    @classmethod
    def of_turntable(cls, name: str) -> Folders:
        return cls(Path("renders") / "turntable" / name, name)

    def _frame(self, within: str, number: int, suffix: str) -> Path:
        return _file_of(self, within, number, suffix)

    def mesh(self, number: int) -> Path:
        return self._frame("meshes", number, ".npz")

    def normals(self, number: int) -> Path:
        return self._frame("normals", number, ".npz")

    def cameras(self) -> Path:
        return self.home / f"{self.name}.cameras.json"

    def raw(self, quality: str, number: int) -> Path:
        return self._frame(f"{quality}/raw", number, ".exr")

    def frame(self, quality: str, number: int) -> Path:
        return self._frame(f"{quality}/frames", number, ".exr")

    def still(self, quality: str, form: str, number: int, suffix: str) -> Path:
        """A frame as a display shows it, in a folder for each form."""
        return self._frame(f"{quality}/{form}", number, suffix)

    def statistics(self, quality: str, number: int) -> Path:
        """What rendering a picture took: not the same twice, and so beside the picture and not in it."""
        return self._frame(f"{quality}/statistics", number, ".json")

    def movie(self, quality: str, frames: str | None = None) -> Path:
        """The film of all frames, or of a range: `<shot>.10-20x2.mp4`."""
        return self.home / quality / (f"{self.name}.{frames}.mp4" if frames else f"{self.name}.mp4")


@lru_cache(maxsize=2**14)
def _file_of(folders: Folders, within: str, number: int, suffix: str) -> Path:
    """Planning asks for the files of a shot several times, and taking paths apart is most of that."""
    return Path(f"{folders.home}/{within}/{folders.name}.{number:04d}{suffix}")


def film(quality: str, name: str) -> Path:
    """The film of an edit, which is called as the edit is."""
    return Path("renders") / "film" / quality / f"{name}.mp4"


def published(name: str) -> Path:
    """Where the versions of a shot are frozen."""
    return PUBLISHED / name


def repeated(name: str, version: str) -> Path:
    """The root of its own in which a published version is made again."""
    return Path("renders") / "repeated" / f"{name}.{version}"


def wedge(name: str) -> Path:
    """Where the cells of a shot's wedges lie, and their sheets."""
    return Path("renders") / "wedge" / name
