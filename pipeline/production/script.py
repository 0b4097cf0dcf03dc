"""A shot file with everything that it rests on, as it was when the work was planned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.errors import FlowsculptError
from pipeline.production.pinned import Pins, pins_of, require_same, require_unchanged
from pipeline.shot import Shot, read_shot


@dataclass(frozen=True)
class Script:
    """What a shot is read from, in every process alike.

    text, path  the shot file, and where it lies
    settings    what takes the place of its values
    beside      the shot files that it rests on: names and texts
    allow_code  whether the shot may run the Python files that it names
    pins        the other files that it reads as they were; None where the work is not planned yet
    """

    text: str
    path: Path
    settings: tuple[str, ...] = ()
    beside: tuple[tuple[str, str], ...] = ()
    allow_code: bool = False
    pins: Pins | None = None

    def as_data(self) -> dict[str, Any]:
        return {
            "text": self.text,
            "path": str(self.path),
            "settings": list(self.settings),
            "beside": [list(file) for file in self.beside],
            "allow_code": self.allow_code,
            "pins": None if self.pins is None else [list(pin) for pin in self.pins],
        }

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Script:
        return cls(
            text=data["text"],
            path=Path(data["path"]),
            settings=tuple(data["settings"]),
            beside=tuple((name, text) for name, text in data["beside"]),
            allow_code=data["allow_code"],
            pins=None if data["pins"] is None else tuple((path, digest) for path, digest in data["pins"]),
        )

    @property
    def name(self) -> str:
        """The shot's, which is known without reading it."""
        return self.path.stem

    @cached_property
    def shot(self) -> Shot:
        """Raises UsageError where a file that it reads was changed since the work was planned."""
        try:
            shot = read_shot(self.path, self.text, self.settings, dict(self.beside), self.allow_code)
        except FlowsculptError:
            require_unchanged(self.pins or ())  # which then is what went wrong
            raise
        if self.pins is not None:
            require_same(self.pins, pins_of(shot.files))
        return shot

    def pinned(self) -> Script:
        """The same with the files pinned that its shot has read."""
        return replace(self, pins=pins_of(self.shot.files))
