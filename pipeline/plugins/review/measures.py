"""Measures of mesh frames, for curves and review pages; stored by the key of the mesh."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from flowsculpt import TriangleMesh, mesh_statistics
from flowsculpt.api.files import CachedAnswer
from flowsculpt.api.frames import MeshFrame, PipelineStage, RenderRequest, Store, StoredFiles, key_of
from flowsculpt.api.meshes import Floats

MEASURE = PipelineStage("measure", version=2, doing="measuring", makes="measures", per_quality=False)

Crossings = Annotated[
    bool,
    typer.Option(
        "--crossings",
        help="Count pairs of faces that pass through each other in every frame. Default: in the first frame, "
        "every eighth after it and the last.",
    ),
]

BINS = 48
"""Bins of a histogram."""

LONGEST = 1.25
"""Upper end of histograms of edge lengths, in maximum edge lengths; longer edges are in the last bin."""

TIMED_STAGES = ("simulate", "smooth_normals", "finish")
"""The stages whose seconds are drawn, beside those of rendering."""


def measures_of(frame: MeshFrame, maximum: float | None, count_crossings: bool = False) -> dict[str, Any]:
    """Return the measures of a mesh frame by name; those that do not apply, or were not counted, are None.

    maximum          its maximum edge length, if one number holds for all edges
    count_crossings  count the crossings where the frame's report has no count

    vertices, faces   how many
    splits, collapses, flips, too_short   counts, as the frame's report has them
    crossings         pairs of faces that intersect
    area, volume      scene units squared and cubed; a surface with a rim has no volume
    mean_edge         scene units
    edges             (BINS,) shares of the edges, by length from 0 to `edge_top` scene units
    quality           (BINS,) shares of the triangles, by roundness from 0 to 1: twice the inradius over the
                      circumradius, 1 of an equilateral one
    worst             the roundness that a hundredth of the triangles fall short of
    """
    mesh, done, statistics = frame.mesh, frame.report.resampling, frame.report.statistics
    lengths, roundness = edge_lengths(mesh), roundness_of(mesh)
    crossings = statistics.crossings if statistics else None
    if statistics and crossings is None and count_crossings:
        crossings = mesh_statistics(mesh).crossings
    top = LONGEST * maximum if maximum else float(lengths.max(initial=0.0)) or None
    return {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        **{name: getattr(done, name, None) for name in ("splits", "collapses", "flips", "too_short")},
        "crossings": crossings,
        "area": statistics.area if statistics else None,
        "volume": volume_of(mesh),
        "mean_edge": statistics.mean_edge if statistics else None,
        "edge_top": top,
        "edges": _shares(lengths, top),
        "quality": _shares(roundness, 1.0),
        "worst": round(float(np.quantile(roundness, 0.01)), 4) if len(roundness) else None,
    }


def edge_lengths(mesh: TriangleMesh) -> Floats:
    """Return edge lengths (3 F,), every edge once for each of its faces; scene units."""
    corners = mesh.vertices[mesh.faces]
    return np.asarray(np.linalg.norm(corners[:, (1, 2, 0)] - corners, axis=2)).ravel()


def roundness_of(mesh: TriangleMesh) -> Floats:
    """Return twice the inradius over the circumradius of each triangle (F,); 0 if it has no area."""
    a, b, c = edge_lengths(mesh).reshape(-1, 3).T
    product = a * b * c
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = (b + c - a) * (c + a - b) * (a + b - c) / product
    return np.asarray(np.where(product > 0.0, np.clip(ratio, 0.0, 1.0), 0.0))


def volume_of(mesh: TriangleMesh) -> float | None:
    """Return the volume by the divergence theorem, scene units cubed; None if the mesh is not closed."""
    if not len(mesh.faces):
        return None
    starts, ends = mesh.faces.ravel(), mesh.faces[:, (1, 2, 0)].ravel()
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    _, uses = np.unique(low.astype(np.int64) * len(mesh.vertices) + high, return_counts=True)
    if (uses != 2).any():
        return None
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)


def _shares(values: NDArray[np.floating], top: float | None) -> tuple[float, ...] | None:
    if not len(values) or not top:
        return None
    counts = np.bincount(np.clip((values / top * BINS).astype(int), 0, BINS - 1), minlength=BINS)
    return tuple(round(float(share), 5) for share in counts / len(values))


def measured(
    request: RenderRequest,
    store: Store,
    numbers: Iterable[int],
    threads: int,
    tell: Callable[[], None] = lambda: None,
    count_crossings: bool = False,
) -> dict[int, dict[str, Any]]:
    """Return the measures of all simulated meshes, by frame, as plain data; call `tell` after each frame.

    Those of several subjects are taken together. Crossings are those that the simulation counted, and those
    of the last frame; with `count_crossings` of every frame.
    """
    last = request.shot.frames.last

    def one(number: int) -> tuple[int, dict[str, Any] | None]:
        found = [_of_frame(part, store, number, count_crossings or number == last) for part in request.parts]
        each = [data for data in found if data is not None]
        data = together(each) if len(each) == len(found) else None
        tell()
        return number, data

    with ThreadPoolExecutor(threads) as pool:
        return {number: data for number, data in pool.map(one, numbers) if data is not None}


def together(each: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the measures of several subjects taken as one surface; a measure that one of them lacks is None.

    Histograms of edges have the range of the longest, and are None where ranges differ.
    """
    if len(each) == 1:
        return each[0]
    faces = np.array([data["faces"] for data in each], np.float64)

    def values(name: str) -> list[Any] | None:
        found = [data[name] for data in each]
        return None if None in found else found

    def mean(name: str) -> Any:
        found = values(name)
        return None if found is None else np.average(found, axis=0, weights=faces).round(5).tolist()

    sums = ("vertices", "faces", "splits", "collapses", "flips", "too_short", "crossings", "area", "volume")
    tops = {data["edge_top"] for data in each}
    return {
        **{name: None if (found := values(name)) is None else sum(found) for name in sums},
        "mean_edge": mean("mean_edge"),
        "edge_top": each[0]["edge_top"] if len(tops) == 1 else None,
        "edges": mean("edges") if len(tops) == 1 else None,
        "quality": mean("quality"),
        "worst": None if (worst := values("worst")) is None else min(worst),
    }


