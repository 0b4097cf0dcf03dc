"""The first frame of a shot, computed to check it: its subject, vertices, extent and memory."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from flowsculpt import FrameError, PolygonMesh
from flowsculpt.api.frames import animate
from flowsculpt.api.meshes import Floats, connected_components
from flowsculpt.api.shots import Model, Motion, Solid
from flowsculpt.pipeline.plugins.authoring.growth_forecast import estimated_vertices

LARGEST_COMPUTED = 3_000_000
"""Vertices up to which the first frame is computed; a larger one is estimated by its area."""

POSSIBLY, CERTAINLY = 0.25, 1.5
"""Estimated vertices over the budget from which on it may be exceeded, and from which on it is."""

BYTES_OF_VERTEX = 130
"""Memory of a mesh frame: positions, rest positions, normals, identities, and two triangles a vertex."""


@dataclass(frozen=True)
class FirstFrame:
    """The surface of a shot at its first frame.

    vertices   number of vertices; an estimate where the frame is not computed
    points     (V, 3) vertices, resampled where the frame is computed, else those of the subject
    faces      (F, 3) triangles between `points`
    memory     bytes of one mesh frame
    longest    maximum edge length, units; None where it is a formula, or where nothing is resampled
    exceeds    True if the vertices are more than the shot allows
    subject    the name of its kind, or the file of a model with its format and size
    repairs    what was repaired in the file, a line for each kind
    notes      what was not read as other programs show it, a line for each
    """

    vertices: int
    points: Floats
    faces: np.ndarray[Any, Any]
    memory: int
    longest: float | None
    exceeds: bool = False
    subject: str = ""
    repairs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @cached_property
    def middle(self) -> Floats:
        """The middle of the bounding box (3,)."""
        return np.asarray(0.5 * (self.points.min(axis=0) + self.points.max(axis=0)), np.float64)

    @cached_property
    def extent(self) -> float:
        """The longest side of the bounding box, units."""
        return float(np.ptp(self.points, axis=0).max())

    def as_data(self) -> dict[str, Any]:
        """Return its facts as JSON-able data."""
        return {
            "subject": self.subject,
            "repairs": list(self.repairs),
            "notes": list(self.notes),
            "extent": self.extent,
            "middle": [float(x) for x in self.middle],
            "vertices": self.vertices,
            "memory": self.memory,
            "max_edge_length": self.longest,
        }


class FirstFrames:
    """The first frames of shots. Those that start alike share one."""

    def __init__(self) -> None:
        self._known: dict[str, FirstFrame] = {}

    def of(self, motion: Motion) -> FirstFrame:
        """Return the first frame of a motion.

        Raises MeshError or MissingInputError for an unusable subject, FrameError where resampling fails.
        """
        key = json.dumps(motion.start_data(), sort_keys=True)
        if key not in self._known:
            self._known[key] = _first_frame(motion)
        return self._known[key]


def _first_frame(motion: Motion) -> FirstFrame:
    longest, resampling = motion.longest_edge(motion.frames.first), motion.resampling
    if resampling is None or longest is None:
        return _computed(motion, longest)
    at_rest, budget = motion.mesh_at_rest(), resampling.thresholds.max_vertices
    estimated = estimated_vertices(at_rest, longest)
    exceeds = estimated > CERTAINLY * budget
    if not exceeds and estimated <= LARGEST_COMPUTED:
        try:
            return _computed(motion, longest)
        except FrameError:
            if estimated < POSSIBLY * budget:
                raise
            exceeds = True
    memory, surface = BYTES_OF_VERTEX * estimated, (at_rest.vertices, at_rest.faces)
    return FirstFrame(estimated, *surface, memory, longest, exceeds, **_facts(motion))


def _computed(motion: Motion, longest: float | None) -> FirstFrame:
    frame = next(animate(motion))
    points, memory = frame.mesh.vertices, sum(values.nbytes for values in frame.to_arrays().values())
    return FirstFrame(len(points), points, frame.mesh.faces, memory, longest, **_facts(motion))


def _facts(motion: Motion) -> dict[str, Any]:
    """Return name, repairs and notes; the name is `icosphere`, or `bunny.obj (OBJ, 35,947 vertices, …)`."""
    subject = motion.subject
    if isinstance(subject, Model):
        surface = subject.imported()
        counts = f"{surface.vertices:,} vertices, {surface.faces:,} faces"
        of_file = f"{surface.format}, " if surface.format else ""
        name = f"{subject.path.name} ({of_file}{counts})"
        return {"subject": name, "repairs": surface.repairs, "notes": surface.notes}
    if isinstance(subject, Solid):
        return {"subject": subject.solid}
    return {"subject": "control net" if subject.lattice is not None else "cloud"}


SMALL = 0.01  # part of the surface's area below which a part is small
LARGER = 1.1  # size of the whole surface over that of its other parts from which on small parts decide it


def small_parts(mesh: PolygonMesh) -> str:
    """Say which small parts decide the size of a model; an empty text if it is as large without them."""
    part = connected_components(len(mesh.vertices), mesh.corners, mesh.heads)
    of_face = part[mesh.corners[mesh.offsets[:-1]]]
    area, faces = np.bincount(of_face, mesh.areas, len(part)), np.bincount(of_face, minlength=len(part))
    is_small = (faces > 0) & (area < SMALL * area.sum())
    if not is_small.any() or is_small[faces > 0].all():
        return ""
    small, large = mesh.vertices[is_small[part]], mesh.vertices[~is_small[part]]
    factor = np.ptp(mesh.vertices, axis=0).max() / max(np.ptp(large, axis=0).max(), 1e-300)
    if factor < LARGER:
        return ""
    middle = 0.5 * (large.min(axis=0) + large.max(axis=0))
    at = ", ".join(f"{x:.4g}" for x in small[np.linalg.norm(small - middle, axis=1).argmax()])
    count, share = int(is_small.sum()), 100.0 * faces.max() / len(mesh)
    make, them = (" each, make", "them") if count > 1 else (", makes", "it")
    return (
        f"{int((faces > 0).sum())} parts; the largest has {share:.3g}% of the faces. {count} of them, with "
        f"less than {SMALL:.0%} of the area{make} the model {factor:.3g} times as large; the farthest "
        f"reaches ({at}) in the file. Delete {them} in a modelling program, or leave {them} if the model is "
        f"meant to have {them}."
    )
