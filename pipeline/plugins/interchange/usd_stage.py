"""The root stage of a shot: the sculpture with its clips, camera, lights, floor and materials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.plugins.interchange.usd_camera import CameraSettings, add_camera, sample
from pipeline.plugins.interchange.usd_clips import (
    SCULPTURE,
    SampledAttribute,
    clip_times,
    declare,
    write_layer,
)
from pipeline.plugins.interchange.usd_lights import add_lights
from pipeline.plugins.interchange.usd_materials import add_material, bind
from pipeline.production.request.framing import Framing
from pipeline.shot import Shot
from render.base.serialise import Colour
from render.scene.materials import Diffuse, Material, Satin
from render.scene.scene_stage import Stage

if TYPE_CHECKING:
    from pxr import Usd, UsdShade

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
