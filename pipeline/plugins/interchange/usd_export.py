"""Export a shot as a USD stage: a root, a manifest of attributes, and a clip for each frame.

renders/<shot>/usd/<shot>.usda            what other programs open
renders/<shot>/usd/<shot>.manifest.usda   the attributes that clips hold
renders/<shot>/usd/<shot>.0001.usdc       the clip of a frame
renders/<shot>/usd/<shot>.sky.exr         what surrounds the scene, where it is not of one colour
renders/<shot>/usd/<shot>.colour.exr      the picture that colours the sculpture, where its look has one
renders/<shot>/usd/<shot>.roughness.exr   those of its roughness, .metallic.exr and .normal.exr
renders/<shot>/usd/<shot>.keys.json       what each file was made from

Of several subjects, manifest, clips and pictures are <shot>.<subject>.manifest.usda and so on, for each.

A stage reads the clip of a frame only while it shows that frame, so a frame that changes rewrites one file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, Vt

from flowsculpt import FrameError, MachineError
from flowsculpt.api.files import to_plain
from flowsculpt.api.frames import Framing, RenderRequest, Store, key_of
from flowsculpt.api.materials import Diffuse, Material, PaintedFaces, Satin
from flowsculpt.api.shots import Shot
from flowsculpt.pipeline.plugins.interchange.exported_frame import (
    EXPORT,
    ExportedFrame,
    KeyedFiles,
    frame_key,
    has_colours,
    has_coordinates,
    has_values,
    stored_frame,
)
from flowsculpt.pipeline.plugins.interchange.exported_materials import number_planes
from flowsculpt.pipeline.plugins.interchange.usd_materials import (
    MATERIALX,
    add_material,
    bind,
    connect_opacity,
)
from flowsculpt.pipeline.plugins.interchange.usd_prims import (
    CameraSettings,
    add_camera,
    add_lights,
    sample,
    write_picture,
)

SCULPTURE = "sculpture"  # name of the prim that clips move

METRE = 1.0  # metres in a scene unit of a shot that does not say what a unit is, as most programs take it

SHARPNESS = 10.0  # sharpness of a crease that stays sharp however finely a surface is subdivided


class SampledAttribute(NamedTuple):
    """An attribute of the sculpture that has a value in every clip.

    name           of the attribute
    kind           its value type, as `Sdf.ValueTypeNames` calls it
    values         returns the array of a frame; None where frames of its kind lack it
    interpolation  of a primvar: vertex or faceVarying
    subset         name of the subset of its faces that has the attribute; empty for its own
    """

    name: str
    kind: str
    values: Callable[[ExportedFrame], np.ndarray | None]
    interpolation: str = ""
    subset: str = ""

    def spec(self, layer: Sdf.Layer, prim: str) -> Sdf.AttributeSpec:
        """Declare it at the prim of the sculpture, without a value: one would hide those of the clips."""
        owner = Sdf.CreatePrimInLayer(layer, f"{prim}/{self.subset}" if self.subset else prim)
        declared = Sdf.AttributeSpec(owner, self.name, getattr(Sdf.ValueTypeNames, self.kind))
        if self.interpolation:
            declared.SetInfo("interpolation", self.interpolation)
        return declared


_SHARED = (
    SampledAttribute("points", "Point3fArray", lambda f: f.points),
    SampledAttribute("velocities", "Vector3fArray", lambda f: f.velocities),
    SampledAttribute("extent", "Float3Array", lambda f: np.stack(f.bounds)),
    SampledAttribute("primvars:rest", "Point3fArray", lambda f: f.rest, "vertex"),
    SampledAttribute("primvars:displayColor", "Color3fArray", lambda f: f.colours, "vertex"),
    SampledAttribute("primvars:copy", "IntArray", lambda f: f.copies, "vertex"),
    SampledAttribute("primvars:values", "FloatArray", lambda f: f.values, "vertex"),
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
    is_cloud: bool,
    has_colours: bool,
    has_texture: bool,
    has_copies: bool = False,
    materials: int = 1,
    has_values: bool = False,
) -> tuple[SampledAttribute, ...]:
    """Return the attributes that every clip of a shot has; texture coordinates are of corners of faces.

    materials  of a model; the faces of each of several are a subset
    """
    left_out = {
        *(() if has_colours else ("primvars:displayColor",)),
        *(() if has_texture else ("primvars:st",)),
        *(() if has_copies else ("primvars:copy",)),
        *(() if has_values else ("primvars:values",)),
    }
    attributes = (*_SHARED, *(_OF_CLOUDS if is_cloud else _OF_MESHES))
    subsets = (_faces_of(number) for number in range(materials) if materials > 1)
    return (*(attribute for attribute in attributes if attribute.name not in left_out), *subsets)


def subset_name(number: int) -> str:
    """Return the name of the prim of a model's faces of one material."""
    return f"material_{number}"


