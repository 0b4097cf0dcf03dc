"""The public API of plug-ins: what they may import. All else may change with any version.

Each name is imported from its module when first used, so that the module of a `Plugin` costs no command time.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flowsculpt.pipeline.animation import animate as animate
    from flowsculpt.pipeline.cli.options import Common as Common
    from flowsculpt.pipeline.cli.options import Frames as Frames
    from flowsculpt.pipeline.cli.options import Quality as Quality
    from flowsculpt.pipeline.cli.options import Shot as Shot
    from flowsculpt.pipeline.cli.options import ShotOptions as ShotOptions
    from flowsculpt.pipeline.cli.output import print_result as print_result
    from flowsculpt.pipeline.errors import FlowsculptError as FlowsculptError
    from flowsculpt.pipeline.errors import FrameError as FrameError
    from flowsculpt.pipeline.errors import UsageError as UsageError
    from flowsculpt.pipeline.flow import Flow as Flow
    from flowsculpt.pipeline.flow import VelocityField as VelocityField
    from flowsculpt.pipeline.flow.parameters import Number as Number
    from flowsculpt.pipeline.flow.parameters import ParameterDoc as ParameterDoc
    from flowsculpt.pipeline.flow.parameters import Positive as Positive
    from flowsculpt.pipeline.flow.parameters import VectorParameter as VectorParameter
    from flowsculpt.pipeline.flow.parameters import number_at as number_at
    from flowsculpt.pipeline.flow.parameters import vector_at as vector_at
    from flowsculpt.pipeline.flow.velocity import ExternalField as ExternalField
    from flowsculpt.pipeline.kernels import block_kernel as block_kernel
    from flowsculpt.pipeline.mesh import TriangleMesh as TriangleMesh
    from flowsculpt.pipeline.mesh import box as box
    from flowsculpt.pipeline.mesh import icosphere as icosphere
    from flowsculpt.pipeline.mesh.mesh_formats import MeshFormat as MeshFormat
    from flowsculpt.pipeline.plugin import Animation as Animation
    from flowsculpt.pipeline.plugin import Command as Command
    from flowsculpt.pipeline.plugin import PictureStage as PictureStage
    from flowsculpt.pipeline.plugin import Plugin as Plugin
    from flowsculpt.pipeline.plugin import plugins as plugins
    from flowsculpt.pipeline.production.picture_sequences import PictureSequence as PictureSequence
    from flowsculpt.pipeline.production.picture_sequences import SequenceQuery as SequenceQuery
    from flowsculpt.pipeline.production.store.remote_store import RemoteStore as RemoteStore
    from flowsculpt.pipeline.production.store.remote_store import RemoteStores as RemoteStores
    from flowsculpt.pipeline.resample import Chord as Chord
    from flowsculpt.pipeline.resample import Curved as Curved
    from flowsculpt.pipeline.resample import Exact as Exact
    from flowsculpt.pipeline.resample import Resampler as Resampler
    from flowsculpt.pipeline.resample import Thresholds as Thresholds
    from flowsculpt.pipeline.resample import resample as resample
    from flowsculpt.pipeline.shot import read_shot as read_shot
    from flowsculpt.pipeline.shot.documents.field_types import Document as Document
    from flowsculpt.pipeline.shot.documents.subject_kinds import CopyLayout as CopyLayout
    from flowsculpt.pipeline.shot.documents.subject_kinds import SubjectKind as SubjectKind
    from flowsculpt.render.movie.codecs import ENCODES as ENCODES
    from flowsculpt.render.movie.codecs import Encode as Encode
    from flowsculpt.render.scene.aovs import RenderedFrame as RenderedFrame
    from flowsculpt.render.scene.materials import LOOKS as LOOKS
    from flowsculpt.render.scene.materials import Material as Material
    from flowsculpt.render.scene.patterns import Pigment as Pigment

_MODULES = {
    "flowsculpt.pipeline.animation": ("animate",),
    "flowsculpt.pipeline.cli.options": ("Common", "Frames", "Quality", "Shot", "ShotOptions"),
    "flowsculpt.pipeline.cli.output": ("print_result",),
    "flowsculpt.pipeline.errors": ("FlowsculptError", "FrameError", "UsageError"),
    "flowsculpt.pipeline.flow": ("Flow", "VelocityField"),
    "flowsculpt.pipeline.flow.parameters": (
        "Number",
        "ParameterDoc",
        "Positive",
        "VectorParameter",
        "number_at",
        "vector_at",
    ),
    "flowsculpt.pipeline.flow.velocity": ("ExternalField",),
    "flowsculpt.pipeline.kernels": ("block_kernel",),
    "flowsculpt.pipeline.mesh": ("TriangleMesh", "box", "icosphere"),
    "flowsculpt.pipeline.mesh.mesh_formats": ("MeshFormat",),
    "flowsculpt.pipeline.plugin": ("Animation", "Command", "PictureStage", "Plugin", "plugins"),
    "flowsculpt.pipeline.production.picture_sequences": ("PictureSequence", "SequenceQuery"),
    "flowsculpt.pipeline.production.store.remote_store": ("RemoteStore", "RemoteStores"),
    "flowsculpt.pipeline.resample": ("Chord", "Curved", "Exact", "Resampler", "Thresholds", "resample"),
    "flowsculpt.pipeline.shot": ("read_shot",),
    "flowsculpt.pipeline.shot.documents.field_types": ("Document",),
    "flowsculpt.pipeline.shot.documents.subject_kinds": ("CopyLayout", "SubjectKind"),
    "flowsculpt.render.movie.codecs": ("ENCODES", "Encode"),
    "flowsculpt.render.scene.aovs": ("RenderedFrame",),
    "flowsculpt.render.scene.materials": ("LOOKS", "Material"),
    "flowsculpt.render.scene.patterns": ("Pigment",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"flowsculpt.api has no {name!r}: it is not part of the public API")
    return getattr(import_module(_MODULE_OF[name]), name)
