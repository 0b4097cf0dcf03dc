"""What shots are read from: the texts of their files, and of a shot around a mesh file that has none."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.errors import MissingInputError, UsageError
from pipeline.production.request.shot_source import ShotSource
from pipeline.shot.yaml.lookup import DEFAULTS


@dataclass(frozen=True)
class SourceCache:
    """Shot files and those that they rest on, each read once: all of a run goes by one text of each, however
    it is edited meanwhile."""

    _own: dict[Path, str] = field(default_factory=dict)
    _beside: dict[Path, dict[str, str]] = field(default_factory=dict)

    def source(self, path: Path, settings: tuple[str, ...], allow_code: bool) -> ShotSource:
        """Of the shot file at `path`, its place in full. Raises MissingInputError or UsageError."""
        text = self._own.get(path) or self._own.setdefault(path, _text(path))
        beside = self._beside.get(path) or self._beside.setdefault(path, _inherited_files(path, text))
        return ShotSource(text, path, settings, tuple(beside.items()), allow_code)

    def put(self, path: Path, text: str) -> None:
        """A text, as if it stood there."""
        self._own[path] = text


def shot_around(mesh: Path) -> str:
    """The text of a shot that shows a mesh file as it is. Raises MissingInputError where there is none."""
    if not mesh.is_file():
        raise MissingInputError(f"{mesh}: no such mesh file; check the path")
    shot = {
        "title": mesh.stem,
        "frames": "1-1",
        "subject": {"model": str(mesh.absolute())},
        "resample": "off",
    }
    return json.dumps(shot, ensure_ascii=False)  # JSON is YAML, quotes and all


def _inherited_files(path: Path, text: str) -> dict[str, str]:
    """The text of all other files that a shot is made of, by their names; most rest on no shot."""
    if "extends" in text:
        from pipeline.shot.yaml.inheritance import inherited_files

        return inherited_files(path, text)
    defaults = path.with_name(DEFAULTS)
    try:
        return {DEFAULTS: defaults.read_text(encoding="utf-8")}
    except (OSError, UnicodeDecodeError):
        return {}


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise MissingInputError(f"{path}: no such shot file; flowsculpt new makes one") from None
    except UnicodeDecodeError:
        raise UsageError(f"{path}: not UTF-8 text; save it as UTF-8") from None
    except OSError as error:
        raise MissingInputError(f"{path}: cannot be read ({error.strerror})") from None
