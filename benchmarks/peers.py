"""Other remeshers, one iteration each, for the middle of the length limits; missing ones are left out.

`make bench` installs them beside the project's own packages, under `peers` in the environment.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.measures import Nearest
from flowsculpt.pipeline.arrays import AnyArray, Faces, Points
from flowsculpt.pipeline.mesh import TriangleMesh

Remesher = Callable[[TriangleMesh, float], tuple[TriangleMesh, float]]
"""(mesh, maximum edge length) -> the mesh remeshed once, and the seconds of the call alone."""

_AIM = 0.75  # target edge length over the maximum edge length


def installed() -> dict[str, Remesher]:
    """Return the installed remeshers, by name."""
    known: dict[str, Remesher] = {"pymeshlab": _pymeshlab, "gpytoolbox": _gpytoolbox}
    return {name: run for name, run in known.items() if found(name)}


def nearest() -> Nearest | None:
    """Return libigl's search for the nearest face, if it is installed."""
    return _nearest if found("igl") and found("scipy") else None


def found(name: str) -> bool:
    """Tell whether a package is installed, in the environment or among the peers."""
    beside = str(Path(sys.prefix) / "peers")
    if beside not in sys.path:
        sys.path.append(beside)
    return importlib.util.find_spec(name) is not None


def _nearest(points: Points, vertices: Points, faces: Faces) -> AnyArray:
    igl = importlib.import_module("igl")
    _, face, _ = igl.point_mesh_squared_distance(points, np.array(vertices), faces.astype(np.int64))
    found: AnyArray = face
    return found


def _pymeshlab(mesh: TriangleMesh, longest: float) -> tuple[TriangleMesh, float]:
    pymeshlab = importlib.import_module("pymeshlab")
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    aim = pymeshlab.PureValue(_AIM * longest)
    start = time.perf_counter()
    meshes.meshing_isotropic_explicit_remeshing(
        iterations=1, targetlen=aim, featuredeg=40, checksurfdist=False, reprojectflag=False
    )
    seconds = time.perf_counter() - start
    done = meshes.current_mesh()
    return TriangleMesh(done.vertex_matrix(), done.face_matrix()), seconds


def _gpytoolbox(mesh: TriangleMesh, longest: float) -> tuple[TriangleMesh, float]:
    gpytoolbox = importlib.import_module("gpytoolbox")
    vertices, faces = mesh.vertices.copy(), mesh.faces.copy()
    start = time.perf_counter()
    vertices, faces = gpytoolbox.remesh_botsch(vertices, faces, 1, _AIM * longest, False)
    seconds = time.perf_counter() - start
    return TriangleMesh(vertices, faces), seconds
