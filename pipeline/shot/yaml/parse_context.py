"""What a document needs to know beyond its text: where its files lie, and what is allowed."""

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
class Surroundings:
    """What documents find as `surroundings` in the context that they are validated in.

    folder      of the shot file: files named in it stand relative to that
    allow_code  whether Python files that it names may be run
    digests     SHA-256 of the contents of the files that documents have asked for
    """

    folder: Path = Path()
    allow_code: bool = False
    digests: dict[Path, str] = field(default_factory=dict)

    @classmethod
    def of(cls, info: ValidationInfo) -> Surroundings:
        found = (info.context or {}).get("surroundings")
        return found if isinstance(found, cls) else cls()

    def file(self, name: str) -> Path:
        """A file that is there, its digest noted. Raises a finding for pydantic to report at its place."""
        path = self._found(name)
        self.digests[path] = told(lambda: digest_of_file(path))
        return path

    def _found(self, name: str) -> Path:
        path = self.folder / name
        if not is_there(path):
            raise finding(
                f"file {shown(name)} is not there; it is looked for beside the shot file, as {shown(path)}. "
                "Put it there or correct the name."
            )
        return path

    def files(self, name: str) -> tuple[Path, ...]:
        """A file, or where the last part of its name has a *, all that fit, in the order of their names.

        Their digests are for those to note who read them, and hash what they read.
        """
        if "*" not in name:
            return (self._found(name),)
        around = self.folder / Path(name).parent
        try:
            found = sorted(path for path in around.glob(Path(name).name) if is_there(path))
        except (OSError, ValueError):
            raise finding(
                f"file {shown(name)} is no name of a sequence; each * stands for any letters. "
                "Write one where names differ, as in wind_*.npz."
            ) from None
        if not found:
            raise finding(
                f"no file fits {shown(name)}; they are looked for in {shown(around)}. Correct the name."
            )
        return tuple(found)


def finding(text: str) -> PydanticCustomError:
    """Something wrong, in our words."""
    return PydanticCustomError("finding", "{text}", {"text": text})


def told(make: Callable[[], T]) -> T:
    """What `make` makes; where it raises an error of ours, a finding that tells it."""
    try:
        return make()
    except FlowsculptError as error:
        raise finding(str(error)) from None