def _faces_of(number: int) -> SampledAttribute:
    """Return the faces of one material of a model, by their numbers."""

    def faces(frame: ExportedFrame) -> np.ndarray:
        assert frame.paint is not None, "a model of several materials is painted"
        return np.flatnonzero(frame.paint.materials == number)

    return SampledAttribute("indices", "IntArray", faces, subset=subset_name(number))


def add_subsets(layer: Sdf.Layer, prim: str, attributes: Iterable[SampledAttribute]) -> None:
    """Define the subsets that attributes belong to; a face belongs to one of them."""
    names = [attribute.subset for attribute in attributes if attribute.subset]
    if names:
        _set_token(layer.GetPrimAtPath(prim), "subsetFamily:materialBind:familyType", "nonOverlapping")
    for name in names:
        spec = Sdf.CreatePrimInLayer(layer, f"{prim}/{name}")
        spec.specifier, spec.typeName = Sdf.SpecifierDef, "GeomSubset"
        _set_token(spec, "elementType", "face")
        _set_token(spec, "familyName", "materialBind")


def _set_token(spec: Sdf.PrimSpec, name: str, value: str) -> None:
    Sdf.AttributeSpec(spec, name, Sdf.ValueTypeNames.Token, Sdf.VariabilityUniform).default = value


def write_clip(
    path: Path, prim: str, number: int, frame: ExportedFrame, attributes: tuple[SampledAttribute, ...]
) -> None:
    """Write the clip of one frame: a time sample of each attribute of the sculpture's prim, and nothing else.

    Raises MachineError where the disk refuses.
    """
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    with Sdf.ChangeBlock():
        for attribute in attributes:
            values = attribute.values(frame)
            assert values is not None, f"all frames of a shot have {attribute.name}"
            sampled = attribute._replace(interpolation="").spec(layer, prim)
            layer.SetTimeSample(sampled.path, float(number), usd_array(attribute.kind, values))
    write_layer(path, layer)


def write_manifest(path: Path, prim: str, attributes: tuple[SampledAttribute, ...]) -> None:
    """Write the layer that declares the attributes of the clips. Raises MachineError."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    for attribute in attributes:
        attribute.spec(layer, prim)
    write_layer(path, layer)


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
    try:
        is_written = layer.Export(str(path))
    except Tf.ErrorException as error:
        raise MachineError.of_draft(path, path, "USD reports an error") from error
    if not is_written:
        raise MachineError.of_draft(path, path, "USD reports an error")


def usd_array(kind: str, values: np.ndarray) -> Any:
    """Return values as an array of USD's of a value type."""
    components = {"Point3f": "Vec3f", "Vector3f": "Vec3f", "Normal3f": "Vec3f", "Color3f": "Vec3f"}
    components |= {"Float3": "Vec3f", "TexCoord2f": "Vec2f"}
    name = kind.removesuffix("Array")
    types = {"Int": np.int32, "Int64": np.int64}
    held = np.ascontiguousarray(values, dtype=types.get(name, np.float32))
    return getattr(Vt, f"{components.get(name, name)}Array").FromNumpy(held)


