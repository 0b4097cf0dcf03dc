"""The root stage of a shot, and its clips: a layer of time samples for each frame, and their manifest.

A stage reads the clip of a frame only while it shows that frame, so a frame that changes rewrites one file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.plugins.interchange.exported_frame import ExportedFrame
from pipeline.plugins.interchange.usd_prims import (
    CameraSettings,
    add_camera,
    add_lights,
    add_material,
    bind,
    sample,
)
from pipeline.production.request.framing import Framing
from pipeline.shot import Shot
from render.base.atomic_write import cannot_write
from render.base.serialise import Colour
from render.scene.materials import Diffuse, Material, Satin
from render.scene.scene_stage import Stage

if TYPE_CHECKING:
    from pxr import Sdf, Usd, UsdShade


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


METRE = 1.0
"""Metres in a scene unit of a shot that does not say what a unit is, as most programs take it."""


@dataclass(frozen=True, eq=False)
class StageSculpture:
    """One subject of a root stage.

    prim        path of its prim in the stage
    look        its material
    clips       names of the clips, by frame number
    manifest    name of the layer that declares the clips' attributes
    texture     name of the picture that colours it
    is_cloud    whether it is a point cloud
    attributes  the attributes of the clips
    """

    prim: str
    look: Material
    clips: Mapping[int, str]
    manifest: str
    texture: str
    is_cloud: bool
    attributes: tuple[SampledAttribute, ...]

    @property
    def material(self) -> str:
        """The name of its material in the stage: `sculpture`, or `sculpture_<name>` of one of several."""
        return "_".join(self.prim.split("/")[2:])


@dataclass(frozen=True, eq=False)
class StageContent:
    """Content of a root stage.

    sculptures  one, or one for each of several subjects
    framings    camera and place of the set, by the number of each exported frame, in ascending order
    shutters    opening and closing by frame number, in frames from the frame; None without motion blur
    sky         name of the map of what surrounds the scene
    aspect      width to height of the picture
    """

    shot: Shot
    sculptures: tuple[StageSculpture, ...]
    framings: Mapping[int, Framing]
    shutters: Mapping[int, tuple[float, float] | None]
    sky: str
    aspect: float


def root_prim(shot: Shot) -> str:
    """Return the path of the prim that holds all others of a shot."""
    from pxr import Tf

    return f"/{Tf.MakeValidIdentifier(shot.name)}"


def sculpture_prim(shot: Shot) -> str:
    """Return the path of the prim of a shot's subject; those of several stand below one prim, by name."""
    home = f"{root_prim(shot)}/{SCULPTURE}"
    return f"{home}/{shot.subject}" if shot.subject else home


def unit_of(shot: Shot) -> float:
    """Return the metres in a scene unit."""
    unit = shot.picture.camera.unit
    return METRE if unit is None else unit / 1000.0


def write_root(path: Path, content: StageContent) -> None:
    """Write the root stage, as text. Raises MachineError where the disk refuses."""
    from pxr import Sdf, Usd, UsdGeom

    shot, home = content.shot, root_prim(content.shot)
    numbers, rate = tuple(content.framings), float(shot.rate.fps)
    stage = Usd.Stage.CreateInMemory(".usda")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, unit_of(shot))
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    stage.SetStartTimeCode(float(numbers[0]))
    stage.SetEndTimeCode(float(numbers[-1]))
    stage.GetRootLayer().documentation = shot.heading
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, home).GetPrim())
    UsdGeom.Scope.Define(stage, f"{home}/materials")
    if len(content.sculptures) > 1 or content.sculptures[0].prim != f"{home}/{SCULPTURE}":
        UsdGeom.Xform.Define(stage, f"{home}/{SCULPTURE}")
    for sculpture in content.sculptures:
        place = f"{home}/materials/{sculpture.material}"
        _add_sculpture(stage, sculpture, add_material(stage, place, sculpture.look, sculpture.texture))
    if shot.picture.look.is_lit:
        _add_set(stage, home, content)
    cameras = {number: framing.camera for number, framing in content.framings.items()}
    lens = CameraSettings(
        content.aspect, shot.picture.camera.sensor_width, unit_of(shot), shot.picture.lights.exposure
    )
    if not shot.picture.camera.projection.is_wide:  # UsdGeomCamera has no such projection
        add_camera(stage, f"{home}/camera", cameras, content.shutters, lens)
    layer = Sdf.Layer.CreateAnonymous(".usda")  # without a stage, which would look for the clips
    layer.TransferContent(stage.GetRootLayer())
    for sculpture in content.sculptures:
        layer.GetPrimAtPath(sculpture.prim).SetInfo("clips", {"default": _clips(sculpture)})
    write_layer(path, layer)


