"""Shading of a frame that is performed, in a fifth of the time where its surface has no crease.

Creases are found by the neighbours of each face, which have to be found first. Two faces at a vertex whose
normals are both within half of the hard angle of a third direction enclose less than the hard angle. So where
all faces agree so far with the normals of their vertices, the surface has no crease.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types
from numpy.typing import NDArray

from flowsculpt.api.flows import kernel
from flowsculpt.api.frames import MeshFrame, Shading
from flowsculpt.api.materials import Surface
from flowsculpt.api.meshes import Floats, Indices
from flowsculpt.api.shots import Motion

NORMAL = "normal"  # the attribute of vertices that the flow carries

_POINTS = types.Array(types.float64, 2, "C", readonly=True)
_FACES = types.Array(types.int32, 2, "C", readonly=True)


def quick_shading(frame: MeshFrame, motion: Motion, pieces: int) -> dict[str, np.ndarray]:
    """Return the arrays of a frame as `Shading` does; normals of a smooth surface differ by 0.01° at most.

    pieces  into which every edge is cut
    """
    mesh, thresholds = frame.own, motion.thresholds_at(frame.number)
    is_mesh = not frame.is_cloud and frame.lattice is None and frame.copies is None
    is_plain = is_mesh and pieces == 1 and not len(mesh.creases) and NORMAL not in mesh.attributes
    if is_plain and isinstance(thresholds.hard_angle, float):
        normals = np.empty(mesh.vertices.shape, np.float32)
        if smooth_normals(mesh.vertices, mesh.faces, math.cos(thresholds.hard_angle / 2.0), normals):
            named = {"vertices": mesh.vertices, "material": frame.material}
            if Surface.VALUES in mesh.attributes:
                named[Surface.VALUES] = mesh.attributes[Surface.VALUES]
            arrays = {name: values.astype(np.float32) for name, values in named.items()}
            vertices = np.arange(len(mesh.vertices), dtype=np.int32)
            return {**arrays, "normals": normals, "faces": mesh.faces, "source_vertex": vertices}
    return Shading.of(frame, thresholds, pieces).arrays()


@kernel(types.float64(types.float64), _nrt=False, forceinline=True)
def angle_of(cosine: float) -> float:
    """Return the angle of a cosine, within 7e-5 radians (Abramowitz and Stegun 1964, 4.4.45)."""
    x = min(abs(cosine), 1.0)
    angle = math.sqrt(1.0 - x) * (1.5707288 + x * (-0.2121144 + x * (0.0742610 - x * 0.0187293)))
    return angle if cosine >= 0.0 else math.pi - angle


@kernel(types.boolean(_POINTS, _FACES, types.float64, types.float32[:, ::1]), error_model="numpy")
def smooth_normals(points: Floats, faces: Indices, cosine: float, normals: NDArray[np.float32]) -> bool:
    """Compute the normals of vertices: means of those of their faces, weighted by the angles there.

    Returns False, with incomplete normals, where the normal of a face and that of one of its vertices enclose
    more than the angle of `cosine`, or a vertex has none. Faces without area are ignored.
    """
    sums, flat = np.zeros((len(points), 3)), np.zeros((len(faces), 3))
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
        vx, vy, vz = points[c, 0] - points[b, 0], points[c, 1] - points[b, 1], points[c, 2] - points[b, 2]
        wx, wy, wz = -ux - vx, -uy - vy, -uz - vz
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area = math.sqrt(x * x + y * y + z * z)
        if not 0.0 < area < math.inf:
            continue
        u, v = math.sqrt(ux * ux + uy * uy + uz * uz), math.sqrt(vx * vx + vy * vy + vz * vz)
        w = math.sqrt(wx * wx + wy * wy + wz * wz)
        first = angle_of(-(ux * wx + uy * wy + uz * wz) / (u * w))
        second = angle_of(-(ux * vx + uy * vy + uz * vz) / (u * v))
        flat[f, 0], flat[f, 1], flat[f, 2] = x / area, y / area, z / area
        for k in range(3):
            sums[a, k] += first * flat[f, k]
            sums[b, k] += second * flat[f, k]
            sums[c, k] += (math.pi - first - second) * flat[f, k]
    for i in range(len(points)):
        length = math.sqrt(sums[i, 0] * sums[i, 0] + sums[i, 1] * sums[i, 1] + sums[i, 2] * sums[i, 2])
        if not 1e-9 < length < math.inf:
            return False
        for k in range(3):
            sums[i, k] /= length
            normals[i, k] = sums[i, k]
    for f in range(len(faces)):
        x, y, z = flat[f, 0], flat[f, 1], flat[f, 2]
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        for k in range(3):
            i = faces[f, k]
            if sums[i, 0] * x + sums[i, 1] * y + sums[i, 2] * z < cosine:
                return False
    return True
