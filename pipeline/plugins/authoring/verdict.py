"""The verdict about one shot or edit: its mistakes, warnings and notes, and its first frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from flowsculpt import FlowsculptError


@dataclass
class Verdict:
    """What is to be said about one file. Errors and warnings begin with file, line and column.

    firsts  facts of the first frame of each of several subjects by name, or of the one under an empty name
    """

    name: str
    errors: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    firsts: dict[str, dict[str, Any]] = field(default_factory=dict)
    exit_code: int = 0

    def add_error(self, error: FlowsculptError) -> None:
        self.errors += str(error).splitlines()
        self.exit_code = max(self.exit_code, error.exit_code)

    def as_data(self) -> dict[str, Any]:
        """Return it as JSON-able data."""
        facts = {"file": self.name, "errors": self.errors, "warnings": self.warnings, "notes": self.notes}
        if "" in self.firsts:
            return {**facts, "first_frame": self.firsts[""]}
        return {**facts, "first_frames": self.firsts} if self.firsts else facts