@dataclass(frozen=True, eq=False)
class SculptureFiles:
    """One sculpture of a stage: clips of frames, a manifest, and the picture that colours it.

    A shot of several subjects has one for each, with a request of its own; its files have its name.
    """

    request: RenderRequest
    store: Store
    files: KeyedFiles

    @property
    def look(self) -> Material:
        return self.request.shot.picture.look

    @cached_property
    def prim(self) -> str:
        """The path of its prim; those of several subjects stand below one prim, by name."""
        home, subject = f"{root_prim(self.request.shot)}/{SCULPTURE}", self.request.shot.subject
        return f"{home}/{subject}" if subject else home

    @property
    def material(self) -> str:
        """The name of its material in the stage: `sculpture`, or `sculpture_<name>` of one of several."""
        return "_".join(self.prim.split("/")[2:])

    @cached_property
    def is_cloud(self) -> bool:
        subject = self.request.shot.motion.subject
        return not subject.is_surface and subject.lattice is None

    @property
    def schema(self) -> Any:
        """The schema of its prim."""
        return UsdGeom.Points if self.is_cloud else UsdGeom.Mesh

    @cached_property
    def attributes(self) -> tuple[SampledAttribute, ...]:
        """The attributes of its clips."""
        has_texture, copies = has_coordinates(self.request.shot), self.request.shot.motion.copies
        return sampled_attributes(
            self.is_cloud,
            has_colours(self.look),
            has_texture,
            copies is not None,
            len(self.parts),
            has_values(self.request.shot),
        )

    def clip(self, number: int) -> str:
        """Return the name of the clip of a frame."""
        return f"{self._name}.{number:04d}.usdc"

    @property
    def manifest(self) -> str:
        """The name of the layer that declares the attributes of the clips."""
        return f"{self._name}.manifest.usda"

    @property
    def parts(self) -> tuple[Material, ...]:
        """The materials: of a model, by their numbers."""
        return self.look.parts_by_number

    def pictures(self, number: int) -> dict[str, str]:
        """Return the names of the pictures of a material by the inputs of its preview surface."""
        between = f".{number}" if len(self.parts) > 1 else ""
        words = {name: "colour" if name == "diffuseColor" else name for name in self._pixels(number)}
        return {name: f"{self._name}{between}.{word}.exr" for name, word in words.items()}

    def _pixels(self, number: int) -> dict[str, Callable[[], np.ndarray]]:
        """Return what reads the pictures (H, W, 3) of a material, by the inputs of its preview surface."""
        part = self.parts[number]
        texture, bumps = part.texture("colour"), part.texture("normal")
        found = {} if texture is None else {"diffuseColor": texture.pixels}
        for name, plane in number_planes(part).items():
            found[name] = partial(np.repeat, plane, 3, axis=2)
        if bumps is not None:
            found["normal"] = lambda: 0.5 + 0.5 * bumps.normals()
        opacity = part.opacity
        if opacity is not None and opacity.texture is not None:
            whole = replace(opacity, cutoff=None)
            found["opacity"] = lambda: np.repeat(whole.fractions(), 3, axis=2)
        return found

    @property
    def recipe(self) -> list[str]:
        """The part of a stage's key that depends on materials besides the look."""
        several = ["subsets"] if len(self.parts) > 1 else []
        names = dict.fromkeys(name for number in range(len(self.parts)) for name in self.pictures(number))
        return several + [name for name in names if name != "diffuseColor"]

    def add_materials(self, stage: Usd.Stage, place: str, sizes: Mapping[int, float]) -> UsdShade.Material:
        """Add the materials of a model and bind their faces; return that of the sculpture.

        sizes  half the subject's size by frame number, scene units
        """
        if len(self.parts) == 1:
            return add_material(stage, place, self.look, self.pictures(0), has_colours(self.look), sizes)
        for number, part in enumerate(self.parts):
            is_dyed = getattr(part, "colour_from", None) == PaintedFaces.COLOURS
            own = add_material(stage, f"{place}_{number}", part, self.pictures(number), is_dyed)
            bind(stage.OverridePrim(f"{self.prim}/{subset_name(number)}"), own)
        return add_material(stage, place, self.look, is_coloured=True, sizes=sizes)

    def stale(self, numbers: Iterable[int]) -> list[int]:
        """Return the frames whose clips are missing, damaged, or of an earlier shot."""
        return [n for n in numbers if not self.files.is_current(self.clip(n), self._key(n))]

    def shown(self) -> set[int]:
        """Return the frames whose clips are current."""
        whole = {n for n in self.request.angles if self.files.is_whole(self.clip(n))}
        return whole.difference(self.stale(whole))

    def write_clip(self, number: int) -> None:
        """Write the clip of a frame. Raises FrameError where its mesh is missing or the flow fails."""
        frame = stored_frame(self.request, self.store, number)
        self.files.write(
            self.clip(number),
            self._key(number),
            lambda draft: write_clip(draft, self.prim, number, frame, self.attributes),
        )

    def write_others(self) -> None:
        """Write the manifest and the picture that colours the sculpture, each if it has changed."""
        names = [attribute.subset + attribute.name for attribute in self.attributes]
        key = key_of(EXPORT.recipe, self.prim, names)
        self.files.update(self.manifest, key, lambda draft: write_manifest(draft, self.prim, self.attributes))
        self.write_pictures()

    def write_pictures(self) -> None:
        """Write the pictures of the materials that have changed."""
        for number, part in enumerate(self.parts):
            names = self.pictures(number)
            for name, pixels in self._pixels(number).items():
                recipe = (
                    [to_plain(part.texture("colour"))] if name == "diffuseColor" else [name, to_plain(part)]
                )
                key = key_of(EXPORT.recipe, *recipe)
                self.files.update(names[name], key, partial(_write_pixels, read=pixels))

    def refer(self, prim: Sdf.PrimSpec, numbers: tuple[int, ...]) -> None:
        """Name the clips at the prim of the stage, and say which is shown when."""
        clips = {
            "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(f"./{self.clip(number)}") for number in numbers]),
            "primPath": self.prim,
            "manifestAssetPath": Sdf.AssetPath(f"./{self.manifest}"),
            "active": Vt.Vec2dArray([Gf.Vec2d(number, index) for index, number in enumerate(numbers)]),
            "times": Vt.Vec2dArray([Gf.Vec2d(*pair) for pair in clip_times(numbers)]),
        }
        prim.SetInfo("clips", {"default": clips})

    def _key(self, number: int) -> str:
        if number not in self._keys:
            key = frame_key(self.request, number)
            self._keys[number] = key_of(key, "subsets") if len(self.parts) > 1 else key
        return self._keys[number]

    @cached_property
    def _keys(self) -> dict[int, str]:
        return {}

    @property
    def _name(self) -> str:
        return self.request.motion_folders.part_name


