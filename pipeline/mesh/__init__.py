"""What a surface is: values, solids, files, connectivity, proofs and normals."""

from pipeline.mesh.halfedge import HalfedgeMesh
from pipeline.mesh.io import read_mesh, read_polygons
from pipeline.mesh.normals import ShadedMesh, dihedral_angles, face_normals, split_at_creases, vertex_normals
from pipeline.mesh.polygon_soundness import require_polygons, validate_polygons
from pipeline.mesh.polygons import PolygonMesh
from pipeline.mesh.solids import box, icosphere, rod, sheet, torus
from pipeline.mesh.triangles import TriangleMesh
from pipeline.mesh.validate import Soundness, require, validate
from pipeline.mesh.write import write_mesh

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
    "require_polygons",
    "rod",
    "sheet",
    "split_at_creases",
    "torus",
    "validate",
    "validate_polygons",
    "vertex_normals",
    "write_mesh",
]
