"""USD clips: a layer of time samples for each frame, and the manifest that declares what they hold.

A stage reads the clip of a frame only while it shows that frame, so a frame that changes rewrites one file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.plugins.interchange.exported_frame import ExportedFrame
from render.base.atomic_write import cannot_write

if TYPE_CHECKING:  # USD is an optional package, and takes a moment to import
    from pxr import Sdf

SCULPTURE = "sculpture"
"""Name of the prim that clips move."""

SHARPNESS = 10.0
"""Sharpness of a crease that stays sharp however finely a surface is subdivided."""


class SampledAttribute(NamedTuple):
    """An attribute of the sculpture that has a value in every clip.

    name           of the attribute
    kind           its value type, as `Sdf.ValueTypeNames` calls it
    values         returns the array of a frame; None where frames of its kind lack it
    interpolation  of a primvar: vertex or faceVarying
    """

    name: str
    kind: str
    values: Callable[[ExportedFrame], AnyArray | None]
    interpolation: str = ""


_SHARED = (
    SampledAttribute("points", "Point3fArray", lambda f: f.points),
    SampledAttribute("velocities", "Vector3fArray", lambda f: f.velocities),
    SampledAttribute("extent", "Float3Array", lambda f: np.stack(f.bounds)),
    SampledAttribute("primvars:rest", "Point3fArray", lambda f: f.rest, "vertex"),
    SampledAttribute("primvars:displayColor", "Color3fArray", lambda f: f.colours, "vertex"),
    SampledAttribute("primvars:copy", "IntArray", lambda f: f.copies, "vertex"),
)

_OF_MESHES = (
    SampledAttribute("faceVertexCounts", "IntArray", lambda f: np.full(len(f.faces), 3, np.int32)),
    SampledAttribute("faceVertexIndices", "IntArray", lambda f: f.faces.reshape(-1)),
    SampledAttribute("primvars:normals", "Normal3fArray", lambda f: f.normals, "faceVarying"),
    SampledAttribute("primvars:normals:indices", "IntArray", lambda f: f.corner_normals.reshape(-1)),
    SampledAttribute(
        "primvars:st",
        "TexCoord2fArray",
        lambda f: None if f.texture is None else f.texture.reshape(-1, 2),
        "faceVarying",
    ),
    SampledAttribute("creaseIndices", "IntArray", lambda f: f.creases.reshape(-1)),
    SampledAttribute("creaseLengths", "IntArray", lambda f: np.full(len(f.creases), 2, np.int32)),
    SampledAttribute("creaseSharpnesses", "FloatArray", lambda f: np.full(len(f.creases), SHARPNESS)),
)

_OF_CLOUDS = (
    SampledAttribute("widths", "FloatArray", lambda f: None if f.radii is None else 2.0 * f.radii),
    SampledAttribute("ids", "Int64Array", lambda f: f.numbers),
)


def sampled_attributes(
    is_cloud: bool, has_colours: bool, has_texture: bool, has_copies: bool = False
) -> tuple[SampledAttribute, ...]:
    """Return the attributes that every clip of a shot has.

    has_colours, has_texture  whether vertices have colours, and corners of faces texture coordinates
    has_copies                whether vertices have the number of their copy
    """
    left_out = {
        *(() if has_colours else ("primvars:displayColor",)),
        *(() if has_texture else ("primvars:st",)),
        *(() if has_copies else ("primvars:copy",)),
    }
    attributes = (*_SHARED, *(_OF_CLOUDS if is_cloud else _OF_MESHES))
    return tuple(attribute for attribute in attributes if attribute.name not in left_out)


def write_clip(
    path: Path, prim: str, number: int, frame: ExportedFrame, attributes: tuple[SampledAttribute, ...]
) -> None:
    """Write the clip of one frame: a time sample of each attribute at the frame's number, and nothing else.

    prim  path of the sculpture in the stage

    Raises MachineError where the disk refuses.
    """
    from pxr import Sdf

    layer = Sdf.Layer.CreateAnonymous(".usdc")
    with Sdf.ChangeBlock():
        spec = Sdf.CreatePrimInLayer(layer, prim)
        for attribute in attributes:
            values = attribute.values(frame)
            assert values is not None, f"all frames of a shot have {attribute.name}"
            sampled = Sdf.AttributeSpec(spec, attribute.name, getattr(Sdf.ValueTypeNames, attribute.kind))
            layer.SetTimeSample(sampled.path, float(number), _array(attribute.kind, values))
    write_layer(path, layer)


def write_manifest(path: Path, prim: str, attributes: tuple[SampledAttribute, ...]) -> None:
    """Write the layer that declares the attributes of the clips. Raises MachineError."""
    from pxr import Sdf

    layer = Sdf.Layer.CreateAnonymous(".usda")
    declare(Sdf.CreatePrimInLayer(layer, prim), attributes)
    write_layer(path, layer)


def declare(spec: Sdf.PrimSpec, attributes: tuple[SampledAttribute, ...]) -> None:
    """Declare attributes at a prim, without values: a value would hide those of the clips."""
    from pxr import Sdf

    for attribute in attributes:
        declared = Sdf.AttributeSpec(spec, attribute.name, getattr(Sdf.ValueTypeNames, attribute.kind))
        if attribute.interpolation:
            declared.SetInfo("interpolation", attribute.interpolation)


def clip_times(numbers: tuple[int, ...]) -> Iterator[tuple[float, float]]:
    """Yield pairs of stage time and clip time: each frame is held until the next one begins.

    Without the jumps between them, readers would blend two neighbouring frames of as many vertices, though
    these are not the same vertices.
    """
    for number, following in zip(numbers, (*numbers[1:], numbers[-1] + 1), strict=True):
        yield float(number), float(number)
        yield float(following), float(number)


def write_layer(path: Path, layer: Sdf.Layer) -> None:
    """Write a layer, as text or binary by the suffix. Raises MachineError where the disk refuses."""
    from pxr import Tf

    try:
        is_written = layer.Export(str(path))
    except Tf.ErrorException as error:
        raise cannot_write(path, path, "USD reports an error") from error
    if not is_written:
        raise cannot_write(path, path, "USD reports an error")


def _array(kind: str, values: AnyArray) -> Any:
    """Return values as an array of USD's of a value type."""
    from pxr import Vt

    components = {"Point3f": "Vec3f", "Vector3f": "Vec3f", "Normal3f": "Vec3f", "Color3f": "Vec3f"}
    components |= {"Float3": "Vec3f", "TexCoord2f": "Vec2f"}
    name = kind.removesuffix("Array")
    types = {"Int": np.int32, "Int64": np.int64}
    held = np.ascontiguousarray(values, dtype=types.get(name, np.float32))
    return getattr(Vt, f"{components.get(name, name)}Array").FromNumpy(held)
