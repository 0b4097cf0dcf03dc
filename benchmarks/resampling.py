"""`python -m benchmarks.resampling`: all targets of the resampler.

Runs frames, films, the Enright deformation, shading normals and the memory of five million vertices; each
can be run alone. Ratios are comparable between machines, times are not. Writes `benchmarks/out/targets.json`.
"""

from __future__ import annotations

from benchmarks import enright, films, frames, memory, normals
from benchmarks.measures import told
from benchmarks.report import Target, keep, show


def main() -> None:
    """Measure everything; print and write the targets."""
    found = [*frames.main(), *films.main(), *enright.main(), *_normals(), *memory.main()]
    rows = [target.row for target in found]
    keep("targets", rows)
    show("Targets", rows)


def _normals() -> list[Target]:
    rows, wanted = [], []
    for name, motion in normals.films().items():
        row = normals.measure(name, motion)
        rows.append(row)
        show(f"Shading normals: {name}", [{"what": what, "measured": row[what]} for what in row])
        work = f"normals:{name}"
        wanted += [
            Target(work, "median error, 1 /", told(row, "ratio of medians: 1 /"), least=15),
            Target(work, "95% of errors, 1 /", told(row, "ratio of 95%: 1 /"), least=4),
            Target(work, "jump at a resample, °", told(row, "jump at a resample, carried: rms"), most=0.0),
        ]
    keep("normals", rows)
    return wanted


if __name__ == "__main__":
    main()
