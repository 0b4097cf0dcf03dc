"""Tables of measurements and targets, and both as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

OUT = Path(__file__).parent / "out"

Row = dict[str, float | str]


@dataclass(frozen=True)
class Target:
    """One row of the table: a work, a quantity, its measured value, and bounds (at most, at least)."""

    work: str
    what: str
    measured: float
    most: float | None = None
    least: float | None = None

    @property
    def met(self) -> bool:
        over = self.most is not None and not self.measured <= self.most
        under = self.least is not None and not self.measured >= self.least
        return not (over or under)

    @property
    def row(self) -> Row:
        bounds = [f"{sign} {b:g}" for sign, b in (("≥", self.least), ("≤", self.most)) if b is not None]
        return {
            "work": self.work,
            "what": self.what,
            "target": " and ".join(bounds),
            "measured": self.measured,
            "met": "yes" if self.met else "NO",
        }


def show(title: str, rows: Sequence[Row]) -> None:
    """Print a table with aligned columns."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    cells = [[*columns], *([_cell(row.get(name, "")) for name in columns] for row in rows)]
    widths = [max(len(line[i]) for line in cells) for i in range(len(columns))]
    print(f"\n{title}")
    for line in cells:
        print("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)), flush=True)


def keep(name: str, rows: Sequence[Row]) -> None:
    """Write `benchmarks/out/<name>.json`."""
    OUT.mkdir(exist_ok=True)
    (OUT / f"{name}.json").write_text(json.dumps(list(rows), indent=1) + "\n")


def _cell(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"
