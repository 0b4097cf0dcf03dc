"""`python -m benchmarks.carried_meshes [CASE[:FRAMES]…]`: one mesh of sequences whose faces change.

Shots of the gallery are exported as PLY with velocities and taken in again; a fluid (metaballs by marching
tetrahedra, on another grid in each frame) and a cloth (a sheet with other triangles in each frame) are
written by this script. Then `flowsculpt export abc` makes one mesh of each, which is read back. Distances
are from 20,000 points of each surface, even by area, to the other one, in median edges of the file; angles
are between the normals of both there, where the file's faces agree with the mesh; a file may have normals of
its own. Of distances the largest of all frames is shown, and of angles the largest that 95% of a frame are
below. Prints a table; writes `benchmarks/out/carried_meshes.json`.
"""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import permutations
from pathlib import Path

import numpy as np

from benchmarks.measured_shots import shot_file
from benchmarks.report import Row, Target, keep, show
from flowsculpt import TriangleMesh, sheet
from flowsculpt.pipeline.arrays import AnyArray, Floats, Points
from flowsculpt.pipeline.flow.regions import TriangleTree
from flowsculpt.pipeline.mesh.normals import split_at_creases
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.base.python_process import python_command

SHOTS = {"A010_cube": "1-72", "A020_lorenz": "1-72", "B060_bloom": "1-48"}
OWN = {"fluid": "1-24", "cloth": "1-24"}
SAMPLES = 20_000
RATE = 24.0


def main(names: list[str]) -> list[Target]:
    """Measure the cases of these names, by default all; return the targets."""
    rows = []
    for case in names or [*SHOTS, *OWN]:
        name, _, frames = case.partition(":")
        with tempfile.TemporaryDirectory() as folder:
            rows += measure(Path(folder), name, frames or (SHOTS | OWN)[name])
        show("One mesh of sequences", rows[-2:])
    keep("carried_meshes", rows)
    show("One mesh of sequences", rows)
    return [target for row in rows for target in targets(row)]


def measure(root: Path, name: str, frames: str) -> Iterator[Row]:
    """Yield what becomes of a sequence, and of the frames that remain where it is refused."""
    cache = write_files(root, name, frames)
    text = f"title: {name}\nframes: {frames}\nsubject: {{sequence: {cache}/{name}.####.ply}}\n"
    (root / "shots").mkdir(exist_ok=True)
    (root / f"shots/C_{name}.yaml").write_text(text)
    asked = [frames]
    for part in asked:
        began, used = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        run = command(root, "export", "abc", f"C_{name}", "-f", *part.split())
        now = resource.getrusage(resource.RUSAGE_CHILDREN)
        row: Row = {"sequence": name, "frames": part, "seconds": time.perf_counter() - began}
        row["CPU s"] = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime
        if run.returncode not in (0, 1):
            raise RuntimeError(run.stderr)
        if run.returncode:
            words = run.stderr.strip().splitlines()[-1]
            yield {**row, "refused": words}
            if "Choose -f " in words and len(asked) == 1:
                asked.append(words.split("Choose -f ")[1].split(",")[0])
        else:
            yield {**row, **compared(root, name), "refused": ""}


def command(root: Path, *words: str) -> subprocess.CompletedProcess[str]:
    program = python_command("flowsculpt", "--root", str(root), "--no-progress", *words)
    return subprocess.run(program, cwd=root, capture_output=True, text=True, check=False)


def compared(root: Path, name: str) -> Row:
    """Return sizes, and the largest distances and angles of all frames."""
    largest, away, back, degrees, count = 0, 0.0, 0.0, 0.0, 0
    sequence = read_shot(root / f"shots/C_{name}.yaml").motion.animated
    assert sequence is not None, "its subject is a sequence"
    for number, ours, shading in frames_of(next(root.rglob("*.abc"))):
        theirs = sequence.mesh(number)
        largest, count = max(largest, len(theirs.vertices)), len(ours.vertices)
        sides = theirs.vertices[theirs.faces]
        edge = float(np.median(np.linalg.norm(np.roll(sides, 1, axis=1) - sides, axis=2)))
        points, face = ours.scattered(SAMPLES, number)
        away = max(away, float(distances(theirs, points).max()) / edge)
        back = max(back, float(distances(ours, theirs.scattered(SAMPLES, number)[0]).max()) / edge)
        degrees = max(degrees, float(np.quantile(angles(ours, shading, points, face, theirs), 0.95)))
    return {
        "largest file": largest,
        "one mesh": count,
        "mesh to files": away,
        "files to mesh": back,
        "degrees": degrees,
    }


