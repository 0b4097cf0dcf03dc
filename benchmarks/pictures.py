"""`python -m benchmarks.pictures`: all targets of pictures.

Each part can be run alone, and most of them smaller, by a first number. Writes
`benchmarks/out/targets_pictures.json`.
"""

from __future__ import annotations

from benchmarks import adaptive, cycles, equal_quality, flicker, long_run, overhead, scenes, sizzle
from benchmarks.report import keep, show


def main() -> None:
    """Measure everything; print and write the targets."""
    parts = (scenes, overhead, equal_quality, cycles, flicker, sizzle, long_run, adaptive)
    found = [target for part in parts for target in part.main()]
    rows = [target.row for target in found]
    keep("targets_pictures", rows)
    show("Targets", rows)


if __name__ == "__main__":
    main()
