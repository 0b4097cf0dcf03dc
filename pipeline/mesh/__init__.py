"""Meshes: values, solids, files, connectivity, validation and normals."""

from pipeline.mesh.halfedge_mesh import HalfedgeMesh
from pipeline.mesh.meshes import PolygonMesh, TriangleMesh
from pipeline.mesh.normals import ShadedMesh, dihedral_angles, face_normals, split_at_creases, vertex_normals
from pipeline.mesh.read import read_mesh, read_polygons
from pipeline.mesh.solids import box, icosphere, rod, sheet, torus
from pipeline.mesh.validation import Soundness, require, validate

__all__ = [
    "HalfedgeMesh",
    "PolygonMesh",
    "ShadedMesh",
    "Soundness",
    "TriangleMesh",
    "box",
    "dihedral_angles",
    "face_normals",
    "icosphere",
    "read_mesh",
    "read_polygons",
    "require",
    "rod",
    "sheet",
    "split_at_creases",
    "torus",
    "validate",
    "vertex_normals",
]