def _write_pixels(path: Path, read: Callable[[], np.ndarray]) -> None:
    write_picture(path, read())


def root_prim(shot: Shot) -> str:
    """Return the path of the prim that holds all others of a shot."""
    return f"/{Tf.MakeValidIdentifier(shot.name)}"


def write_root(
    path: Path,
    request: RenderRequest,
    sculptures: Sequence[SculptureFiles],
    framings: Mapping[int, Framing],
    sky: str,
) -> None:
    """Write the root stage, as text. Raises MachineError where the disk refuses.

    sculptures  one, or one for each of several subjects
    framings    camera and place of the set, by the number of each exported frame, in ascending order
    sky         name of the map of what surrounds the scene
    """
    shot, camera = request.shot, request.shot.picture.camera
    home, numbers, rate = root_prim(shot), tuple(framings), float(shot.rate.fps)
    unit = METRE if camera.unit is None else camera.unit / 1000.0
    stage = Usd.Stage.CreateInMemory(".usda")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, unit)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    stage.SetStartTimeCode(float(numbers[0]))
    stage.SetEndTimeCode(float(numbers[-1]))
    stage.GetRootLayer().documentation = shot.heading
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, home).GetPrim())
    UsdGeom.Scope.Define(stage, f"{home}/materials")
    if sculptures[0].request.shot.subject:
        UsdGeom.Xform.Define(stage, f"{home}/{SCULPTURE}")
    sizes = {number: framing.placement.size for number, framing in framings.items()}
    for sculpture in sculptures:
        place = f"{home}/materials/{sculpture.material}"
        _add_sculpture(stage, sculpture, sculpture.add_materials(stage, place, sizes))
    if shot.picture.look.is_lit:
        _add_set(stage, home, shot, framings, sky)
    if not camera.projection.is_wide:  # UsdGeomCamera has no such projection
        cameras = {number: framing.camera for number, framing in framings.items()}
        shutters = {number: request.pictures.open_at(number) for number in numbers}
        aspect, exposure = request.pictures.aspect, shot.picture.lights.exposure
        lens = CameraSettings(aspect, camera.sensor_width, unit, exposure)
        add_camera(stage, f"{home}/camera", cameras, shutters, lens)
    layer = Sdf.Layer.CreateAnonymous(".usda")  # without a stage, which would look for the clips
    layer.TransferContent(stage.GetRootLayer())
    for sculpture in sculptures:
        for attribute in sculpture.attributes:
            attribute.spec(layer, sculpture.prim)
        add_subsets(layer, sculpture.prim, sculpture.attributes)
        sculpture.refer(layer.GetPrimAtPath(sculpture.prim), numbers)
    write_layer(path, layer)


