"""Texture coordinates, vertex colours and materials of USD stages, in the process that reads them.

Materials are preview surfaces (UsdPreviewSurface 2.6), with textures and primvars.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from pxr import Ar, Usd, UsdGeom, UsdShade

from flowsculpt import MeshError
from flowsculpt.api import shorten
from flowsculpt.api.materials import Texture
from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.interchange.model_paint import PaintParts
from flowsculpt.pipeline.plugins.interchange.painted_materials import GREY
from flowsculpt.pipeline.plugins.interchange.scene_readers import Polygons, packed_arrays
from flowsculpt.pipeline.plugins.interchange.usd_reader import (
    StageMeshes,
    content_of_picture,
    numbers_at,
    polygons_of,
    start_of,
    time_of,
)

_DISPLAY_COLOR = "displayColor"

_COORDINATES = ("st", "UVMap", "uv")
"""Texture coordinates of faces whose material has no textures: the first of these that there are."""

_CHANNELS = {"rgb": None, "r": 0, "g": 1, "b": 2, "a": Texture.ALPHA}

_OPACITY = (("opacity", 1.0), ("opacityThreshold", 0.0))
"""Inputs of opacity, and what they are where nothing is said."""

_WRAPS = ("black", "clamp", "repeat", "mirror")
"""Ways to show what is beyond the sides of a picture; others leave it to the picture's file."""

_SPACES = {"sRGB": "srgb", "raw": "linear"}

_NOT_SHOWN = ("emissiveColor", "clearcoat", "displacement")

_BEYOND = 1e-4  # of a texture: what coordinates may reach beyond its sides without showing it

_DARKEST_MIRROR = 0.1
"""Specular colours up to this are taken for that of a dielectric; brighter ones may be metals."""


class _Coordinates(NamedTuple):
    """A primvar of texture coordinates, and how they are transformed: scale, rotation, translation."""

    primvar: str
    scale: tuple[float, float] = (1.0, 1.0)
    rotation: float = 0.0
    translation: tuple[float, float] = (0.0, 0.0)

    def transformed(self, values: Floats) -> Floats:
        """Return values (C, 2) as textures are looked up (UsdTransform2d)."""
        sine, cosine = math.sin(math.radians(self.rotation)), math.cos(math.radians(self.rotation))
        turn = np.array([[cosine, sine], [-sine, cosine]])
        return np.asarray(values * self.scale @ turn + self.translation)


@dataclass
class _Surface:
    """A material.

    facts        what `usd_files` makes the material of
    coordinates  those of its textures, or None without textures
    dye          name of the primvar that colours it, or None
    """

    facts: dict[str, Any]
    coordinates: _Coordinates | None = None
    dye: str | None = None


class _Mesh(NamedTuple):
    """A mesh with what is on its faces, by the numbers of F faces and C corners in the file.

    polygons     with numbers of corners in place of points
    corners      (C,): the points at corners
    faces        (C,): the faces of corners
    materials    (F,)
    coordinates  (C, 2)
    colours      (C, 3), or None where no material is coloured by a primvar
    """

    polygons: Polygons
    corners: np.ndarray
    faces: np.ndarray
    materials: np.ndarray
    coordinates: Floats
    colours: Floats | None


