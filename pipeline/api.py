"""The public API: what plug-ins, scripts and notebooks may import. All else may change with any version.

Each name is imported from its module when first used, so that the module of a `Plugin` costs no command time.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.animation import animate as animate
    from pipeline.cli.options import Common as Common
    from pipeline.cli.options import Frames as Frames
    from pipeline.cli.options import Quality as Quality
    from pipeline.cli.options import Shot as Shot
    from pipeline.cli.options import ShotOptions as ShotOptions
    from pipeline.cli.output import print_result as print_result
    from pipeline.errors import FlowsculptError as FlowsculptError
    from pipeline.errors import FrameError as FrameError
    from pipeline.errors import UsageError as UsageError
    from pipeline.flow import Flow as Flow
    from pipeline.flow import VelocityField as VelocityField
    from pipeline.flow.parameters import Number as Number
    from pipeline.flow.parameters import ParameterDoc as ParameterDoc
    from pipeline.flow.parameters import Positive as Positive
    from pipeline.flow.parameters import VectorParameter as VectorParameter
    from pipeline.flow.parameters import number_at as number_at
    from pipeline.flow.parameters import vector_at as vector_at
    from pipeline.flow.velocity import ExternalField as ExternalField
    from pipeline.kernels import block_kernel as block_kernel
    from pipeline.mesh import TriangleMesh as TriangleMesh
    from pipeline.mesh import box as box
    from pipeline.mesh import icosphere as icosphere
    from pipeline.mesh.mesh_formats import MeshFormat as MeshFormat
    from pipeline.plugin import Animation as Animation
    from pipeline.plugin import Command as Command
    from pipeline.plugin import PictureStage as PictureStage
    from pipeline.plugin import Plugin as Plugin
    from pipeline.plugin import plugins as plugins
    from pipeline.production.picture_sequences import PictureSequence as PictureSequence
    from pipeline.production.picture_sequences import SequenceQuery as SequenceQuery
    from pipeline.production.store.remote_store import RemoteStore as RemoteStore
    from pipeline.production.store.remote_store import RemoteStores as RemoteStores
    from pipeline.resample import Chord as Chord
    from pipeline.resample import Curved as Curved
    from pipeline.resample import Exact as Exact
    from pipeline.resample import Resampler as Resampler
    from pipeline.resample import Thresholds as Thresholds
    from pipeline.resample import resample as resample
    from pipeline.shot import read_shot as read_shot
    from pipeline.shot.documents.field_types import Document as Document
    from pipeline.shot.documents.subject_kinds import CopyLayout as CopyLayout
    from pipeline.shot.documents.subject_kinds import SubjectKind as SubjectKind
    from render.movie.codecs import ENCODES as ENCODES
    from render.movie.codecs import Encode as Encode
    from render.scene.aovs import RenderedFrame as RenderedFrame
    from render.scene.materials import LOOKS as LOOKS
    from render.scene.materials import Material as Material
    from render.scene.patterns import Pigment as Pigment

_MODULES = {
    "pipeline.animation": ("animate",),
    "pipeline.cli.options": ("Common", "Frames", "Quality", "Shot", "ShotOptions"),
    "pipeline.cli.output": ("print_result",),
    "pipeline.errors": ("FlowsculptError", "FrameError", "UsageError"),
    "pipeline.flow": ("Flow", "VelocityField"),
    "pipeline.flow.parameters": (
        "Number",
        "ParameterDoc",
        "Positive",
        "VectorParameter",
        "number_at",
        "vector_at",
    ),
    "pipeline.flow.velocity": ("ExternalField",),
    "pipeline.kernels": ("block_kernel",),
    "pipeline.mesh": ("TriangleMesh", "box", "icosphere"),
    "pipeline.mesh.mesh_formats": ("MeshFormat",),
    "pipeline.plugin": ("Animation", "Command", "PictureStage", "Plugin", "plugins"),
    "pipeline.production.picture_sequences": ("PictureSequence", "SequenceQuery"),
    "pipeline.production.store.remote_store": ("RemoteStore", "RemoteStores"),
    "pipeline.resample": ("Chord", "Curved", "Exact", "Resampler", "Thresholds", "resample"),
    "pipeline.shot": ("read_shot",),
    "pipeline.shot.documents.field_types": ("Document",),
    "pipeline.shot.documents.subject_kinds": ("CopyLayout", "SubjectKind"),
    "render.movie.codecs": ("ENCODES", "Encode"),
    "render.scene.aovs": ("RenderedFrame",),
    "render.scene.materials": ("LOOKS", "Material"),
    "render.scene.patterns": ("Pigment",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"pipeline.api has no {name!r}: it is not part of the public API")
    return getattr(import_module(_MODULE_OF[name]), name)
