"""Names of meshes, and the modules that `__init__.py` imports them from when they are first used."""

from flowsculpt.pipeline.mesh.halfedge_mesh import HalfedgeMesh as HalfedgeMesh
from flowsculpt.pipeline.mesh.meshes import PolygonMesh as PolygonMesh
from flowsculpt.pipeline.mesh.meshes import TriangleMesh as TriangleMesh
from flowsculpt.pipeline.mesh.normals import ShadedMesh as ShadedMesh
from flowsculpt.pipeline.mesh.normals import dihedral_angles as dihedral_angles
from flowsculpt.pipeline.mesh.normals import split_at_creases as split_at_creases
from flowsculpt.pipeline.mesh.normals import vertex_normals as vertex_normals
from flowsculpt.pipeline.mesh.read import read_mesh as read_mesh
from flowsculpt.pipeline.mesh.read import read_polygons as read_polygons
from flowsculpt.pipeline.mesh.solids import box as box
from flowsculpt.pipeline.mesh.solids import icosphere as icosphere
from flowsculpt.pipeline.mesh.solids import rod as rod
from flowsculpt.pipeline.mesh.solids import sheet as sheet
from flowsculpt.pipeline.mesh.solids import torus as torus
from flowsculpt.pipeline.mesh.validation import Soundness as Soundness
from flowsculpt.pipeline.mesh.validation import validate as validate