def _add_sculpture(stage: Usd.Stage, content: SculptureFiles, material: UsdShade.Material) -> None:
    sculpture = content.schema.Define(stage, content.prim)
    if content.schema is UsdGeom.Mesh:
        sculpture.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        sculpture.CreateDoubleSidedAttr(True)
    if not has_colours(content.look):
        named = "displayColor", Sdf.ValueTypeNames.Color3fArray
        UsdGeom.PrimvarsAPI(sculpture).CreatePrimvar(*named).Set(Vt.Vec3fArray([content.look.colour]))
    bind(sculpture.GetPrim(), material)


def _add_set(stage: Usd.Stage, home: str, shot: Shot, framings: Mapping[int, Framing], sky: str) -> None:
    """Add floor and lights. The set has a size of its own and follows the sculpture, as in our pictures."""
    placed = UsdGeom.Xform.Define(stage, f"{home}/set").AddTransformOp()
    matrices = {n: Gf.Matrix4d(f.placement.matrix().T.tolist()) for n, f in framings.items()}
    sample(placed.GetAttr(), matrices)
    UsdGeom.Scope.Define(stage, f"{home}/set/lights")
    sizes = {number: framing.placement.size for number, framing in framings.items()}
    picture = shot.picture
    add_lights(stage, home, f"{home}/set/lights", picture.lights, sizes, sky)
    if picture.stage.kind != "none" and not picture.stage.shadow_catcher:
        add_floor(stage, home, shot)


def add_floor(stage: Usd.Stage, home: str, shot: Shot) -> None:
    """Add floor, wall and plinth of a shot, without reference objects."""
    floor = shot.picture.stage
    vertices, normals, faces = floor.mesh()
    mesh = UsdGeom.Mesh.Define(stage, f"{home}/set/floor")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(vertices))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(faces.reshape(-1))))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
    if is_coloured := floor.plinth() is not None or floor.is_graded:
        colours = np.tile(np.array(floor.plinth_colour, np.float32), (len(vertices), 1))
        backdrop = floor.reflectances()
        colours[: len(backdrop)] = backdrop
        mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set(Vt.Vec3fArray.FromNumpy(colours))
    else:
        mesh.CreateDisplayColorAttr(Vt.Vec3fArray([floor.colour]))
    material: Material = Diffuse(floor.colour)
    if floor.roughness is not None:
        material = Satin(floor.colour, roughness=floor.roughness, coat=1.0)
    look = add_material(stage, f"{home}/materials/floor", material, is_coloured=is_coloured)
    if floor.horizon_fade:
        mesh.CreateDisplayOpacityPrimvar(UsdGeom.Tokens.vertex).Set(
            Vt.FloatArray.FromNumpy(floor.opacity_at(vertices))
        )
        connect_opacity(stage, f"{home}/materials/floor")
    bind(mesh.GetPrim(), look)


