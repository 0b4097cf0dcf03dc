"""Twelve short films of different kinds, each as the digest of all that its last frame depends on."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping

import numpy as np

from flowsculpt.pipeline.flow import Flow, Sequence, Streamlines, Sum
from flowsculpt.pipeline.flow.catalogue.basic import Enright, Expansion, Rotation
from flowsculpt.pipeline.flow.catalogue.deformations import Bend, Twist
from flowsculpt.pipeline.flow.catalogue.lorenz import Lorenz
from flowsculpt.pipeline.flow.catalogue.vortices import SpiralVortex, Vortex, VortexRing
from flowsculpt.pipeline.flow.keyframes import Keyframes, keyed
from flowsculpt.pipeline.mesh import (
    PolygonMesh,
    TriangleMesh,
    box,
    icosphere,
    rod,
    sheet,
    torus,
    vertex_normals,
)
from flowsculpt.pipeline.mesh.analytic_surfaces import SphereSurface
from flowsculpt.pipeline.mesh.halfedge_mesh import with_identities
from flowsculpt.pipeline.plugins.fields.attraction import Attraction, Target
from flowsculpt.pipeline.plugins.fields.curl_noise import CurlNoise
from flowsculpt.pipeline.plugins.fields.formula_field import FormulaField
from flowsculpt.pipeline.resample import (
    Chord,
    Curvature,
    Curved,
    DistanceToCamera,
    Exact,
    Placement,
    Resampler,
    ThresholdFormula,
    Thresholds,
    polygon_method,
)
from flowsculpt.pipeline.resample.resampler import Splits
from flowsculpt.pipeline.statistics import mesh_statistics

DT = 1 / 12
NAMED = Thresholds(ThresholdFormula("0.12 + 0.04 * abs(y)"))


def _film(
    mesh: TriangleMesh,
    flow: Flow,
    thresholds: Thresholds,
    placement: Placement = Chord(),  # noqa: B008  # a value
    splits: Splits = "edges",
    frames: int = 5,
) -> str:
    resampler = Resampler(mesh, thresholds, placement, splits=splits)
    for frame in range(frames):
        resampler.vertices[:] = flow.displace(resampler.vertices, frame * DT, DT)
        resampler.resample()
    numbers = repr(mesh_statistics(resampler.mesh)).encode()
    return _digest(*resampler.state().values(), resampler.births, np.frombuffer(numbers, np.uint8))


def _exact(flow: Flow, frames: int = 5) -> str:
    """Return that of a sphere with normals, whose new vertices are carried from rest."""
    now = [0]

    def carried(points: np.ndarray) -> np.ndarray:
        for frame in range(now[0]):
            points = flow.displace(points, frame * DT, DT)
        return points

    ball = icosphere(8)
    mesh = ball.with_attributes(normal=vertex_normals(ball))
    resampler = Resampler(mesh, Thresholds(0.14), Exact(carried, SphereSurface(1.0)), min_roundness=0.7)
    for frame in range(frames):
        resampler.vertices[:] = flow.displace(resampler.vertices, frame * DT, DT)
        now[0] = frame + 1
        resampler.resample()
    return _digest(*resampler.state().values())


def _polygons(flow: Flow, frames: int = 3) -> str:
    resampler = polygon_method("polyhedra").begin(
        PolygonMesh.from_triangles(box(edge_length=0.4)), Thresholds(0.4)
    )
    for frame in range(frames):
        resampler.vertices[:] = flow.displace(resampler.vertices, frame * DT, DT)
        resampler.resample()
    return _digest(resampler.mesh.vertices, resampler.mesh.offsets, resampler.mesh.corners)


def _textured(flow: Flow) -> str:
    from flowsculpt.pipeline.plugins.interchange.foreign_meshes import TextureCoordinates

    ball = icosphere(6)
    angle = np.arctan2(ball.vertices[:, 2], ball.vertices[:, 0])[ball.faces] / (2 * np.pi)
    around = angle - np.round(angle - angle[:, :1])  # a seam behind
    uv = np.stack([around, ball.vertices[:, 1][ball.faces]], axis=2)
    texture = TextureCoordinates(ball.vertices, ball.faces, uv)
    resampler = Resampler(texture.prepare(ball), Thresholds(0.2))
    for frame in range(4):
        resampler.vertices[:] = flow.displace(resampler.vertices, frame * DT, DT)
        resampler.resample()
    found = texture.split(resampler.mesh)
    return _digest(found.vertices, found.faces, found.attributes["uv"])


def _digest(*arrays: np.ndarray | None) -> str:
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays if array is not None)).hexdigest()


def _keyed(*values: float) -> Keyframes:
    return keyed(tuple(0.2 * k for k in range(len(values))), values)


FILMS: Mapping[str, Callable[[], str]] = {
    "chord": lambda: _film(icosphere(9), Streamlines(Vortex(strength=4.0)), Thresholds(0.13)),
    "curved": lambda: _film(icosphere(8), Twist(amount=_keyed(0.0, 1.5, 0.5)), Thresholds(0.13), Curved()),
    "exact": lambda: _exact(Streamlines(Sum((Vortex(strength=3.0), Expansion(rate=0.6))), tolerance=1e-4)),
    "creases": lambda: _film(box(edge_length=0.25), Bend(amount=_keyed(0.0, 0.6)), Thresholds(0.2)),
    "boundary": lambda: _film(
        sheet(edge_length=0.2), Streamlines(CurlNoise(strength=0.8, seed=3)), Thresholds(0.2)
    ),
    "curvature": lambda: _film(
        torus(1.0, 0.3, 0.12), Streamlines(Enright()), Thresholds(Curvature(0.004, 0.06, 0.3))
    ),
    "camera": lambda: _film(
        rod(2.0, 0.3, 0.12),
        Streamlines(SpiralVortex()),
        Thresholds(DistanceToCamera((3.0, 0.0, 0.0), 130.0, 0.08, 0.3)),
    ),
    "faces": lambda: _film(
        icosphere(6), Streamlines(VortexRing(strength=3.0)), Thresholds(0.22), splits="faces"
    ),
    "identities": lambda: _film(
        with_identities(icosphere(9)),
        Sequence((Streamlines(Lorenz()), Streamlines(Rotation()))),
        Thresholds(0.12, max_vertices=20_000),
        frames=3,
    ),
    "formulas": lambda: _film(
        icosphere(7), Streamlines(FormulaField(("-y", "x", "0.3 * sin(3 * t)"))), NAMED
    ),
    "polygons": lambda: _polygons(Streamlines(Attraction(Target.points(np.eye(3)), radius=1.5))),
    "texture": lambda: _textured(Streamlines(Vortex(strength=-3.0, profile="gaussian"))),
}
