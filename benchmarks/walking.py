"""`python -m benchmarks.walking FILE.glb [FRAMES]`: a walking character resampled at half its edge length.

FILE is a glTF of one primitive with a skin and a texture, such as CesiumMan of the Khronos sample models;
its walk is repeated over 60 frames, or FRAMES. Each frame is compared with the surface that the file has at
its time, read on its own: the distance of vertices and of the middles of faces, in edges of
`max_edge_length`, root mean square; the longest edge; and the difference of texture coordinates, which
trimesh reads, at corners of faces within one face of the file. Writes `benchmarks/out/walking.json`.
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
from flowsculpt.pipeline.mesh.mesh_formats import FileSurface
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.shot import read_shot

RATE = 24

SHOT = """\
title: A walk
frames: 1-{frames}
subject: {{sequence: {path}, paint: on, loop: true}}
resample: {{max_edge_length: {edge}}}
look: model
"""


def main() -> None:
    path, frames = Path(sys.argv[1]).resolve(), int((*sys.argv[2:], 60)[0])
    moving = ModelFile(path).motion()
    first = moving.at(moving.times[0])
    faces = first.corners.reshape(-1, 3)
    sides = first.points[faces] - np.roll(first.points[faces], -1, axis=1)
    edge = 0.5 * float(np.linalg.norm(sides, axis=2).mean())
    (textured,) = trimesh.load(path, process=False).geometry.values()
    coordinates = np.asarray(textured.visual.uv)[faces]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "walk.yaml"
        file.write_text(SHOT.format(frames=frames, path=path, edge=edge))
        shot = read_shot(file)
        far, longest, apart = [], 0.0, []
        length = float(moving.times[-1] - moving.times[0]) + 1.0 / RATE
        for frame in animate(shot):
            seconds = (frame.number - 1) / RATE % length
            corners = moving.at(moving.times[0] + seconds).points[faces]
            tree = TriangleTree.of(corners)
            mesh = frame.mesh
            own = mesh.vertices[mesh.faces]
            longest = max(longest, float(np.linalg.norm(own - np.roll(own, -1, axis=1), axis=2).max()))
            middles = np.ascontiguousarray(own.mean(axis=1))
            for points in (mesh.vertices, middles):
                face, shares = tree.nearest(np.ascontiguousarray(points))
                weights = np.column_stack([1.0 - shares.sum(axis=1), shares])
                there = np.einsum("nk,nkj->nj", weights, corners[face])
                far.append(np.linalg.norm(points - there, axis=1))
            painted = shot.motion.painted(frame.material, mesh.faces)
            assert painted is not None and frame.material is not None, "the model has paint"
            apart.append(_differences(frame.material[mesh.faces], painted.coordinates, first, coordinates))
    moving.close()
    distance = float(np.sqrt((np.concatenate(far) ** 2).mean())) / edge
    shades = 255.0 * np.concatenate(apart)
    targets = [
        Target(path.stem, "distance, edges, root mean square", distance, most=0.05),
        Target(path.stem, "longest edge, of the greatest", longest / edge, most=1.0 + 1e-9),
        Target(
            path.stem, "texture, steps of 1/255, 99.9% of faces", float(np.quantile(shades, 0.999)), most=1.0
        ),
        Target(path.stem, "texture, steps of 1/255, most", float(shades.max())),
    ]
    rows = [target.row for target in targets]
    show(f"A character resampled, {frames} frames", rows)
    keep("walking", rows)


def _differences(rest: AnyArray, painted: AnyArray, first: FileSurface, coordinates: AnyArray) -> AnyArray:
    """Return differences of texture coordinates (N,) of faces within one face of the file.

    rest, painted  corners of faces at rest (F, 3, 3), and their coordinates (F, 3, 2)
    coordinates    of the corners of the file's faces
    """
    corners = first.points[first.corners.reshape(-1, 3)]
    tree = TriangleTree.of(corners)
    inner = 0.98 * rest + 0.02 * rest.mean(axis=1, keepdims=True)
    found = np.empty_like(painted)
    which = np.empty(painted.shape[:2], np.int64)
    for k in range(3):
        face, shares = tree.nearest(np.ascontiguousarray(inner[:, k]))
        weights = np.column_stack([1.0 - shares.sum(axis=1), shares])
        found[:, k] = np.einsum("nk,nkj->nj", weights, coordinates[face])
        which[:, k] = face
    seen = 0.98 * painted + 0.02 * painted.mean(axis=1, keepdims=True)
    differences = np.abs(found - seen).max(axis=(1, 2))
    return differences[(which == which[:, :1]).all(axis=1)]


if __name__ == "__main__":
    main()