def frames_of(path: Path) -> Iterator[tuple[int, TriangleMesh, Floats]]:
    """Yield the frames of an Alembic file: number, mesh, and normals (F, 3, 3) of the corners."""
    from alembic3d import Abc, AbcGeom

    archive = Abc.IArchive(str(path))
    schema = AbcGeom.IPolyMesh(archive.getTop(), archive.getTop().getChildHeader(0).getName()).getSchema()
    times = schema.getTimeSampling()
    for index in range(schema.getNumSamples()):
        seconds = times.getSampleTime(index)
        at = Abc.ISampleSelector(seconds)
        sample = schema.getValue(at)
        faces = np.array(sample.getFaceIndices()).reshape(-1, 3)[:, ::-1]
        normals = np.array(schema.getNormalsParam().getExpandedValue(at).getVals()).reshape(-1, 3, 3)
        mesh = TriangleMesh(np.array(sample.getPositions(), np.float64), faces)
        yield round(seconds * RATE), mesh, normals[:, ::-1].astype(np.float64)


def distances(mesh: TriangleMesh, points: Points) -> Floats:
    """Return distances (N,) of points from a surface."""
    face, shares = TriangleTree.of(mesh.vertices[mesh.faces]).nearest(points)
    return np.asarray(np.linalg.norm(blended(mesh.vertices[mesh.faces[face]], shares) - points, axis=1))


def angles(
    ours: TriangleMesh, shading: Floats, points: Points, face: AnyArray, theirs: TriangleMesh
) -> Floats:
    """Return the angles (N,), degrees, between normals of one mesh at points and those of the file there."""
    a, b, c = ours.vertices[ours.faces[face]].swapaxes(0, 1)
    sides = np.stack([b - a, c - a], axis=2)
    shares = np.einsum("nij,nj->ni", np.linalg.pinv(sides), points - a)
    mine = blended(shading[face], shares)
    near, there = TriangleTree.of(theirs.vertices[theirs.faces]).nearest(
        points, np.ascontiguousarray(ours.face_normals[face]), 0.5
    )
    shaded = split_at_creases(theirs)
    other = blended(shaded.normals[shaded.faces[near]], there)
    cosine = np.einsum("ij,ij->i", mine, other) / np.linalg.norm(mine, axis=1) / np.linalg.norm(other, axis=1)
    return np.degrees(np.arccos(np.clip(cosine[near >= 0], -1.0, 1.0)))


def blended(corners: Floats, shares: Floats) -> Floats:
    """Return values (N, 3) at shares (N, 2) of the second and third of corners (N, 3, 3)."""
    weights = np.column_stack([1.0 - shares.sum(axis=1), shares])
    return np.asarray(np.einsum("nk,nkj->nj", weights, corners))


def targets(row: Row) -> Iterator[Target]:
    """Yield what is required of each sequence that is not refused."""
    if not row["refused"]:
        for column, most in (("mesh to files", 0.25), ("files to mesh", 0.25), ("degrees", 5.0)):
            yield Target(str(row["sequence"]), column, float(row[column]), most=most)


# The files


def write_files(root: Path, name: str, frames: str) -> Path:
    """Write the files of a case; return their folder."""
    if name in SHOTS:
        (root / "shots").mkdir()
        shutil.copy(shot_file(name), root / "shots")
        if (run := command(root, "export", "ply", name, "-f", frames)).returncode:
            raise RuntimeError(run.stderr)
        return root / f"renders/{name}/models"
    cache, of = root / "cache", {"fluid": fluid, "cloth": cloth}[name]
    cache.mkdir()
    first, last = map(int, frames.split("-"))
    for number in range(first, last + 1):
        write_ply(cache / f"{name}.{number:04d}.ply", *of(number))
    return cache


