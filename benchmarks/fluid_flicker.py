"""`python -m benchmarks.fluid_flicker [WIDTH] [SAMPLES]`: flicker of a fluid with other faces in each frame.

The metaballs of `carried_meshes`, 8 frames as glaze, WIDTH × 9/16 WIDTH pixels (240) with SAMPLES (32) that
are denoised. Each is rendered with exact normals, with those again and other noise, smoothed by the hard
angle alone, across slivers, and across small triangles too, as frames of a sequence are. Flicker is the
standard deviation over time of the difference from exact normals, steps of 255: its mean over pixels, and
what 99.9% are below. Changes are the mean ones from frame to frame, over those with exact normals. Writes
`benchmarks/out/fluid_flicker.json`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from unittest.mock import patch

import numpy as np

from benchmarks import flicker
from benchmarks.carried_meshes import fluid, slope
from benchmarks.report import Row, keep, show
from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.mesh import PolygonMesh, TriangleMesh
from flowsculpt.pipeline.mesh.normals import split_at_creases
from flowsculpt.pipeline.plugins.sequences import sliver_normals
from flowsculpt.render.mitsuba.engine import choose
from flowsculpt.render.post.denoise import denoise
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.surface import Surface

FRAMES = range(1, 9)
CAMERA = Camera((1.2, 2.2, 5.0), (0.0, 0.85, 0.0))
OTHER_NOISE = "exact, other noise"


def main(width: int = 240, samples: int = 32) -> None:
    engine, films = choose(), dict[str, list[Floats]]()
    for number in FRAMES:
        for name, mesh in variants(number):
            seed = number + (1000 if name == OTHER_NOISE else 0)
            with patch.object(flicker, "CAMERA", CAMERA):
                frame = flicker.rendered("glaze", surface(mesh), samples, seed, engine, width)
            films.setdefault(name, []).append(flicker._shown(denoise(frame)))
    exact, rows = np.stack(films.pop("exact")), list[Row]()
    for name, film in films.items():
        off = (np.stack(film) - exact).std(axis=0)
        changes, changed = (float(np.abs(np.diff(each, axis=0)).mean()) for each in (exact, np.stack(film)))
        row: Row = {"normals": name, "flicker": float(off.mean()), "99.9%": float(np.quantile(off, 0.999))}
        rows.append({**row, "changes": changed / changes})
    show("Flicker of a fluid, steps of 255", rows)
    keep("fluid_flicker", rows)


def variants(number: int) -> Iterator[tuple[str, TriangleMesh]]:
    """Yield the fluid of a frame with normals of each kind."""
    mesh, _ = fluid(number)
    inwards = slope(mesh.vertices, number)
    exact = mesh.with_attributes(normal=-inwards / np.linalg.norm(inwards, axis=1, keepdims=True))
    yield "exact", exact
    yield OTHER_NOISE, exact
    yield "smoothed by the hard angle alone", mesh
    for small, name in ((0.0, "across slivers"), (sliver_normals.SMALL, "across small triangles too")):
        with patch.object(sliver_normals, "SMALL", small):
            normals = sliver_normals.sliver_normals(PolygonMesh.from_triangles(mesh))
        yield name, mesh if normals is None else mesh.with_attributes(normal=normals)


def surface(mesh: TriangleMesh) -> Surface:
    shaded = split_at_creases(mesh)
    points, normals = (each.astype(np.float32) for each in (shaded.vertices, shaded.normals))
    return Surface(points + np.float32([0.0, 0.75, 0.0]), normals, shaded.faces, {}, points)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
