"""What a document needs to know beyond its text: where its files lie, and what is allowed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationInfo
from pydantic_core import PydanticCustomError

from pipeline.errors import FlowsculptError

T = TypeVar("T")


@dataclass(frozen=True)
class Surroundings:
    """What documents find as `surroundings` in the context that they are validated in.

    folder      of the shot file: files named in it stand relative to that
    allow_code  whether Python files that it names may be run
    """

    folder: Path = Path()
    allow_code: bool = False

    @classmethod
    def of(cls, info: ValidationInfo) -> Surroundings:
        found = (info.context or {}).get("surroundings")
        return found if isinstance(found, cls) else cls()

    def file(self, name: str) -> Path:
        """A file that is there. Raises a finding for pydantic to report at its place."""
        path = self.folder / name
        if not path.is_file():
            raise finding(
                f"file {name} is not there; it is looked for beside the shot file, as {path}. "
                "Put it there or correct the name."
            )
        return path

    def files(self, name: str) -> tuple[Path, ...]:
        """A file, or where the last part of its name has a *, all that fit, in the order of their names."""
        if "*" not in name:
            return (self.file(name),)
        around = self.folder / Path(name).parent
        found = tuple(sorted(path for path in around.glob(Path(name).name) if path.is_file()))
        if not found:
            raise finding(f"no file fits {name}; they are looked for in {around}. Correct the name.")
        return found


def finding(text: str) -> PydanticCustomError:
    """Something wrong, in our words."""
    return PydanticCustomError("finding", "{text}", {"text": text})


def told(make: Callable[[], T]) -> T:
    """What `make` makes; where it raises an error of ours, a finding that tells it."""
    try:
        return make()
    except FlowsculptError as error:
        raise finding(str(error)) from None
