"""The context of a document's validation: the folder of its files, and what they may do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationInfo
from pydantic_core import PydanticCustomError

from pipeline.errors import FlowsculptError
from pipeline.shot.yaml.lookup import digest_of_file, is_there, shown

T = TypeVar("T")


@dataclass(frozen=True)
class ParseContext:
    """The entry `parse_context` of the context in which documents are validated.

    folder      of the shot file; files that it names are relative to it
    allow_code  True if Python files that it names may run
    digests     SHA-256 of the contents of the files that documents have opened
    """

    folder: Path = Path()
    allow_code: bool = False
    digests: dict[Path, str] = field(default_factory=dict)

    @classmethod
    def of(cls, info: ValidationInfo) -> ParseContext:
        context = (info.context or {}).get("parse_context")
        return context if isinstance(context, cls) else cls()

    def file(self, name: str) -> Path:
        """Return the path of a file, and note its digest. Raises a finding where it is not there."""
        path = self._path(name)
        self.digests[path] = as_finding(lambda: digest_of_file(path))
        return path

    def _path(self, name: str) -> Path:
        path = self.folder / name
        if not is_there(path):
            raise finding(missing_file(name, path))
        return path

    def files(self, name: str) -> tuple[Path, ...]:
        """Return the path of a file, or the sorted paths that match a name whose last part has a *.

        Whoever reads the files hashes them and notes their digests.
        """
        if "*" not in name:
            return (self._path(name),)
        folder = self.folder / Path(name).parent
        try:
            paths = sorted(path for path in folder.glob(Path(name).name) if is_there(path))
        except (OSError, ValueError):
            raise finding(
                f"file {shown(name)} is no name of a sequence; each * stands for any letters. "
                "Write one where names differ, as in wind_*.npz."
            ) from None
        if not paths:
            raise finding(f"no file matches {shown(name)} in {shown(folder)}. Correct the name.")
        return tuple(paths)


def missing_file(name: str, path: Path, kind: str = "file") -> str:
    """Return the message about a file that a shot file names and that is not there."""
    return (
        f"{kind} {shown(name)} is not there; it is looked for beside the shot file, as {shown(path)}. "
        "Put it there or correct the name."
    )


def finding(text: str) -> PydanticCustomError:
    """Return an error for pydantic with a whole message."""
    return PydanticCustomError("finding", "{text}", {"text": text})


def bad_value(text: str) -> PydanticCustomError:
    """Return an error for pydantic with a message that follows the value's path: `rate: …`."""
    return PydanticCustomError("bad_value", "{text}", {"text": text})


def bad_curve(text: str) -> PydanticCustomError:
    """Return an error for pydantic with a message that continues the value's path: `speed is …`."""
    return PydanticCustomError("bad_curve", "{text}", {"text": text})


def as_finding(make: Callable[[], T]) -> T:
    """Return what `make` returns; turn an error of ours into a finding."""
    try:
        return make()
    except FlowsculptError as error:
        raise finding(str(error)) from None