def _of_frame(
    request: RenderRequest, store: Store, number: int, count_crossings: bool
) -> dict[str, Any] | None:
    place = simulated(request, store, number, "mesh")
    if place is None:
        return None
    path, mesh = place
    resampling = request.shot.motion.resampling_at(number)
    maximum = None if resampling is None else _as_number(resampling.thresholds.max_edge_length)
    key = key_of(MEASURE.recipe, mesh, maximum, count_crossings)
    known = store.path("measures", key)
    try:
        store.bring("measures", key)
        store.digests.check(known)
        if (measured := CachedAnswer(known).load(dict)) is not None:
            return measured
    except (*StoredFiles.DAMAGED, OSError):
        pass
    store.discard("measures", key)
    try:
        store.digests.check(path)
        found = measures_of(StoredFiles("mesh").reader(mesh, number=number)(path), maximum, count_crossings)
    except (*StoredFiles.DAMAGED, OSError):
        return None
    store.put("measures", key, lambda draft: draft.write_text(json.dumps(found), encoding="utf-8"))
    return found


def simulated(request: RenderRequest, store: Store, number: int, kind: str) -> tuple[Path, str] | None:
    """Return path and key of the `mesh` or the `normals` of a frame; None if it is not simulated.

    The file in renders/, from which pictures were rendered, goes first, even if the shot has changed since.
    """
    shown = store.root / request.place(kind, number)
    try:
        return shown, StoredFiles.key_in(shown)
    except (*StoredFiles.DAMAGED, OSError):
        key = request.keys.mesh(number) if kind == "mesh" else request.keys.normals(number)
        return (store.path(kind, key), key) if store.bring(kind, key) else None


def limits_of(request: RenderRequest) -> tuple[float | None, float | None]:
    """Return minimum and maximum edge length of the first frame, scene units; None if they are no numbers.

    None too where several subjects have different ones.
    """
    found = set()
    for part in request.shot.parts:
        resampling = part.motion.resampling_at(part.frames.first)
        said = resampling.settings() if resampling else {}
        found.add(tuple(_as_number(said.get(name)) for name in ("min_edge_length", "max_edge_length")))
    low, high = found.pop() if len(found) == 1 else (None, None)
    return low, high


def _as_number(value: object) -> float | None:
    return float(value) if isinstance(value, (int, float)) else None
