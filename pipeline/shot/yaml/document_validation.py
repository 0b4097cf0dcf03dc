"""Validation of a file by a document: its context, and every problem with line and column.

A message says place, fact, rule and remedy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar
from unicodedata import normalize

from pydantic import BaseModel, ValidationError, ValidationInfo
from pydantic_core import PydanticCustomError

from flowsculpt.pipeline.errors import FlowsculptError, MissingInputError, ShotError, reason_of
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.plugin import fault_of_plugin
from flowsculpt.pipeline.shot.yaml.messages import problems_of
from flowsculpt.pipeline.shot.yaml.named_files import is_folder, quote_name
from flowsculpt.pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource
from flowsculpt.render.base.input_files import InputFile, kind_of_path

MOST_PROBLEMS = 50
"""The most problems of one file that are reported at once."""

T = TypeVar("T")
D = TypeVar("D", bound=BaseModel)


@dataclass(frozen=True)
class ParseContext:
    """The entry `parse_context` of the context in which documents are validated.

    folder      of the shot file; files that it names are relative to it
    allow_code  True if Python files that it names may run
    digests     SHA-256 of the contents of the files that documents have opened
    sounds      of files that values follow: start in the shot (s), path, and silence that a track has (s)
    notes       remarks on files, for the user
    """

    folder: Path = Path()
    allow_code: bool = False
    digests: dict[Path, str] = field(default_factory=dict)
    sounds: list[tuple[float, Path, float]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, info: ValidationInfo) -> ParseContext:
        context = (info.context or {}).get("parse_context")
        return context if isinstance(context, cls) else cls()

    @staticmethod
    def attempt(make: Callable[[], T]) -> T:
        """Return what `make` returns; report errors of ours at the place of a field, not of its document."""
        try:
            return make()
        except FlowsculptError as error:
            raise finding(str(error)) from None

    def file(self, name: str) -> Path:
        """Return the path of a file, and note its digest. Raises a finding where it is not there."""
        path = self._path(name)
        self.note(path)
        return path

    def note(self, path: Path) -> str:
        """Note the digest of a file that is read, and return it. Raises a finding where it cannot be read."""
        self.digests[path] = self.attempt(lambda: InputFile(path).digest())
        return self.digests[path]

    def mesh(self, name: str) -> Path:
        """Return the path of a mesh file, and note its digest and those of the layers of a USD stage.

        Raises a finding where one is not there or cannot be read.
        """
        path = self._path(name)
        self.digests.update(self.attempt(lambda: ModelFile(path).files()).files)
        return path

    def _path(self, name: str) -> Path:
        path = self.folder / name
        if not InputFile(path).is_there():
            raise finding(missing_file(name, path))
        return path


def missing_file(name: str, path: Path, kind: str = "file") -> str:
    """Return the message about a file that a shot file names and that is not there."""
    if is_folder(path):
        return f"{kind} {quote_name(name)} is a folder; it must be a file. Write the name of a file in it."
    if special := kind_of_path(path):
        return f"{kind} {quote_name(name)} is {special}; it must be a regular file. Name another."
    return (
        f"{kind} {quote_name(name)} is not there; it is looked for beside the shot file, as "
        f"{quote_name(path)}. "
        f"{_similar_file(name, path) or _not_replaced(name) or 'Put it there or correct the name.'}"
    )


def _not_replaced(name: str) -> str | None:
    """Return a remedy for a name with a part that shells or other programs replace."""
    mark = next((mark for mark in ("~", "$", "\\") if mark in name), None)
    return None if mark is None else f"{mark} means nothing here. Write the folders, with / between them."


def _similar_file(name: str, path: Path) -> str | None:
    """Return a did-you-mean for a file with another suffix, other capitals or a misspelt name.

    It has the folder that the shot file writes.
    """
    try:
        names = sorted(item.name for item in path.parent.glob("[!.]*") if item.is_file())
    except (OSError, ValueError):
        return None
    if normalize("NFC", path.name) in [normalize("NFC", item) for item in names if item != path.name]:
        return (
            "A file is there whose name looks the same but has other Unicode characters: an é may be one, or "
            "two, as macOS stores it. Copy the name of the file."
        )
    same = [name for name in names if Path(name).stem.lower() == path.stem.lower()]
    close = same or get_close_matches(path.name, names, n=1, cutoff=0.8)
    if not close or close[0] == path.name:
        return None
    return f"Did you mean {(Path(name).parent / close[0]).as_posix()}?"


def finding(text: str) -> PydanticCustomError:
    """Return an error for pydantic with a whole message."""
    return PydanticCustomError("finding", "{text}", {"text": text})


@contextmanager
def unforeseen(path: Path) -> Iterator[None]:
    """Turn an error that is none of ours into a ShotError: no file may end in a traceback.

    Raises MachineError for one of a plug-in's code.
    """
    try:
        yield
    except FlowsculptError:
        raise
    except Exception as error:
        if fault := fault_of_plugin(error):
            raise fault from error
        raise ShotError(
            f"{path}:1:1: flowsculpt fails on this file by a fault of its own "
            f"({type(error).__name__}: {reason_of(error)}). Undo the last change, and report the fault."
        ) from error


@dataclass
class Checks:
    """Runs checks of the values as the file has them, before the document has checked their types.

    problems   what they find
    failures   the errors of checks that a value of a wrong type has stopped; the document reports such values
    """

    source: YamlSource
    problems: list[Problem] = field(default_factory=list)
    failures: list[Exception] = field(default_factory=list)

    def run(self, check: Callable[..., Iterable[Problem]], *arguments: Any) -> list[Problem]:
        """Add the problems that `check(source, *arguments)` yields, and return them."""
        found: list[Problem] = []
        try:
            found += check(self.source, *arguments)
        except Exception as error:
            self.failures.append(error)
        self.problems += found
        return found


def _is_reported(where: Where, reported: set[Where]) -> bool:
    """Tell whether a check has reported a value, or the list in which it stands."""
    return where in reported or (bool(where) and isinstance(where[-1], int) and where[:-1] in reported)


def validated(
    checks: Checks,
    kind: type[D],
    missing: list[Problem],
    failed: list[FlowsculptError] | None = None,
    context: Mapping[str, Any] | None = None,
) -> D:
    """Return the file as a document.

    checks   of the file, which have run
    missing  files that are named and not there
    failed   errors of other files

    Raises ShotError with all mistakes, or the first MOST_PROBLEMS, in the order of the file;
    MissingInputError if only files are missing.
    """
    source = checks.source
    wrong, document = [*source.problems, *checks.problems], None
    try:
        document = kind.model_validate(source.data, context=dict(context or {}))
        for failure in checks.failures:
            raise failure
    except ValidationError as error:
        found, supplied = problems_of(error, source, kind)
        wrong = [problem for problem in wrong if problem[0] not in supplied]
        reported = {where for where, _ in wrong}
        wrong += [problem for problem in found if not _is_reported(problem[0], reported)]
    except Exception:
        if not wrong:  # else a value that a check reports has stopped a validator
            raise
    reported = {where for where, _ in wrong}
    absent = [f"{source.place(where)}: {text}" for where, text in missing if where not in reported]
    others = failed or []
    absent += [str(error) for error in others if isinstance(error, MissingInputError)]
    lines = [
        f"{source.place(where)}: {text}"
        for where, text in sorted(wrong, key=lambda problem: source.order(problem[0]))
    ]
    lines += [line for error in others if isinstance(error, ShotError) for line in error.messages]
    if lines:
        lines = list(dict.fromkeys([*lines, *absent]))
        if len(lines) > MOST_PROBLEMS:
            lines[MOST_PROBLEMS:] = [f"{source.path}: there are more problems; correct these first"]
        raise ShotError(*lines)
    if absent:
        raise MissingInputError("\n".join(absent))
    assert document is not None
    return document