def _add_sculpture(stage: Usd.Stage, content: StageSculpture, material: UsdShade.Material) -> None:
    from pxr import UsdGeom, Vt

    schema: Any = UsdGeom.Points if content.is_cloud else UsdGeom.Mesh
    sculpture = schema.Define(stage, content.prim)
    declare(stage.GetRootLayer().GetPrimAtPath(content.prim), content.attributes)
    if not content.is_cloud:
        sculpture.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        sculpture.CreateDoubleSidedAttr(True)
    if not any(attribute.name == "primvars:displayColor" for attribute in content.attributes):
        sculpture.CreateDisplayColorAttr(Vt.Vec3fArray([content.look.colour]))
    bind(sculpture.GetPrim(), material)


def _clips(content: StageSculpture) -> dict[str, Any]:
    """Return the metadata that names the clips and says which is shown when."""
    from pxr import Gf, Sdf, Vt

    numbers = tuple(content.clips)
    return {
        "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(f"./{name}") for name in content.clips.values()]),
        "primPath": content.prim,
        "manifestAssetPath": Sdf.AssetPath(f"./{content.manifest}"),
        "active": Vt.Vec2dArray([Gf.Vec2d(number, index) for index, number in enumerate(numbers)]),
        "times": Vt.Vec2dArray([Gf.Vec2d(*pair) for pair in clip_times(numbers)]),
    }


def _add_set(stage: Usd.Stage, home: str, content: StageContent) -> None:
    """Add floor and lights. The set has a size of its own and follows the sculpture, as in our pictures."""
    from pxr import Gf, UsdGeom

    picture = content.shot.picture
    placed = UsdGeom.Xform.Define(stage, f"{home}/set").AddTransformOp()
    matrices = {n: Gf.Matrix4d(f.placement.matrix().T.tolist()) for n, f in content.framings.items()}
    sample(placed.GetAttr(), matrices)
    UsdGeom.Scope.Define(stage, f"{home}/set/lights")
    sizes = {number: framing.placement.size for number, framing in content.framings.items()}
    add_lights(stage, home, f"{home}/set/lights", picture.lights, sizes, content.sky)
    if picture.stage.kind != "none" and not picture.stage.shadow_catcher:
        _add_floor(stage, home, picture.stage)


def _add_floor(stage: Usd.Stage, home: str, floor: Stage) -> None:
    """Add floor, wall and plinth, without reference objects."""
    from pxr import UsdGeom, Vt

    vertices, normals, faces = floor.mesh()
    mesh = UsdGeom.Mesh.Define(stage, f"{home}/set/floor")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(vertices))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(faces.reshape(-1))))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
    mesh.CreateDisplayColorAttr(Vt.Vec3fArray([floor.colour]))
    bind(mesh.GetPrim(), add_material(stage, f"{home}/materials/floor", floor_material(floor)))


def floor_material(floor: Stage) -> Diffuse | Satin:
    """Return the material of a floor: matt, or under a clear coat."""
    colour: Colour = floor.colour
    if floor.roughness is None:
        return Diffuse(colour)
    return Satin(colour, roughness=floor.roughness, coat=1.0)