@dataclass(frozen=True, eq=False)
class UsdExport:
    """A shot's frames as a USD stage. Clips that are current are kept."""

    request: RenderRequest
    store: Store
    folder: Path

    form: ClassVar[str] = ""

    @cached_property
    def files(self) -> KeyedFiles:
        """The files of the folder."""
        return KeyedFiles(self.folder, f"{self.request.name}{self.form}.keys.json", self.store)

    @property
    def path(self) -> Path:
        """The path of the stage that other programs open."""
        return self.folder / f"{self.request.name}{self.form}.usda"

    @cached_property
    def _sculptures(self) -> tuple[SculptureFiles, ...]:
        return tuple(SculptureFiles(part, self.store, self.files) for part in self.request.parts)

    def stale(self) -> list[int]:
        """Return the frames of the request with a clip that is missing, damaged, or of an earlier shot."""
        numbers = sorted(self.request.requested)
        return sorted({n for sculpture in self._sculptures for n in sculpture.stale(numbers)})

    def write(self, passed: Callable[[], None]) -> list[str]:
        """Write the clips that are not current, and what refers to them; return messages of failed frames.

        The stage shows all frames whose clips are current, those of earlier exports too. Raises MachineError
        where the disk refuses, FrameError where there are no cameras or no frame could be exported.
        """
        faults: list[str] = []
        framings = self.framings()
        with self.files.changing():
            for number in self.stale():
                try:
                    for sculpture in self._sculptures:
                        if sculpture.stale([number]):
                            sculpture.write_clip(number)
                except FrameError as error:
                    faults.append(f"{self.request.name} {error.of(number)}")
                passed()
            if not self.shown():
                raise FrameError("\n".join(faults))
            self.write_stage(framings)
        return faults

    def shown(self) -> list[int]:
        """Return the frames whose clips are current, in ascending order."""
        return sorted(set.intersection(*(sculpture.shown() for sculpture in self._sculptures)))

    def framings(self) -> Mapping[int, Framing]:
        """Return camera and set of every frame. Raises FrameError where they were not found."""
        framings = self.request.pictures.framings(self.store)
        if framings is None:
            raise FrameError(
                f"{self.request.name} has no cameras, which depend on all its frames, so no stage was "
                "written; fix the frames that fail, or export the existing ones as ply or obj"
            )
        return framings

    def write_stage(self, framings: Mapping[int, Framing]) -> None:
        """Write the manifests, the map of the sky and the root, each if it has changed."""
        for sculpture in self._sculptures:
            sculpture.write_others()
        request, shown, sky = self.request, self.shown(), f"{self.request.name}.sky.exr"
        lights = request.shot.picture.lights
        pixels = lights.sky_pixels() if request.shot.picture.look.is_lit else None
        if pixels is not None:
            key = key_of(EXPORT.recipe, to_plain(lights))
            self.files.update(sky, key, lambda draft: write_picture(draft, pixels))
        of_shown = {number: framings[number] for number in shown}
        self.files.update(
            self.path.name,
            self._root_key(of_shown),
            lambda draft: write_root(draft, request, self._sculptures, of_shown, sky),
        )

    def _root_key(self, framings: Mapping[int, Framing]) -> str:
        shot, picture = self.request.shot, self.request.shot.picture
        several = [[each.prim, to_plain(each.look)] for each in self._sculptures]
        return key_of(
            EXPORT.recipe,
            MATERIALX,
            shot.heading,
            str(shot.rate),
            [to_plain(part) for part in (picture.look, picture.lights, picture.stage)],
            (picture.camera.sensor_width, picture.camera.unit, self.request.pictures.aspect),
            {str(number): to_plain(framing) for number, framing in framings.items()},
            {str(number): self.request.pictures.open_at(number) for number in framings},
            *([several] if shot.subjects else []),
            *(name for each in self._sculptures for name in each.recipe),
        )
