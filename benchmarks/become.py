"""Fits of the flow `become`: how near they come to their targets, what they shrink, and CPU seconds.

    python -m benchmarks.become                         # our own solids, medium
    python -m benchmarks.become fine bunny.obj cow.off  # a ball becomes each of these models
    python -m benchmarks.become medium bunny.obj,cow.off   # the first becomes the second
    python -m benchmarks.become medium letter:R letter:S:DejaVuSerif-Bold   # a drop or rings become a letter
    python -m benchmarks.become simulate 0.025 cow.off  # 49 frames, edges of 0.025: faces that fold or cross

Fonts are those that come with Matplotlib, by default DejaVuSans-Bold.
Fits are computed, whatever the cache holds, and stored nowhere; simulations take medium fits from the cache.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any, get_args

import matplotlib
import numpy as np

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.mesh.meshes import PolygonMesh, TriangleMesh
from flowsculpt.pipeline.mesh.normals import NORMAL
from flowsculpt.pipeline.plugins.become import stored_fits
from flowsculpt.pipeline.plugins.become.fitting import Detail
from flowsculpt.pipeline.plugins.become.stored_fits import PlacedShape, fit_between
from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh
from flowsculpt.pipeline.plugins.lettering.kinds import TextKind
from flowsculpt.pipeline.plugins.lettering.starts import starts
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.subjects import Model, Solid
from flowsculpt.pipeline.statistics import self_intersections
from flowsculpt.render.base.input_files import InputFile

ORIGIN = (0.0, 0.0, 0.0)
FONTS = Path(matplotlib.get_data_path()) / "fonts" / "ttf"


def extruded(outline: Any, depth: float) -> TriangleMesh:
    """Return a plane outline (N, 2), counter-clockwise, as a solid of that depth."""
    count = len(outline)
    back, front = (np.column_stack([outline, np.full(count, z)]) for z in (-depth / 2, depth / 2))
    ring = np.arange(count)
    sides = np.column_stack([ring, np.roll(ring, -1), np.roll(ring, -1) + count, ring + count])
    corners = np.concatenate([ring[::-1], ring + count, sides.ravel()])
    offsets = np.concatenate([[0, count, 2 * count], 2 * count + 4 * np.arange(1, count + 1)])
    return PolygonMesh.from_arrays(np.concatenate([back, front]), offsets, corners).triangulated()


def star_prism() -> TriangleMesh:
    """Return a prism over a star with five points."""
    angle = np.pi / 2 + np.pi * np.arange(10) / 5
    radius = np.where(np.arange(10) % 2, 0.5, 1.0)
    return extruded(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]), 0.7)


def letter_f() -> TriangleMesh:
    """Return the letter F, 2 units high."""
    steps = [(0, 0), (0.37, 0), (0.37, 0.79), (1.05, 0.79), (1.05, 1.16), (0.37, 1.16), (0.37, 1.63)]
    return extruded(np.array([*steps, (1.26, 1.63), (1.26, 2), (0, 2)]), 0.38)


def letter(folder: Path, text: str, font: str = "DejaVuSans-Bold") -> tuple[Path, Path]:
    """Write what a letter begins as, and the letter, as models into a folder."""
    kind = TextKind.model_construct(text=text, font=str(FONTS / f"{font}.ttf"))
    meshes = starts(kind.shapes(folder), kind.depth), kind.surface(folder)
    files = folder / f"start_{font}_{ord(text)}.ply", folder / f"{font}_{ord(text)}.ply"
    for mesh, file in zip(meshes, files, strict=True):
        write_mesh(mesh, file)
    return files


def model(file: Path, fit: float | None = 2.0) -> PlacedShape:
    return PlacedShape(Model(InputFile(file).digest(), path=file, fit=fit), ORIGIN)


def pair(name: str, folder: Path, ball: PlacedShape) -> tuple[PlacedShape, PlacedShape]:
    """Return the shapes that the command line names."""
    kind, *words = name.split(":")
    if kind == "letter":
        start, end = (model(file, None) for file in letter(folder, *words))
        return start, end
    shapes = [model(Path(file)) for file in name.split(",")]
    return (shapes[0], shapes[1]) if len(shapes) > 1 else (ball, shapes[0])


def pairs(folder: Path, names: list[str]) -> list[tuple[PlacedShape, PlacedShape]]:
    """Return the shapes to fit: of the files that are named, or our own."""
    ball = PlacedShape(Solid.of("icosphere", {}), ORIGIN)
    if names:
        return [pair(name, folder, ball) for name in names]
    made = {"star.ply": star_prism(), "f.ply": letter_f()}
    for name, mesh in made.items():
        write_mesh(mesh, folder / name)
    box = PlacedShape(Solid.of("box", {"size": [1.5, 1.5, 1.5]}), ORIGIN)
    torus, thin = (
        PlacedShape(Solid.of("torus", {"radius": 0.8, "tube_radius": tube}), ORIGIN) for tube in (0.35, 0.15)
    )
    return [(box, ball), (torus, thin), *((ball, model(folder / name)) for name in made)]


def main(folder: Path, detail: Detail, names: list[str]) -> None:
    print("| | mean / 95 %, there | back | worst part | least det J | CPU s |\n|---|---|---|---|---|---|")
    for start, target in pairs(folder, names):
        began = time.process_time()
        mean, most, back, far, patch, least = fit_between(start, target, detail).residual
        seconds = time.process_time() - began
        stored_fits.CachedAnswer.of("fits", []).path.unlink()
        numbers = (
            f"{mean:.2%} / {most:.2%} | {back:.2%} / {far:.2%} | {patch:.2%} | {least:.2g} | {seconds:.0f}"
        )
        print(f"| {start.name} to {target.name} | {numbers} |", flush=True)


SHOT = """\
title: One shape becomes another
frames: 1-49
subject: {{{subject}}}
resample: {{max_edge_length: {edge}}}
flows: [become: {{{target}, from: 1, to: 49}}]
"""


def entry(shape: PlacedShape) -> str:
    """Return a shape as a shot file has it."""
    subject = shape.subject
    if isinstance(subject, Model):
        return f"model: {subject.path.absolute()}" + (f", fit: {subject.fit}" if subject.fit else "")
    measures = (
        f"{name}: {list(value) if isinstance(value, tuple) else value}" for name, value in subject.measures
    )
    return ", ".join([f"solid: {subject.solid}", *measures])


def opposed(mesh: TriangleMesh) -> int:
    """Return how many faces look against the mean of their corners' carried normals."""
    a, b, c = (mesh.vertices[corners] for corners in mesh.faces.T)
    normals = mesh.attributes[NORMAL][mesh.faces].sum(axis=1)
    return int((np.sum(np.cross(b - a, c - a) * normals, axis=1) < 0.0).sum())


