"""The template of a shot of a model: its size, its place, and an edge length that suits its detail."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.mesh import PolygonMesh
from pipeline.mesh.mesh_formats import names_parts
from pipeline.mesh.parts import find_small_parts
from pipeline.mesh.read import states_up, usual_up
from pipeline.shot.model_subject import Model

FIT = 2.0
"""Largest extent of models in new shots, scene units: that of most built-in solids, which flows suit."""

COARSEST = 0.08
"""Longest edge of new shots, scene units: a surface of this size bends smoothly."""

MOST_VERTICES = 35_000
"""Vertices at rest up to which a preview takes seconds."""

_DETAIL = 1.6
"""Longest edge over the usual edge of a model: its edges are then amid the limits, 40% and 100%."""


@dataclass(frozen=True)
class ModelTemplate:
    """Text for a new shot of a model.

    subject  the entry of the shot file
    facts    comments above it, a line each
    edges    a comment above the edge length
    notes    lines to tell: what was repaired in the file, and small parts that decide its size
    """

    subject: str
    facts: tuple[str, ...]
    edges: str
    max_edge_length: float
    notes: tuple[str, ...]


def model_template(file: Path, reference: str) -> ModelTemplate:
    """Return the text for a new shot of a model file, which the shot names by `reference`.

    Raises MissingInputError or MeshError for a file that is no model.
    """
    imported = Model("", path=file).imported()
    mesh, up = imported.mesh, usual_up(file)
    is_z_up = up == "z" and not states_up(file)
    size = mesh.bounds[1] - mesh.bounds[0]
    fitted = mesh.with_vertices(mesh.vertices * (FIT / size.max()))
    usual = usual_edge(fitted)
    length = suggested_edge_length(fitted)
    small = find_small_parts(mesh)
    parts = () if small is None else (f"{file.name} has {small}",)
    extents = " × ".join(f"{side:.4g}" for side in size)
    word = reference if re.fullmatch(r"[\w./-]+", reference) else json.dumps(reference, ensure_ascii=False)
    units = "its own units" if imported.unit is None else f"its own units, of {imported.unit:.6g} m"
    facts = [f"{file.name}: {imported.vertices} vertices, {imported.faces} faces, {extents} in {units}."]
    if names_parts(file):
        facts.append(f"Its stage has {up} up, which is heeded. prim: /World/Chair reads a part.")
    elif states_up(file):
        facts.append(f"The file says that {up} points up, which is heeded. rotate: [0, 30, 0] turns it.")
    elif is_z_up:
        facts.append("Most STL files have z up. If the model lies on its back, write up: y.")
    else:
        facts.append(
            "If the model lies on its face, its file has z up: add up: z. rotate: [0, 30, 0] turns it."
        )
    return ModelTemplate(
        subject=f"{{model: {word}, fit: {FIT:g}{', up: z' if is_z_up else ''}}}",
        facts=tuple(facts),
        edges=_about_edges(usual, length),
        max_edge_length=length,
        notes=(*imported.warnings, *parts),
    )


def usual_edge(mesh: PolygonMesh) -> float:
    """Return the median length of a mesh's edges, scene units."""
    ends = mesh.vertices[mesh.edges]
    return float(np.median(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))


def suggested_edge_length(mesh: PolygonMesh) -> float:
    """Return a maximum edge length that keeps a mesh's detail, unless that takes over MOST_VERTICES.

    A resampled surface of area A and maximum length L has up to 4.4 A / L² vertices.
    """
    area = float(mesh.areas.sum())
    length = min(max(_DETAIL * usual_edge(mesh), math.sqrt(4.4 * area / MOST_VERTICES)), COARSEST)
    return float(f"{length:.2g}")


def _about_edges(usual: float, length: float) -> str:
    own = f"The model's own edges are about {usual:.2g} long"
    if _DETAIL * usual < 0.9 * length:
        return f"{own}; {_DETAIL * usual:.2g} keeps all their detail, and takes longer."
    return f"{own}."
