"""Paths of files and folders, relative to the root."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from pipeline.errors import MachineError

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
    "cameras": ".json",
    "raw": ".exr",
    "frame": ".exr",
    "movie": ".mp4",
    "mov": ".mov",
    "mkv": ".mkv",
    "webp": ".webp",
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


@dataclass(frozen=True)
class Folders:
    """The folders of one sequence of frames, of a shot or a turntable.

    home     renders/<shot>, or renders/turntable/<name>
    name     the part of file names before the frame number
    subject  the one of several subjects whose meshes have a folder of their own
    """

    home: Path
    name: str
    subject: str = ""

    @classmethod
    def of_shot(cls, name: str) -> Folders:
        return cls(Path("renders") / name, name)

    @classmethod
    def of_turntable(cls, name: str, look: str | None = None) -> Folders:
        """Return the folders of a turntable; one of several looks has a folder of its own."""
        home = Path("renders") / "turntable" / name
        return cls(home / look if look else home, name)

    @property
    def part_name(self) -> str:
        """The part of file names before the frame number where each subject has files in one folder."""
        return f"{self.name}.{self.subject}" if self.subject else self.name

    def numbered(self, kind: str, quality: str, numbers: Iterable[int]) -> list[str]:
        """Return the paths of numbered files of a kind; `quality` matters for pictures only.

        They are strings: a plan names so many that making Path objects would take most of its time.
        """
        within, suffix = _NUMBERED[kind].format(quality), SUFFIXES[kind]
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
    """Raise MachineError where the store of a root is a link to a folder that is not there."""
    store = root / STORE
    if store.is_symlink() and not store.is_dir():
        raise MachineError(
            f"{store}: links to {store.readlink()}, which is not a folder; mount its disk, or change the link"
        )


def of_edit(shot: str, edit: str) -> Path:
    """The folder of a shot in an edit that has a picture of its own."""
    return RENDERS / "edit" / shot / edit


def published(name: str) -> Path:
    """The folder of a shot's published versions."""
    return PUBLISHED / name


def repeated(name: str, version: str) -> Path:
    """The root in which a published version is made again."""
    return REPEATED / f"{name}.{version}"


def wedge(name: str) -> Path:
    """The folder of a shot's wedges: cells and sheets."""
    return RENDERS / "wedge" / name


@dataclass(frozen=True)
class OutputFolder:
    """A folder that holds output.

    pattern  its path, relative to the root: {NAME} stands for any name, ** for any folders
    holds    what lies there
    command  writes it again; {quality} stands for -q, --scale and --crop, and … for options that nobody
             keeps. None for what a run makes again when it needs it.
    files    a pattern of the names of its files, where another row has the others
    """

    pattern: str
    holds: str
    command: str | None
    files: str = "*"

    def match(self, path: Path) -> Mapping[str, str] | None:
        """Return the names in braces where a file lies in the folder, else None."""
        if not fnmatch(path.name, self.files):
            return None
        expression = re.escape(self.pattern).replace(r"\*\*", ".+")
        expression = re.sub(r"\\{(\w+)\\}", r"(?P<\1>[^/]+)", expression)
        match = re.fullmatch(expression, path.parent.as_posix())
        return match and match.groupdict()


OUTPUTS = (
    OutputFolder("renders/published/**", "published versions", "reproduce …"),
    OutputFolder("renders/repeated/**", "published versions, made again", "reproduce …"),
    OutputFolder("renders/review/**", "review pages", "review …"),
    OutputFolder("renders/**/meshes", "mesh frames", None),
    OutputFolder("renders/**/normals", "meshes ready to be rendered", None),
    OutputFolder("renders/**/meshes/{subject}", "mesh frames of a subject", None),
    OutputFolder("renders/**/normals/{subject}", "meshes of a subject ready to be rendered", None),
    OutputFolder("renders/**", "cameras", None, files="*.cameras.json"),
    OutputFolder("renders/**/raw", "rendered frames", None),
    OutputFolder("renders/**/statistics", "seconds of rendering", None),
    OutputFolder("renders/wedge/{shot}", "sheets of wedges", "wedge {shot} …"),
    OutputFolder("renders/wedge/{shot}/**", "cells of wedges, each as a shot's folder", "wedge {shot} …"),
    OutputFolder("renders/turntable/**", "turntables, each as a shot's folder", "turntable …"),
    OutputFolder(
        "renders/edit/{shot}/{name}/**", "a shot in an edit with a picture of its own", "film {name} …"
    ),
    OutputFolder("renders/film/preview", "animatics of films", "preview {name} …"),
    OutputFolder("renders/film/{quality}", "films", "film {name} {quality}"),
    OutputFolder("renders/film/{quality}/deliver", "deliverables of films", "deliver {quality} …"),
    OutputFolder("renders/{shot}", "figures", "figures {shot}", files="*.figures.*"),
    OutputFolder("renders/{shot}", "curves", "curves {shot}", files="*.curves.*"),
    OutputFolder("renders/{shot}/preview", "previews", "preview {shot} …"),
    OutputFolder("renders/{shot}/models", "meshes for other programs", "export … {shot} …"),
    OutputFolder("renders/{shot}/usd", "stages for other programs", "export usd {shot}"),
    OutputFolder("renders/{shot}/{quality}", "contact sheets", "sheet {shot} {quality} …", files="*.sheet.*"),
    OutputFolder("renders/{shot}/{quality}", "movies", "render {shot} {quality} …"),
    OutputFolder("renders/{shot}/{quality}/frames", "finished frames", "render {shot} {quality}"),
    OutputFolder("renders/{shot}/{quality}/relight/**", "relit frames", "relight {shot} {quality} …"),
    OutputFolder("renders/{shot}/{quality}/deliver", "deliverables", "deliver {shot} {quality} …"),
    OutputFolder("renders/{shot}/{quality}/{form}", "stills", "stills {shot} {quality} --as {form}"),
)
"""Every folder that holds output; the first row that matches a file counts."""


def output_folder(path: Path) -> tuple[OutputFolder, Mapping[str, str]] | None:
    """Return the folder of an output, and the names in its pattern; None for a file elsewhere."""
    rows = ((row, row.match(path)) for row in OUTPUTS)
    return next(((row, names) for row, names in rows if names is not None), None)
