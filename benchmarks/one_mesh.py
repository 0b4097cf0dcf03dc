"""`python -m benchmarks.one_mesh [SHOT…]`: one mesh for all frames of the gallery's shots.

Each subject is refined with an empty store, in CPU seconds of all threads, and compared with ten of its mesh
frames. Distances are from vertices and face centres of each surface to the other one, in maximum edge lengths
there; angles are between normals at vertices of mesh frames off creases, except where the nearest triangle is
the back of a thin sheet. Of each 95% are smaller. Prints a table; writes `benchmarks/out/one_mesh.json`. It
needs libigl, one of the peers.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from benchmarks import peers
from benchmarks.measured_shots import gallery, shot_file
from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.animation import MeshFrame, animate
from flowsculpt.pipeline.arrays import AnyArray, Floats, Points
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.mesh.normals import split_at_creases
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh
from flowsculpt.pipeline.plugins.interchange.refining import Refined, Refiner
from flowsculpt.pipeline.plugins.interchange.unifying import Unification
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import SourceCache
from flowsculpt.pipeline.production.store.store import Store

LOOKS = 10  # frames of each shot that are compared
SAMPLES = 3000  # points of each surface
SHARE = 0.95

MOST_SECONDS, SLOW = 20.0, {"A020_lorenz": 60.0, "B110_abc": 60.0}
MOST_DISTANCE, MOST_DEGREES = 0.25, 2.0


def main(names: list[str]) -> list[Target]:
    """Measure the shots of these names, by default all with a surface; return the targets."""
    rows: list[Row] = []
    if not peers.found("igl"):
        print("one_mesh is left out: it needs the module igl, which make bench installs")
        return []
    for name in names or gallery():
        for request in _parts(name):
            if request.shot.motion.subject.is_surface:
                rows.append(measure(request))
                show("One mesh for all frames", rows[-1:])
    keep("one_mesh", rows)
    show("One mesh for all frames", rows)
    return [target for row in rows for target in targets(row)]


def _parts(name: str) -> tuple[RenderRequest, ...]:
    source = SourceCache().source(shot_file(name), (), False)
    return RenderRequest(source, "final", "none", tuple(source.manifest.frames)).parts


def measure(request: RenderRequest) -> Row:
    """Refine a subject and compare it with its mesh frames."""
    with tempfile.TemporaryDirectory() as folder:
        store, began = Store(Path(folder)), time.process_time()
        refined = Refiner(request, store).refined()
        seconds = time.process_time() - began
        mesh = Unification(request, store).one_mesh()
        largest, away, back, degrees = 0, [], [], []
        for frame in _frames(request):
            largest = max(largest, len(frame.mesh.vertices))
            if frame.number in looks(request):
                compared = compare(request, refined, mesh, frame)
                for values, more in zip((away, back, degrees), compared, strict=True):
                    values.append(more)
        return {
            "subject": request.motion_folders.part_name,
            "at rest": len(refined.start.vertices),
            "one mesh": len(mesh.rest),
            "largest frame": largest,
            "ratio": len(mesh.rest) / largest,
            "CPU s": seconds,
            "longest": max(longest_edge(mesh, refined, number) for number in mesh.frames),
            "away": _quantile(away),
            "back": _quantile(back),
            "degrees": _quantile(degrees),
        }


def _frames(request: RenderRequest) -> Iterator[MeshFrame]:
    yield from animate(request.shot)


def looks(request: RenderRequest) -> set[int]:
    """Return the frames that are compared, evenly over the shot."""
    return {int(n) for n in np.linspace(min(request.requested), max(request.requested), LOOKS)}


def longest_edge(mesh: OneMesh, refined: Refined, number: int) -> float:
    """Return the longest edge of a frame, in the maximum length at its ends."""
    points, longest = refined.points_at(number), refined.lengths_at(number)
    a, b = mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)
    lengths = np.linalg.norm(points[a] - points[b], axis=1)
    return float((lengths / np.sqrt(longest[a] * longest[b])).max())


def compare(
    request: RenderRequest, refined: Refined, mesh: OneMesh, frame: MeshFrame
) -> tuple[Floats, Floats, Floats]:
    """Return distances from a mesh frame to one mesh, and back, in edges, and angles of normals, degrees."""
    number, theirs = frame.number, frame.mesh
    shown = mesh.frame(number)
    ours = TriangleMesh(shown.points, mesh.faces)
    thresholds = request.shot.motion.thresholds_at(number)
    allowed = thresholds.fields(theirs)[:, 0]
    chosen = _spread(len(theirs.vertices))
    soft = chosen[~np.isin(chosen, theirs.creases)]
    split = split_at_creases(theirs, thresholds.hard_angles(theirs))
    points = np.concatenate([theirs.vertices[chosen], _centres(theirs)])
    edges = np.concatenate([allowed[chosen], _at_centres(theirs, allowed)])
    away, _, _ = nearest(ours, points)
    _, face, weights = nearest(ours, theirs.vertices[soft])
    normals = np.einsum("nk,nkj->nj", weights, shown.normals[mesh.corner_normals[face]])
    cosine = np.einsum("ij,ij->i", normals, split.normals[soft]) / np.linalg.norm(normals, axis=1)
    front = np.einsum("ij,ij->i", ours.face_normals[face], split.normals[soft]) > 0.0
    mine, lengths = _spread(len(ours.vertices)), refined.lengths_at(number)
    back, _, _ = nearest(theirs, np.concatenate([ours.vertices[mine], _centres(ours)]))
    back_edges = np.concatenate([lengths[mine], _at_centres(ours, lengths)])
    return away / edges, back / back_edges, np.degrees(np.arccos(np.clip(cosine[front], -1.0, 1.0)))


def _spread(count: int) -> AnyArray:
    """Return numbers from 0 to `count`, evenly, SAMPLES at most."""
    return np.unique(np.linspace(0, count - 1, min(SAMPLES, count)).astype(int))


def _centres(mesh: TriangleMesh) -> Points:
    return mesh.vertices[mesh.faces[_spread(len(mesh.faces))]].mean(axis=1)


def _at_centres(mesh: TriangleMesh, values: Floats) -> Floats:
    return values[mesh.faces[_spread(len(mesh.faces))]].mean(axis=1)


def nearest(mesh: TriangleMesh, points: Points) -> tuple[Floats, AnyArray, Floats]:
    """Return distances (N,) of points from a surface, its faces (N,) and weights (N, 3) of their corners."""
    igl = importlib.import_module("igl")
    squares, face, place = igl.point_mesh_squared_distance(
        points, np.array(mesh.vertices), mesh.faces.astype(np.int64)
    )
    weights = trimesh.triangles.points_to_barycentric(mesh.vertices[mesh.faces[face]], place)
    return np.sqrt(squares), face, np.nan_to_num(weights, nan=1.0 / 3.0)


def _quantile(values: list[Floats]) -> float:
    return float(np.quantile(np.concatenate(values), SHARE))


def targets(row: Row) -> Iterator[Target]:
    """Yield what is required of each subject."""
    name = str(row["subject"])
    yield Target(name, "longest edge", float(row["longest"]), most=1.0 + 1e-9)
    yield Target(name, "CPU seconds", float(row["CPU s"]), most=SLOW.get(name, MOST_SECONDS))
    for column in ("away", "back"):
        yield Target(name, f"edges {column}", float(row[column]), most=MOST_DISTANCE)
    yield Target(name, "degrees", float(row["degrees"]), most=MOST_DEGREES)


if __name__ == "__main__":
    show("Targets", [target.row for target in main(sys.argv[1:]) if not target.met])
