"""`python -m benchmarks.walking FILE.glb[:ANIMATION] [FRAMES]`: a walking character at half its edge length.

FILE is a glTF of one primitive with a skin, such as CesiumMan or Fox of the Khronos sample models; its walk
is repeated over 60 frames, or FRAMES. Prints how many pairs of its faces cut through each other in the first
frame. Each frame is compared with the surface that the file has at its time, read on its own: the distance
of vertices and of the middles of faces, in edges of `max_edge_length`, root mean square; the longest edge;
and, where it has a texture, the difference of texture coordinates, which trimesh reads, at corners of faces
within one face of the file. Writes `benchmarks/out/walking.json`.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.report import Target, keep, show
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.flow.regions import TriangleTree
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.mesh.mesh_formats import ScenePart
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.shot import Motion, read_shot
from flowsculpt.pipeline.statistics import mesh_statistics

RATE = 24

SHOT = """\
title: A walk
frames: 1-{frames}
subject: {{sequence: {path}, {more}loop: true}}
resample: {{max_edge_length: {edge}}}
look: {look}
"""


def main() -> None:
    name, _, animation = sys.argv[1].partition(":")
    path, frames = Path(name).resolve(), int((*sys.argv[2:], 60)[0])
    moving = ModelFile(path, ScenePart(animation=animation) if animation else None).motion()
    first = moving.at(moving.times[0])
    faces = first.corners.reshape(-1, 3)
    sides = first.points[faces] - np.roll(first.points[faces], -1, axis=1)
    edge = 0.5 * float(np.linalg.norm(sides, axis=2).mean())
    crossings = mesh_statistics(TriangleMesh(first.points, faces)).crossings
    print(f"{path.stem}: {crossings} pairs of {len(faces)} faces cut through each other in the first frame")
    (shape,) = trimesh.load(path, process=False).geometry.values()
    read = getattr(shape.visual, "uv", None)
    coordinates = None if read is None else np.asarray(read)[faces]
    more = "" if coordinates is None else "paint: on, "
    more += f"animation: {animation}, " if animation else ""
    look = "clay" if coordinates is None else "model"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "walk.yaml"
        file.write_text(SHOT.format(frames=frames, path=path, edge=edge, more=more, look=look))
        shot = read_shot(file)
        far, longest, apart, counts = [], 0.0, [], []
        length = float(moving.times[-1] - moving.times[0])
        for frame in animate(shot):
            seconds = (frame.number - 1) / RATE % length
            corners = moving.at(moving.times[0] + seconds).points[faces]
            tree = TriangleTree.of(corners)
            mesh = frame.mesh
            counts.append(len(mesh.faces))
            own = mesh.vertices[mesh.faces]
            longest = max(longest, float(np.linalg.norm(own - np.roll(own, -1, axis=1), axis=2).max()))
            middles = np.ascontiguousarray(own.mean(axis=1))
            for points in (mesh.vertices, middles):
                face, shares = tree.nearest(np.ascontiguousarray(points))
                weights = np.column_stack([1.0 - shares.sum(axis=1), shares])
                there = np.einsum("nk,nkj->nj", weights, corners[face])
                far.append(np.linalg.norm(points - there, axis=1))
            if coordinates is not None:
                apart.append(_differences(shot.motion, mesh, coordinates))
    moving.close()
    distance = float(np.sqrt((np.concatenate(far) ** 2).mean())) / edge
    targets = [
        Target(path.stem, "distance, edges, root mean square", distance, most=0.05),
        Target(path.stem, "longest edge, of the greatest", longest / edge, most=1.0 + 1e-9),
        Target(path.stem, "most faces, of those of the first frame", max(counts) / counts[0], most=2.0),
    ]
    if apart:
        shades = 255.0 * np.concatenate(apart)
        few = float(np.quantile(shades, 0.999))
        targets += [
            Target(path.stem, "texture, steps of 1/255, 99.9% of faces", few, most=1.0),
            Target(path.stem, "texture, steps of 1/255, most", float(shades.max())),
        ]
    rows = [target.row for target in targets]
    show(f"A character resampled, {frames} frames", rows)
    keep("walking", rows)


def _differences(motion: Motion, mesh: TriangleMesh, coordinates: AnyArray) -> AnyArray:
    """Return differences of texture coordinates (N,) of faces within one face of the file.

    coordinates  (F, 3, 2) of the corners of the file's faces
    """
    rest, animated = mesh.attributes["rest"], motion.animated
    painted = motion.painted(rest, mesh.faces)
    assert painted is not None and animated is not None, "it has paint, and moves"
    surface = animated.model.faces
    corners = rest[mesh.faces]
    inner = 0.98 * corners + 0.02 * corners.mean(axis=1, keepdims=True)
    ends, starts = np.stack([corners, corners], 2), np.stack([mesh.attributes["face"][mesh.faces]] * 2, 2)
    found, which = np.empty_like(painted.coordinates), np.empty(mesh.faces.shape, np.int64)
    for k in range(3):
        points = np.ascontiguousarray(inner[:, k])
        face = surface.walked_to(points, np.ascontiguousarray(ends[:, k]), starts[:, k].astype(np.int64))
        shares = surface.tree.shares_on(face, points)
        weights = np.column_stack([1.0 - shares.sum(axis=1), shares])
        found[:, k] = np.einsum("nk,nkj->nj", weights, coordinates[face])
        which[:, k] = face
    seen = 0.98 * painted.coordinates + 0.02 * painted.coordinates.mean(axis=1, keepdims=True)
    differences = np.abs(found - seen).max(axis=(1, 2))
    return differences[(which == which[:, :1]).all(axis=1)]


if __name__ == "__main__":
    main()
