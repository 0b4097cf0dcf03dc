"""Where things lie under the root, as paths relative to it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

STATE = Path(".flowsculpt")
PLANS = STATE / "plans"
EVENTS = STATE / "events"
LOGS = STATE / "logs"
MARKS = STATE / "jobs"
"""Of jobs that are done while a run lasts: what Snakemake goes by."""
HALVES = STATE / "half"
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
"""In which folder of a sequence its files of a kind lie, of pictures below that of their quality."""


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
    def of_turntable(cls, name: str, look: str | None = None) -> Folders:
        """Those of one of several looks lie in its folder."""
        home = Path("renders") / "turntable" / name
        return cls(home / look if look else home, name)

    def numbered(self, kind: str, quality: str, numbers: Iterable[int]) -> list[str]:
        """Files of a kind, one a number; `quality` is that of pictures.

        As text: a plan names so many that making paths would take it longer than all else.
        """
        within, suffix = _KINDS[kind]
        begin = f"{self.home}/{within.format(quality)}/{self.name}."
        return [f"{begin}{number:04d}{suffix}" for number in numbers]

    def _one(self, kind: str, quality: str, number: int) -> Path:
        return Path(self.numbered(kind, quality, (number,))[0])

    def mesh(self, number: int) -> Path:
        return self._one("mesh", "", number)

    def normals(self, number: int) -> Path:
        return self._one("normals", "", number)

    def cameras(self) -> Path:
        return self.home / f"{self.name}.cameras.json"

    def raw(self, quality: str, number: int) -> Path:
        return self._one("raw", quality, number)

    def frame(self, quality: str, number: int) -> Path:
        return self._one("frame", quality, number)

    def statistics(self, quality: str, number: int) -> Path:
        """What rendering a picture took: not the same twice, and so beside the picture and not in it."""
        return self._one("statistics", quality, number)

    def movie(self, quality: str, frames: str | None = None) -> Path:
        """The film of all frames, or of a range: `<shot>.10-20x2.mp4`."""
        return self.home / quality / (f"{self.name}.{frames}.mp4" if frames else f"{self.name}.mp4")


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
