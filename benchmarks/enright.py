"""`python -m benchmarks.enright`: a sphere stretched to a thin sheet and back, 150 frames.

Each row is the film with one placement, or with one of the installed remeshers, at half time and at the end.
Distances are rms in maximum edge lengths, of the vertices, and of vertices and face centres together; CPU
seconds are of all frames so far.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from benchmarks import peers
from benchmarks.measures import exactness, volume
from benchmarks.play import PLACEMENTS, Moment, play, warm, with_normals
from benchmarks.report import Row, Target, keep, show
from benchmarks.works import Film, enright
from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh import TriangleMesh, validate
from flowsculpt.pipeline.resample import Curvature, Thresholds

DENSITY = Thresholds(Curvature(4e-4, 0.0115, 0.05, hard_angle=math.pi), gradation=1.0)
"""Edge lengths by curvature, nearly half as long at the rims as in the other runs; at most 9,500 vertices."""

LOOKS = (25, 75, 125, 150)
ALL = 1 << 30


def main() -> list[Target]:
    """Measure all placements and remeshers; return the targets."""
    warm()
    film, rows = enright(), []
    for placement in PLACEMENTS:
        rows += measure(film, placement, play(film, placement))
    rows += measure(film, "exact, curvature", play(with_normals(film), "exact", DENSITY))
    for name, remesh in peers.installed().items():
        rows += measure_peer(film, name, remesh)
    keep("enright", rows)
    show("The Enright deformation, there and back", rows)
    return targets(rows)


def measure(film: Film, name: str, moments: Iterator[Moment]) -> list[Row]:
    """Run the film with one placement; measure it at half time and at the end."""
    rows: list[Row] = []
    peak, on_chord, splits = len(film.subject.vertices), 0, 0
    for moment in moments:
        report = moment.report
        peak, splits = max(peak, report.vertices), splits + report.splits
        on_chord += report.on_chord
        if moment.number not in LOOKS:
            continue
        mesh = moment.after()
        validate(mesh).require(closed=True)
        rows.append(
            {
                **_look(film, name, moment.number, mesh, peak),
                "resampling": moment.seconds,
                "carrying": moment.carrying,
                "% on chord": 100 * on_chord / max(1, splits),
            }
        )
    return rows


def measure_peer(film: Film, name: str, remesh: peers.Remesher) -> list[Row]:
    """Run the film with another remesher, called once a frame, until it fails or ends."""
    rows: list[Row] = []
    mesh, seconds, peak = film.subject, 0.0, 0
    for number in range(1, film.frames + 1):
        moved = mesh.with_vertices(film.follow(mesh.vertices, number - 1, number))
        try:
            mesh, more = remesh(moved, film.max_edge_length)
            validate(mesh).require()
        except (MeshError, RuntimeError) as error:
            rows.append({"placement": name, "frame": number, "ended by": str(error)[:60]})
            break
        seconds, peak = seconds + more, max(peak, len(mesh.vertices))
        if number in LOOKS:
            rows.append({**_look(film, name, number, mesh, peak), "resampling": seconds})
    return rows


def _look(film: Film, name: str, number: int, mesh: TriangleMesh, peak: int) -> Row:
    exact = exactness(film, mesh, number, ALL)
    return {
        "placement": name,
        "frame": number,
        "vertices": len(mesh.vertices),
        "most so far": peak,
        "vertices rms": exact["vertices rms"],
        "surface rms": exact["surface rms"],
        "% flipped": exact["% flipped"],
        "volume %": 100 * (volume(mesh) / volume(film.subject) - 1),
    }


def targets(rows: list[Row]) -> list[Target]:
    """Return the targets of this film."""
    found = {(row["placement"], row["frame"]): row for row in rows}

    def of(placement: str, what: str, *frames: int) -> float:
        return max(abs(float(found[placement, frame][what])) for frame in frames)

    half, end = 75, 150
    work, dense = "enright, exact", "enright, exact, curvature"
    return [
        Target(work, "vertices rms, throughout", of("exact", "vertices rms", *LOOKS), most=0.002),
        Target(work, "surface rms at the end", of("exact", "surface rms", end), most=0.012),
        Target(work, "volume %, at the end", of("exact", "volume %", end), most=0.1),
        Target(work, "% flipped, throughout", of("exact", "% flipped", *LOOKS), most=0.0),
        Target(work, "resampling", of("exact", "resampling", end), most=0.1),
        Target(dense, "vertices at the peak", of("exact, curvature", "most so far", end), most=9500),
        Target(dense, "surface rms at half time", of("exact, curvature", "surface rms", half), most=0.006),
        Target(dense, "surface rms at the end", of("exact, curvature", "surface rms", end), most=0.010),
    ]


if __name__ == "__main__":
    show("Targets", [target.row for target in main()])