@dataclass
class PaintedStage(StageMeshes):
    """Collects the meshes below prims with what is on their faces.

    surfaces  by the path of the material, in the order of their numbers; "" is of faces without one
    """

    surfaces: dict[str, _Surface] = field(default_factory=dict)
    _painted: list[_Mesh] = field(default_factory=list)
    _known: dict[tuple[str, str], _Mesh] = field(default_factory=dict)

    def _add_prim(self, prim: Usd.Prim, to_stage: Floats, depth: int) -> None:
        if not prim.IsA(UsdGeom.Mesh):
            super()._add_prim(prim, to_stage, depth)
            return
        source = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        bound = _bound(prim)
        key = str(source.GetPath()), _path_of(bound)
        if key not in self._known:
            self._known[key] = self._mesh(prim, bound)
        self.placed.add(self._known[key].polygons, to_stage)
        self._painted.append(self._known[key])

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arguments of `ModelPaint.of`."""
        found = PaintParts()
        for polygons, mesh in zip(self.placed.parts, self._painted, strict=True):
            order, sides = polygons.corners, polygons.sides  # a mirror turns faces over
            materials = mesh.materials[mesh.faces[order][np.cumsum(sides) - sides]]
            colours = None if mesh.colours is None else mesh.colours[order]
            corners, coordinates = mesh.corners[order], mesh.coordinates[order]
            found.add(polygons.points, sides, corners, coordinates, materials, colours)
        return found.arrays(lambda: np.array([each.facts["colour"] for each in self.surfaces.values()]))

    def _mesh(self, prim: Usd.Prim, bound: UsdShade.Material) -> _Mesh:
        mesh, place = UsdGeom.Mesh(prim), shorten(prim.GetPath())
        polygons = polygons_of(mesh, self.time, place, are_numbered=True)
        polygons = polygons.without(polygons.sides < 3)
        sides = numbers_at(mesh.GetFaceVertexCountsAttr(), self.time, place, "iu").astype(np.int64)
        corners = numbers_at(mesh.GetFaceVertexIndicesAttr(), self.time, place, "iu").astype(np.int64)
        faces = np.repeat(np.arange(len(sides)), sides)
        bindings, which = [bound], np.zeros(len(sides), np.int64)
        for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
            own = numbers_at(subset.GetIndicesAttr(), self.time, place, "iu").astype(np.int64)
            if len(own) and not 0 <= own.min() <= own.max() < len(sides):
                raise MeshError(f"{shorten(subset.GetPath())} names a face that {place} does not have")
            which[own] = len(bindings)
            bindings.append(_bound(subset.GetPrim()))
        used = np.unique(which).tolist()
        materials = np.array([self._number(bindings[number]) for number in used])[
            np.searchsorted(used, which)
        ]
        coordinates, colours = np.zeros((len(corners), 2)), None
        surfaces = list(self.surfaces.values())
        for number in np.unique(materials).tolist():
            at = np.flatnonzero(materials[faces] == number)
            index = {"vertex": corners[at], "varying": corners[at], "uniform": faces[at], "faceVarying": at}
            index["constant"] = np.zeros(len(at), np.int64)
            coordinates[at] = self._coordinates(prim, surfaces[number], index)
            beyond = np.abs(coordinates[at] - 0.5).max(initial=0.0) > 0.5 + _BEYOND
            surfaces[number].facts["is_beyond"] |= bool(beyond)
            if (dye := surfaces[number].dye) is not None:
                values = self._primvar(prim, dye, 3, index)
                surfaces[number].facts["has_colours"] |= values is not None
                if values is not None:
                    plain = np.array([surface.facts["colour"] for surface in surfaces])
                    colours = plain[materials[faces]] if colours is None else colours
                    colours[at] = np.clip(values, 0.0, 1.0)
        return _Mesh(polygons, corners, faces, materials, coordinates, colours)

    def _number(self, material: UsdShade.Material) -> int:
        path = _path_of(material)
        if path not in self.surfaces:
            self.surfaces[path] = _Reader(material, self.time).surface() if path else _bare()
        return list(self.surfaces).index(path)

    def _coordinates(self, prim: Usd.Prim, surface: _Surface, index: dict[str, np.ndarray]) -> Floats:
        """Return the coordinates (K, 2) of corners in the pictures of a material."""
        wanted = surface.coordinates
        if wanted is None:
            sets = (self._primvar(prim, name, 2, index) for name in _COORDINATES)
            return next((values for values in sets if values is not None), np.zeros((1, 2)))
        values = self._primvar(prim, wanted.primvar, 2, index)
        if values is None:
            raise MeshError(
                f"{shorten(prim.GetPath())} does not have the texture coordinates {shorten(wanted.primvar)} "
                "that its material names. Export it with them, or write paint: off."
            )
        return wanted.transformed(values)

    def _primvar(
        self, prim: Usd.Prim, name: str, columns: int, index: dict[str, np.ndarray]
    ) -> Floats | None:
        """Return the values (K, columns) of a primvar at corners; None where there is none.

        index  places of the corners among its values, by its interpolation
        """
        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
        if not primvar or not primvar.HasValue():
            return None
        values = np.asarray(primvar.ComputeFlattened(self.time), np.float64)
        values = values[None] if values.ndim == 1 else values
        places = index[primvar.GetInterpolation()]
        is_fit = values.ndim == 2 and values.shape[1] >= columns and places.max(initial=-1) < len(values)
        if not is_fit or not np.isfinite(values).all():
            raise MeshError(f"{shorten(prim.GetPath())}: its primvar {shorten(name)} does not fit its faces")
        return values[places, :columns]


def answer_about_paint(stage: Usd.Stage, question: str, prim: str | None, time_code: float | None) -> bytes:
    """Return the arrays of a stage's paint, or with `materials` facts about these, as JSON.

    Raises MeshError for what is not read.
    """
    painted = PaintedStage(time_of(stage, time_code))
    painted.add(start_of(stage, prim))
    if question == "materials":
        return json.dumps([surface.facts for surface in painted.surfaces.values()]).encode()
    return packed_arrays(painted.arrays())


def _bound(prim: Usd.Prim) -> UsdShade.Material:
    """Return the material of a prim, which is not valid where it has none."""
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.preview)
    return material


def _path_of(material: UsdShade.Material) -> str:
    """Return the path of a material, the same in all instances; empty for none."""
    if not material:
        return ""
    prim = material.GetPrim()
    return str((prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath())


def _facts(colour: tuple[float, ...], roughness: float | None, metalness: float) -> dict[str, Any]:
    facts = {"colour": colour, "roughness": roughness, "metalness": metalness}
    return {**facts, **dict(_OPACITY), "has_colours": False, "is_beyond": False, "pictures": {}, "notes": []}


def _bare() -> _Surface:
    """Return the surface of faces without a material."""
    return _Surface(_facts(GREY, None, 0.0), dye=_DISPLAY_COLOR)


class _Reader:
    """Reads a material at a time of the stage. Raises MeshError for what is not read."""

    def __init__(self, material: UsdShade.Material, time: Usd.TimeCode) -> None:
        self.place, self.time = f"the material {shorten(material.GetPath())}", time
        self.shader, _, _ = material.ComputeSurfaceSource()
        if not self.shader or self.shader.GetShaderId() != "UsdPreviewSurface":
            raise MeshError(
                f"{self.place} is not a UsdPreviewSurface, and no other is read. Export it as one, or write "
                "paint: off."
            )
        self._coordinates: _Coordinates | None = None

    def surface(self) -> _Surface:
        """Return the surface."""
        colour, dye, pictures = (0.18, 0.18, 0.18), None, dict[str, Any]()
        for name in ("diffuseColor", "roughness", "metallic", "normal", "opacity"):
            if name == "metallic" and self._is_specular():
                continue
            node, output = self._node(self.shader, name)
            if node is None:
                continue
            kind = node.GetShaderId()
            if name == "diffuseColor" and kind == "UsdPrimvarReader_float3":
                dye = str(self._value(node, "varname", _DISPLAY_COLOR))
            elif kind == "UsdUVTexture" and output in _CHANNELS and (output != "a" or name == "opacity"):
                pictures[name] = self._picture(node, output, name)
            else:
                raise MeshError(
                    f"{self.place}: its {name} is computed by {shorten(kind or 'an unknown shader')}, which "
                    "is not read. Bake it to one picture in the program that made the file, or write "
                    "paint: off."
                )
        colour = tuple(min(max(part, 0.0), 1.0) for part in self._value(self.shader, "diffuseColor", colour))
        roughness, metalness = (
            min(max(self._value(self.shader, name, otherwise), 0.0), 1.0)
            for name, otherwise in (("roughness", 0.5), ("metallic", 0.0))
        )
        is_matt = self._is_specular() and not max(self._value(self.shader, "specularColor", (0.0,)))
        facts = _facts(colour, None if is_matt else roughness, 0.0 if self._is_specular() else metalness)
        facts |= {name: float(self._value(self.shader, name, otherwise)) for name, otherwise in _OPACITY}
        lost = [name for name in _NOT_SHOWN if self._node(self.shader, name)[0] or self._is_set(name)]
        facts["notes"] = [f"{self.place}: its {name} is not shown" for name in lost]
        return _Surface(facts | {"pictures": pictures}, self._coordinates, dye)

    def _is_set(self, name: str) -> bool:
        return bool(np.any(self._value(self.shader, name, 0.0)))

    def _is_specular(self) -> bool:
        """Tell whether it has a specular colour. Raises MeshError for one that may be a metal's."""
        if not self._value(self.shader, "useSpecularWorkflow", 0):
            return False
        node, _ = self._node(self.shader, "specularColor")
        if node is not None or max(self._value(self.shader, "specularColor", (0.0,))) > _DARKEST_MIRROR:
            raise MeshError(
                f"{self.place} has a specular colour, which is not read. Export it with metalness, or write "
                "paint: off."
            )
        return True

    def _picture(self, node: UsdShade.Shader, output: str, name: str) -> dict[str, Any]:
        """Return the facts about a texture; note its coordinates."""
        place = f"{self.place}: the texture of its {name}"
        if self._coordinates not in (None, own := self._coordinates_of(node, place)):
            raise MeshError(
                f"{self.place} has textures with different texture coordinates, and one set is read. Export "
                "it with one, or write paint: off."
            )
        self._coordinates = own
        scale, bias = (
            tuple(map(float, self._value(node, word, (otherwise,) * 4)))
            for word, otherwise in (("scale", 1.0), ("bias", 0.0))
        )
        alpha = scale[3], bias[3]
        scale, bias = scale[:3], bias[:3]
        if output == "a":
            is_read = alpha == (1.0, 0.0)
        elif name == "normal":
            if (scale, bias) == ((1.0,) * 3, (0.0,) * 3):  # as many programs write them
                scale, bias = (2.0,) * 3, (-1.0,) * 3
            is_read = all(math.isclose(2.0 * b, -a, abs_tol=0.02) for a, b in zip(scale, bias, strict=True))
            scale = tuple(0.5 * part for part in scale)
        else:
            is_read = not any(bias) and all(0.0 <= part <= 1.0 for part in scale)
        space = str(self._value(node, "sourceColorSpace", "auto"))
        if not is_read or (space == "sRGB" and name != "diffuseColor"):
            raise MeshError(
                f"{place} has a scale, bias or colour space that is not read. Write the picture as it is "
                "shown, or write paint: off."
            )
        shown = _SPACES.get(space) if name == "diffuseColor" else "data"
        stated = (str(self._value(node, side, "")) for side in ("wrapS", "wrapT"))
        wrap = [mode if mode in _WRAPS else "" for mode in stated]
        facts = {"factor": scale, "channel": _CHANNELS[output], "space": shown, "wrap": wrap}
        return facts | self._file(node, place)

    def _file(self, node: UsdShade.Shader, place: str) -> dict[str, Any]:
        """Return the path of a texture's file, or of a picture within a package its digest and name too."""
        source = node.GetInput("file")
        attributes = source.GetValueProducingAttributes() if source else []
        asset = attributes[0].Get(self.time) if attributes else None
        if not asset or not asset.path:
            raise MeshError(f"{place} names no file. Export it again, or write paint: off.")
        if "<UDIM>" in asset.path:
            raise MeshError(
                f"{place} has tiles, <UDIM>, which are not read. Bake one picture, or write paint: off."
            )
        layer = attributes[0].GetPropertyStack(self.time)[0].layer
        path = asset.resolvedPath or layer.ComputeAbsolutePath(asset.path)
        if not (asset.resolvedPath and Ar.IsPackageRelativePath(path)):
            return {"path": path, "digest": "", "name": asset.path}
        digest = hashlib.sha256(content_of_picture(path)).hexdigest()
        return {"path": path, "digest": digest, "name": Ar.SplitPackageRelativePathInner(path)[1]}

    def _coordinates_of(self, node: UsdShade.Shader, place: str) -> _Coordinates:
        source, _ = self._node(node, "st")
        scale, rotation, translation = (1.0, 1.0), 0.0, (0.0, 0.0)
        if source is not None and source.GetShaderId() == "UsdTransform2d":
            scale, rotation, translation = (
                self._value(source, name, otherwise)
                for name, otherwise in (("scale", scale), ("rotation", 0.0), ("translation", translation))
            )
            source, _ = self._node(source, "in")
        if source is None or source.GetShaderId() != "UsdPrimvarReader_float2":
            raise MeshError(
                f"{place} has no texture coordinates of a UsdPrimvarReader_float2. Export it with these, or "
                "write paint: off."
            )
        varname = str(self._value(source, "varname", "st"))
        return _Coordinates(varname, (*scale,), float(rotation), (*translation,))

    def _node(self, shader: UsdShade.Shader, name: str) -> tuple[UsdShade.Shader | None, str]:
        """Return the shader that an input is connected to, and its output; None where it has a value."""
        source = shader.GetInput(name)
        for attribute in source.GetValueProducingAttributes() if source else []:
            output = UsdShade.Output(attribute)
            if UsdShade.Output.IsOutput(attribute):
                return UsdShade.Shader(attribute.GetPrim()), output.GetBaseName()
        return None, ""

    def _value(self, shader: UsdShade.Shader, name: str, otherwise: Any) -> Any:
        """Return the value of an input, also through those of materials and graphs."""
        source = shader.GetInput(name)
        attributes = source.GetValueProducingAttributes() if source else []
        if not attributes or UsdShade.Output.IsOutput(attributes[0]):
            return otherwise
        value = attributes[0].Get(self.time)
        return otherwise if value is None else value
