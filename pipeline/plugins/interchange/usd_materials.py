"""Looks as UsdPreviewSurface, the material that every reader of USD knows.

It has neither refraction nor scattering inside a body, and no patterns: those become colours of vertices.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from pipeline.plugins.interchange.exported_frame import colour_texture, has_colours
from render.base.serialise import Colour
from render.scene.materials import (
    BrushedMetal,
    Diffuse,
    Glass,
    Glossy,
    Material,
    Metal,
    MitsubaMaterial,
    Satin,
    Smoke,
)

if TYPE_CHECKING:
    from pxr import Usd, UsdShade

CLEAR_OPACITY = 0.3
"""Opacity of clear bodies. Readers do not refract at a preview surface; at 0 some would show nothing."""


class PreviewSurface(NamedTuple):
    """Inputs of a UsdPreviewSurface. `colour` is linear Rec.709; the others lie between 0 and 1."""

    colour: Colour
    roughness: float
    metallic: float = 0.0
    clearcoat: float = 0.0
    opacity: float = 1.0
    refraction: float = 1.5
    is_matt: bool = False


def preview_surface(look: Material) -> PreviewSurface:
    """Return the preview surface that is nearest to a look."""
    if isinstance(look, Metal | BrushedMetal):
        return PreviewSurface(look.colour, look.roughness, metallic=1.0)
    if isinstance(look, Satin):
        return PreviewSurface(look.colour, look.roughness, look.metallic, look.coat)
    if isinstance(look, Glass):
        return PreviewSurface(
            look.auxiliary_colour, look.roughness, opacity=CLEAR_OPACITY, refraction=look.refraction
        )
    if isinstance(look, Smoke):
        return PreviewSurface(look.colour, 1.0, opacity=CLEAR_OPACITY, is_matt=True)
    if isinstance(look, Glossy | MitsubaMaterial):
        return PreviewSurface(look.colour, look.roughness)
    return PreviewSurface(look.colour, 1.0, is_matt=isinstance(look, Diffuse))


def add_material(stage: Usd.Stage, path: str, look: Material, picture: str = "") -> UsdShade.Material:
    """Add the material of a look. A colour that varies is read from a picture or from the vertices' colours.

    picture  the file of the picture that colours the look, relative to the stage
    """
    from pxr import Sdf, UsdShade

    material = UsdShade.Material.Define(stage, path)
    shader = _shader(stage, f"{path}/surface", "UsdPreviewSurface")
    surface = preview_surface(look)
    _set(shader, "diffuseColor", "Color3f", surface.colour)
    for name, value in (
        ("roughness", surface.roughness),
        ("metallic", surface.metallic),
        ("clearcoat", surface.clearcoat),
        ("opacity", surface.opacity),
        ("ior", surface.refraction),
    ):
        _set(shader, name, "Float", value)
    if surface.is_matt:
        _set(shader, "useSpecularWorkflow", "Int", 1)
        _set(shader, "specularColor", "Color3f", (0.0, 0.0, 0.0))
    if colour_texture(look) is not None:
        reader, output = _picture_reader(stage, path, picture), "rgb"
    elif has_colours(look):
        reader, output = _primvar_reader(stage, f"{path}/colour", 3, "displayColor"), "result"
    else:
        reader = None
    if reader is not None:
        shader.GetInput("diffuseColor").ConnectToSource(reader.ConnectableAPI(), output)
    shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return material


def _picture_reader(stage: Usd.Stage, path: str, picture: str) -> UsdShade.Shader:
    """Add the shader that reads a picture of linear colours, which repeats, by texture coordinates."""
    from pxr import Sdf

    coordinates = _primvar_reader(stage, f"{path}/coordinates", 2, "st")
    reader = _shader(stage, f"{path}/picture", "UsdUVTexture")
    _set(reader, "file", "Asset", Sdf.AssetPath(f"./{picture}"))
    for name, value in (("wrapS", "repeat"), ("wrapT", "repeat"), ("sourceColorSpace", "raw")):
        _set(reader, name, "Token", value)
    coordinate = reader.CreateInput("st", Sdf.ValueTypeNames.Float2)
    coordinate.ConnectToSource(coordinates.ConnectableAPI(), "result")
    reader.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    return reader


def _primvar_reader(stage: Usd.Stage, path: str, size: int, name: str) -> UsdShade.Shader:
    """Add the shader that reads a primvar of so many floats."""
    from pxr import Sdf

    reader = _shader(stage, path, f"UsdPrimvarReader_float{size}")
    _set(reader, "varname", "String", name)
    reader.CreateOutput("result", getattr(Sdf.ValueTypeNames, f"Float{size}"))
    return reader


def _shader(stage: Usd.Stage, path: str, kind: str) -> UsdShade.Shader:
    from pxr import UsdShade

    shader = UsdShade.Shader.Define(stage, path)
    shader.CreateIdAttr(kind)
    return shader


def bind(prim: Usd.Prim, material: UsdShade.Material) -> None:
    """Bind a material to a prim."""
    from pxr import UsdShade

    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)


def _set(shader: UsdShade.Shader, name: str, kind: str, value: Any) -> None:
    from pxr import Gf, Sdf

    held = Gf.Vec3f(*value) if isinstance(value, tuple) else value
    shader.CreateInput(name, getattr(Sdf.ValueTypeNames, kind)).Set(held)
