"""A shot file with everything that it rests on, as it was when the work was planned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import FlowsculptError
from pipeline.production.request.input_digests import InputDigests, pins_of, require_same, require_unchanged
from pipeline.production.request.planning_cache import PlanningCache
from pipeline.production.request.shot_summary import ShotSummary, can_be_remembered

if TYPE_CHECKING:
    from pipeline.shot import Shot


@dataclass(frozen=True)
class ShotSource:
    """What a shot is read from, in every process alike.

    text, path  the shot file, and where it lies
    settings    what takes the place of its values
    beside      the shot files that it rests on: names and texts
    allow_code  whether the shot may run the Python files that it names
    pins        the other files that it reads as they were; None where the work is not planned yet
    ledger      where its outline is remembered, if anywhere; no part of what it is read from
    """

    text: str
    path: Path
    settings: tuple[str, ...] = ()
    beside: tuple[tuple[str, str], ...] = ()
    allow_code: bool = False
    pins: InputDigests | None = None
    ledger: PlanningCache | None = field(default=None, compare=False, repr=False)

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
    def from_data(cls, data: Mapping[str, Any], ledger: PlanningCache | None = None) -> ShotSource:
        return cls(
            text=data["text"],
            path=Path(data["path"]),
            settings=tuple(data["settings"]),
            beside=tuple((name, text) for name, text in data["beside"]),
            allow_code=data["allow_code"],
            pins=None if data["pins"] is None else tuple((path, digest) for path, digest in data["pins"]),
            ledger=ledger,
        )

    @property
    def name(self) -> str:
        """The shot's, which is known without reading it."""
        return self.path.stem

    @cached_property
    def shot(self) -> Shot:
        """Raises UsageError where a file that it reads was changed since the work was planned."""
        from pipeline.shot import read_shot

        try:
            shot = read_shot(self.path, self.text, self.settings, dict(self.beside), self.allow_code)
        except FlowsculptError:
            require_unchanged(self.pins or ())  # which then is what went wrong
            raise
        if self.pins is not None:
            require_same(self.pins, pins_of(shot.files))
        return shot

    def pinned(self) -> ShotSource:
        """The same with the files pinned that its shot has read."""
        found = replace(self, pins=self.summary.pins)
        vars(found).update({name: value for name, value in vars(self).items() if name in ("outline", "shot")})
        return found

    @cached_property
    def summary(self) -> ShotSummary:
        """What planning asks of the shot, which is read only where the ledger does not tell it.

        Raises what `shot` raises.
        """
        known = self._remembered()
        if known is not None:
            return known
        summary = ShotSummary.of(self.shot)
        if self.ledger is not None and can_be_remembered(self.shot):
            self.ledger.note(summary.as_data(), *self._read_from)
        return summary

    def _remembered(self) -> ShotSummary | None:
        """Nothing where a file was changed since, or is not the one that the work was planned for: then the
        shot is read, and whatever is wrong told."""
        data = None if self.ledger is None else self.ledger.recall(*self._read_from)
        if data is None:
            return None
        known = ShotSummary.from_data(data)
        return known if self.pins in (None, known.pins) and known.holds else None

    @property
    def _read_from(self) -> tuple[Any, ...]:
        """All but the other files, which only reading it tells."""
        return "outline", self.text, str(self.path), self.settings, self.beside, self.allow_code
