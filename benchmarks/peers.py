"""Other remeshers, one iteration each, aiming at the middle of the bracket; those not installed are left out.

`make bench` installs them beside the project's own packages, under `peers` in the environment.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import time
from collections.abc import Callable
from pathlib import Path

from pipeline.mesh import TriangleMesh

Remesher = Callable[[TriangleMesh, float], float]

_AIM = 0.75  # target edge length over the maximum edge length


def installed() -> dict[str, Remesher]:
    """By name, a function that remeshes once and answers with the seconds of the call alone."""
    known: dict[str, Remesher] = {"pymeshlab": _pymeshlab, "gpytoolbox": _gpytoolbox}
    sys.path.append(str(Path(sys.prefix) / "peers"))
    return {name: run for name, run in known.items() if importlib.util.find_spec(name)}


def _pymeshlab(mesh: TriangleMesh, longest: float) -> float:
    pymeshlab = importlib.import_module("pymeshlab")
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    aim = pymeshlab.PureValue(_AIM * longest)
    start = time.perf_counter()
    meshes.meshing_isotropic_explicit_remeshing(
        iterations=1, targetlen=aim, featuredeg=40, checksurfdist=False, reprojectflag=False
    )
    return time.perf_counter() - start


def _gpytoolbox(mesh: TriangleMesh, longest: float) -> float:
    gpytoolbox = importlib.import_module("gpytoolbox")
    vertices, faces = mesh.vertices.copy(), mesh.faces.copy()
    start = time.perf_counter()
    gpytoolbox.remesh_botsch(vertices, faces, 1, _AIM * longest, False)
    return time.perf_counter() - start
