"""Meshes and their arrays; the resampler itself is in `flowsculpt`."""

from flowsculpt.pipeline.arrays import Floats as Floats
from flowsculpt.pipeline.arrays import Indices as Indices
from flowsculpt.pipeline.mesh.control_net import Lattice as Lattice
from flowsculpt.pipeline.mesh.face_soup import connected_components as connected_components
from flowsculpt.pipeline.mesh.face_soup import find_coincident as find_coincident
from flowsculpt.pipeline.mesh.mesh_formats import FileSurface as FileSurface
from flowsculpt.pipeline.mesh.mesh_formats import ModelMaterials as ModelMaterials
from flowsculpt.pipeline.mesh.mesh_formats import MovingSurface as MovingSurface
from flowsculpt.pipeline.mesh.mesh_formats import PaintReader as PaintReader
from flowsculpt.pipeline.mesh.mesh_formats import ScenePart as ScenePart
from flowsculpt.pipeline.mesh.mesh_formats import SourceFiles as SourceFiles
from flowsculpt.pipeline.mesh.mesh_formats import SurfaceReader as SurfaceReader
from flowsculpt.pipeline.mesh.meshes import edge_keys as edge_keys
from flowsculpt.pipeline.mesh.meshes import morton_order as morton_order
from flowsculpt.pipeline.mesh.normals import carried_normals as carried_normals
from flowsculpt.pipeline.mesh.normals import split_at_creases as split_at_creases
from flowsculpt.pipeline.mesh.placed_copies import Placements as Placements
from flowsculpt.pipeline.mesh.read import ModelFile as ModelFile
from flowsculpt.pipeline.mesh.read import repair_surface as repair_surface
from flowsculpt.pipeline.resample.refinement import RefinableSurface as RefinableSurface