def write_ply(path: Path, mesh: TriangleMesh, velocities: Floats) -> None:
    names = ("x", "y", "z", "vx", "vy", "vz")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(mesh.vertices)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices", "end_header", ""]
    rows = np.empty(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, mesh.faces
    body = np.hstack([mesh.vertices, velocities]).astype("<f4").tobytes() + rows.tobytes()
    path.write_bytes("\n".join(header).encode() + body)


def cloth(number: int) -> tuple[TriangleMesh, Floats]:
    """Return a sheet that falls into waves, with other triangles in each frame, and its velocities."""

    def place(points: Points, frame: float) -> Points:
        x, _, z = points.T
        high = 0.012 * frame * np.sin(5 * x + 0.15 * frame) * np.cos(3 * z) - 0.0004 * frame**2
        return np.column_stack([x * (1 - 0.004 * frame), high, z + 0.005 * frame * x])

    rest = sheet((2.0, 2.0), 0.05 + 0.004 * (number % 4))
    inside = (np.abs(rest.vertices[:, [0, 2]]) < 0.999).all(axis=1)
    points = np.array(rest.vertices)
    away = np.random.default_rng(number).uniform(-0.012, 0.012, (int(inside.sum()), 2))
    points[np.ix_(inside, [0, 2])] += away
    speed = (place(points, number + 0.01) - place(points, number - 0.01)) / 0.02 * RATE
    return TriangleMesh(place(points, number), rest.faces), speed


def fluid(number: int) -> tuple[TriangleMesh, Floats]:
    """Return metaballs, of which a drop falls into the others in frame 16, and velocities across them."""
    offset = np.random.default_rng(number).uniform(0, 0.05, 3)
    mesh = tetrahedra(lambda points: metaballs(points, number), 0.05, offset)
    step, gradient = 1e-4, slope(mesh.vertices, number)
    after, before = (metaballs(mesh.vertices, number + by) for by in (step, -step))
    rate = (after - before) / (2 * step) * RATE
    return mesh, -rate[:, None] * gradient / (gradient**2).sum(axis=1, keepdims=True)


def metaballs(points: Points, frame: float) -> Floats:
    """Return how far points (N, 3) are inside of the metaballs, above 0, or outside."""
    t = frame / RATE
    centres = [(-0.35 - 0.2 * t, 0.0, 0.1 * np.sin(4 * t)), (0.35 + 0.2 * t, 0.05, 0.0)]
    balls = [(centre, 0.45) for centre in centres] + [((0.1, 1.5 - 0.75 * t - 0.4 * t * t, 0.0), 0.3)]
    squares = [((points - centre) ** 2).sum(axis=-1) / size**2 for centre, size in balls]
    return np.asarray(sum(np.exp(-each) for each in squares) - 0.5)


def slope(points: Points, frame: float) -> Floats:
    """Return the gradient (N, 3) of the metaballs, which points inwards."""
    step = 1e-4
    sides = [metaballs(points + d, frame) - metaballs(points - d, frame) for d in step * np.eye(3)]
    return np.stack(sides, axis=1) / (2 * step)


def tetrahedra(level: Callable[[Points], Floats], size: float, offset: Floats) -> TriangleMesh:
    """Return where a level is 0, by marching tetrahedra, six to a cube of a grid (Doi, Koide 1991)."""
    shape = np.array([60, 60, 40])
    nodes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)
    points = (nodes - shape * [0.5, 0.35, 0.5]) * size + offset
    values = level(points)
    steps = np.array([shape[1] * shape[2], shape[2], 1])
    cubes = nodes[(nodes < shape - 1).all(axis=1)] @ steps
    corners = []
    for order in permutations(range(3)):
        path = np.cumsum([0, *steps[list(order)]])
        corners.append(cubes[:, None] + path)
    tets = np.concatenate(corners)
    order = np.argsort(values[tets] <= 0.0, axis=1, kind="stable")  # those inside come first
    tets, count = np.take_along_axis(tets, order, axis=1), (values[tets] > 0.0).sum(axis=1)
    kinds = [(1, [(0, 1), (0, 2), (0, 3)]), (3, [(3, 0), (3, 1), (3, 2)])]
    kinds += [(2, [(0, 2), (0, 3), (1, 3)]), (2, [(0, 2), (1, 3), (1, 2)])]
    ends = np.concatenate([tets[count == inside][:, pairs] for inside, pairs in kinds]).reshape(-1, 2)
    outwards = [
        points[tets[count == n, n:]].mean(axis=1) - points[tets[count == n, :n]].mean(axis=1)
        for n, _ in kinds
    ]
    ends = ends[np.arange(len(ends))[:, None], np.argsort(values[ends] <= 0.0, axis=1, kind="stable")]
    keys, faces = np.unique(ends[:, 0] * len(points) + ends[:, 1], return_inverse=True)
    a, b = np.divmod(keys, len(points))
    share = np.clip(values[a] / (values[a] - values[b]), 0.03, 0.97)[:, None]
    vertices, faces = points[a] + share * (points[b] - points[a]), faces.reshape(-1, 3)
    across = np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2)))
    is_back = np.einsum("ij,ij->i", across, np.concatenate(outwards)) < 0.0
    faces[is_back] = faces[is_back][:, ::-1]
    return TriangleMesh(vertices, faces)


if __name__ == "__main__":
    show("Targets", [target.row for target in main(sys.argv[1:]) if not target.met])
