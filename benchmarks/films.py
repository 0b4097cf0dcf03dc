"""`python -m benchmarks.films`: two films with every placement, against the exact surface.

Each row is a film resampled in every frame. `resampling` and `carrying` are CPU seconds of all frames;
distances are rms over vertices and face centres of the last frame, in maximum edge lengths.
"""

from __future__ import annotations

import math

import numpy as np

from benchmarks import peers
from benchmarks.measures import creases_kept, exactness, pop, quality, volume
from benchmarks.play import PLACEMENTS, play, warm, with_normals
from benchmarks.report import Row, Target, keep, show
from benchmarks.works import Film, cube, lorenz
from flowsculpt.pipeline.mesh import validate
from flowsculpt.pipeline.resample import Curvature, Thresholds
from flowsculpt.pipeline.resample.thresholds import DEFAULT_ROUNDNESS

EVERY = 8
"""Frames between measurements of pop."""

STRONGER = 0.85

BY_CURVATURE = "exact, curvature"
"""The row of the Lorenz film with edge lengths by curvature, a quarter as long at the rims."""


def main() -> list[Target]:
    """Measure both films; return the targets."""
    warm()
    rows = [measure(film, placement, placement) for film in (cube(), lorenz()) for placement in PLACEMENTS]
    rows.append(measure(cube(), "exact", f"exact, shape {STRONGER:g}", min_roundness=STRONGER))
    finer = with_normals(lorenz())
    rows.append(measure(finer, "exact", BY_CURVATURE, density(finer.max_edge_length)))
    keep("films", rows)
    show("Films of 120 frames", rows)
    return targets(rows)


def density(longest: float, finest: float = 0.25) -> Thresholds:
    """Return edge lengths by curvature, the longest as in the other runs, the finest a share of it."""
    lengths = Curvature(0.004 * longest, finest * longest, longest, hard_angle=math.pi)
    return Thresholds(lengths, gradation=1.0)


def measure(
    film: Film,
    placement: str,
    name: str,
    thresholds: Thresholds | None = None,
    min_roundness: float = DEFAULT_ROUNDNESS,
) -> Row:
    """Run one film to its end; return its row, named `name`."""
    nearest = peers.nearest()
    edges = out = unexplained = relaxed = on_chord = splits = 0
    pops = []
    for moment in play(
        film, placement, thresholds, min_roundness, lambda n: bool(nearest) and n % EVERY == 0
    ):
        report = moment.report
        edges, out = edges + report.edges, out + report.too_short + report.too_long
        unexplained += report.too_long + report.too_short - sum(report.refused.values())
        relaxed, on_chord, splits = (
            relaxed + report.relaxed,
            on_chord + report.on_chord,
            splits + report.splits,
        )
        if moment.before is not None and nearest is not None:
            pops.append(pop(moment.before, moment.after(), nearest))
    mesh = moment.after()
    validate(mesh).require(closed=True)
    kept = volume(mesh) / (volume(film.subject) * math.exp(film.swells))
    row: Row = {
        "film": film.name,
        "placement": name,
        "resampling": moment.seconds,
        "carrying": moment.carrying,
        "vertices": len(mesh.vertices),
        "volume %": 100 * (kept - 1),
        **exactness(film, mesh, film.frames),
        "quality 1%": float(np.quantile(quality(mesh), 0.01)),
        "% within limits": 100 * (1 - out / edges),
        "too long": report.too_long,
        "unexplained": unexplained,
        "relaxed": relaxed,
        "% on chord": 100 * on_chord / max(1, splits),
    }
    if pops:
        row["pop °"] = float(np.mean(pops))
    if film.name == "cube":
        row["creases kept"] = creases_kept(film, mesh, film.frames)
    return row


def targets(rows: list[Row]) -> list[Target]:
    """Return the targets of these films."""
    found = {(row["film"], row["placement"]): row for row in rows}

    def target(
        film: str, placement: str, what: str, most: float | None = None, least: float | None = None
    ) -> list[Target]:
        value = found[film, placement].get(what)
        if not isinstance(value, int | float):
            return []
        value = abs(value) if what == "volume %" else value
        return [Target(f"film:{film}, {placement}", what, value, most, least)]

    wanted = [
        target("cube", "exact", "volume %", most=0.005),
        target("cube", "exact", "surface rms", most=0.005),
        target("cube", "exact", "normal 95%", most=2.3),
        target("cube", "exact", "creases kept", least=0.88),
        target("cube", "exact", "pop °", most=0.2),
        target("cube", "exact", "quality 1%", least=0.6),
        target("cube", f"exact, shape {STRONGER:g}", "quality 1%", least=0.75),
        target("cube", "exact", "% flipped", most=0.0),
        target("lorenz", "exact", "volume %", most=0.3),
        target("lorenz", "exact", "% flipped", most=0.3),
        target("lorenz", BY_CURVATURE, "volume %", most=0.3),
        target("lorenz", BY_CURVATURE, "% flipped", most=0.3),
    ]
    for film in ("cube", "lorenz"):
        wanted.append(target(film, "exact", "too long", most=0))
        wanted.append(target(film, "exact", "% within limits", least=99.5))
        wanted.append(target(film, "exact", "unexplained", most=0))
    return [line for lines in wanted for line in lines]


if __name__ == "__main__":
    show("Targets", [target.row for target in main()])