def simulate(folder: Path, edge: float, names: list[str]) -> None:
    """Print, for all frames of each pair, the faces that look against their normals and pairs that cross."""
    print("| | faces of all frames | against their normals | crossings | CPU s |\n|---|---|---|---|---|")
    for start, target in pairs(folder, names):
        fit_between(start, target, "medium")
        shot = read_shot("become.yaml", SHOT.format(subject=entry(start), target=entry(target), edge=edge))
        faces = folded = crossings = 0
        seconds = -time.process_time()
        for frame in animate(shot):
            seconds += time.process_time()
            faces, folded = faces + len(frame.mesh.faces), folded + opposed(frame.mesh)
            crossings += self_intersections(frame.mesh)
            seconds -= time.process_time()
        seconds += time.process_time()
        name = f"{start.name} to {target.name}"
        print(f"| {name} | {faces:,} | {folded} | {crossings} | {seconds:.0f} |", flush=True)


if __name__ == "__main__":
    from tempfile import TemporaryDirectory
    from unittest.mock import patch

    given = sys.argv[1:]
    if given[:1] == ["simulate"]:
        with TemporaryDirectory() as made:
            simulate(Path(made), float(given[1]), given[2:])
        sys.exit()
    detail: Any = given.pop(0) if given and given[0] in get_args(Detail) else "medium"
    with TemporaryDirectory() as made:
        fresh = Path(made) / "fit.npz"  # fits that are stored already would take no time
        with patch.object(stored_fits.CachedAnswer, "of", lambda *_: stored_fits.CachedAnswer(fresh)):
            main(Path(made), detail, given)
