"""Meshes and their arrays; the resampler itself is in `flowsculpt`."""

from flowsculpt.pipeline.arrays import AnyArray as AnyArray
from flowsculpt.pipeline.arrays import Faces as Faces
from flowsculpt.pipeline.arrays import Floats as Floats
from flowsculpt.pipeline.arrays import Indices as Indices
from flowsculpt.pipeline.arrays import Points as Points
from flowsculpt.pipeline.arrays import Vectors as Vectors
from flowsculpt.pipeline.mesh import face_normals as face_normals
from flowsculpt.pipeline.mesh.face_soup import components as components
from flowsculpt.pipeline.mesh.meshes import edge_keys as edge_keys
from flowsculpt.pipeline.mesh.normals import unit as unit
from flowsculpt.pipeline.mesh.points import on_surface as on_surface
from flowsculpt.pipeline.mesh.read import model_files as model_files
from flowsculpt.pipeline.mesh.read import read_paint as read_paint
from flowsculpt.pipeline.mesh.read import surface_reader as surface_reader
from flowsculpt.pipeline.mesh.read import usual_up as usual_up
from flowsculpt.pipeline.mesh.validation import require as require
from flowsculpt.pipeline.mesh.validation import twin_corners as twin_corners
from flowsculpt.pipeline.resample.refinement import Births as Births
from flowsculpt.pipeline.resample.refinement import RefinableSurface as RefinableSurface
from flowsculpt.pipeline.resample.resample_pass import not_finite as not_finite
from flowsculpt.pipeline.resample.thresholds import edges_by_angle as edges_by_angle
from flowsculpt.pipeline.statistics import self_intersections as self_intersections
