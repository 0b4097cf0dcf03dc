"""Looks of a shot as materials of a USD stage, each as two surfaces.

UsdPreviewSurface, which every reader knows, has neither refraction nor scattering inside a body. OpenPBR has
both, as a network of MaterialX; readers that know it take it from the output `mtlx:surface`. Neither has our
patterns: those become colours of vertices.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pxr import Gf, Sdf, Usd, UsdShade

from flowsculpt.api.materials import Material
from flowsculpt.pipeline.plugins.interchange.usd_prims import sample

LENGTHS = ("transmission_depth", "subsurface_radius")
"""Inputs in halves of the subject's size, which a stage needs in scene units."""

_ADDRESSES = {"repeat": "periodic", "clamp": "clamp", "mirror": "mirror", "black": "constant"}
"""What is shown beyond the sides of a picture, as MaterialX names it."""

MATERIALX = "1.39"
"""The version of MaterialX whose nodes are written."""

_NODES = {
    "base_color": ("diffuseColor", "color3", "Color3f"),
    "specular_roughness": ("roughness", "float", "Float"),
    "base_metalness": ("metallic", "float", "Float"),
    "geometry_normal": ("normal", "vector3", "Vector3f"),
    "geometry_opacity": ("opacity", "float", "Float"),
}
"""Inputs of OpenPBR that pictures give: the input of the preview surface, and types of MaterialX and USD."""


def add_material(
    stage: Usd.Stage,
    path: str,
    look: Material,
    pictures: Mapping[str, str] | None = None,
    is_coloured: bool = False,
    sizes: Mapping[int, float] | None = None,
) -> UsdShade.Material:
    """Add the material of a look.

    pictures     files beside the stage by the input of the preview surface that they are for
    is_coloured  True if its colours are those of vertices, where no picture has them
    sizes        half the subject's size by frame number, scene units; None where it is 1
    """
    material = UsdShade.Material.Define(stage, path)
    _add_preview_surface(stage, material, look, pictures or {}, is_coloured)
    _add_openpbr(stage, material, look, pictures or {}, is_coloured, sizes or {0: 1.0})
    return material


def _wrap_of(look: Material, name: str) -> tuple[str, str]:
    """Return what is shown beyond the sides of the picture for an input of the preview surface of a look."""
    (part, *_) = look.parts_by_number
    if name == "opacity":
        texture = None if part.opacity is None else part.opacity.texture
    else:
        texture = part.texture("colour" if name == "diffuseColor" else name)
    return ("repeat", "repeat") if texture is None else texture.wrap


def _add_preview_surface(
    stage: Usd.Stage,
    material: UsdShade.Material,
    look: Material,
    pictures: Mapping[str, str],
    is_coloured: bool,
) -> None:
    path = str(material.GetPath())
    shader = _shader(stage, f"{path}/surface", "UsdPreviewSurface")
    surface = look.preview_surface()
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
    if look.opacity and look.opacity.cutoff is not None:
        _set(shader, "opacityThreshold", "Float", look.opacity.cutoff)
    for name, file in pictures.items():
        output = "rgb" if name in ("diffuseColor", "normal") else "r"
        reader = _picture_reader(stage, path, file, "picture" if name == "diffuseColor" else name, output)
        for setting, mode in zip(("wrapS", "wrapT"), _wrap_of(look, name), strict=True):
            _set(reader, setting, "Token", mode)
        if name == "normal":
            shader.CreateInput(name, Sdf.ValueTypeNames.Normal3f)
            for setting, value in (("scale", 2.0), ("bias", -1.0)):
                _set(reader, setting, "Float4", Gf.Vec4f(value))
        shader.GetInput(name).ConnectToSource(reader.ConnectableAPI(), output)
    if is_coloured and "diffuseColor" not in pictures:
        reader = _primvar_reader(stage, f"{path}/colour", 3, "displayColor")
        shader.GetInput("diffuseColor").ConnectToSource(reader.ConnectableAPI(), "result")
    shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")


def _add_openpbr(
    stage: Usd.Stage,
    material: UsdShade.Material,
    look: Material,
    pictures: Mapping[str, str],
    is_coloured: bool,
    sizes: Mapping[int, float],
) -> None:
    path = f"{material.GetPath()}/openpbr"
    shader = _shader(stage, path, "ND_open_pbr_surface_surfaceshader")
    for name, value in look.openpbr().items():
        if isinstance(value, tuple):
            _set(shader, name, "Color3f", value)
        elif name in LENGTHS:
            length = shader.CreateInput(name, Sdf.ValueTypeNames.Float).GetAttr()
            sample(length, {number: value * size for number, size in sizes.items()})
        else:
            _set(shader, name, "Float", value)
    for name, (of_preview, kind, value_type) in _NODES.items():
        if of_preview not in pictures:
            continue
        source = _image(stage, path, pictures[of_preview], name, kind, value_type)
        for setting, mode in zip(("uaddressmode", "vaddressmode"), _wrap_of(look, of_preview), strict=True):
            _set(source, setting, "String", _ADDRESSES[mode])
        if of_preview == "normal":
            source = _turning(stage, f"{path}_normals", source)
        if of_preview == "opacity":
            source = _cut_out(stage, f"{path}_cut_out", look, source)
        _connect(shader, name, value_type, source)
    if is_coloured and "diffuseColor" not in pictures:
        _connect(
            shader, "base_color", "Color3f", _vertex_value(stage, path, "displayColor", "color3", "Color3f")
        )
    shader.CreateOutput("out", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput("mtlx").ConnectToSource(shader.ConnectableAPI(), "out")
    version = material.GetPrim().CreateAttribute(
        "config:mtlx:version", Sdf.ValueTypeNames.String, custom=False
    )
    version.Set(MATERIALX)


def _image(stage: Usd.Stage, path: str, file: str, name: str, kind: str, value_type: str) -> UsdShade.Shader:
    """Add the node that reads a linear picture by texture coordinates."""
    image = _shader(stage, f"{path}_{name}", f"ND_image_{kind}")
    _set(image, "file", "Asset", Sdf.AssetPath(f"./{file}"))
    _connect(image, "texcoord", "Float2", _vertex_value(stage, path, "st", "vector2", "Float2"))
    image.CreateOutput("out", getattr(Sdf.ValueTypeNames, value_type))
    return image


def _turning(stage: Usd.Stage, path: str, image: UsdShade.Shader) -> UsdShade.Shader:
    """Add the node that turns the normals of a surface by those of a picture, 0 … 1."""
    normals = _shader(stage, path, "ND_normalmap_float")
    _connect(normals, "in", "Vector3f", image)
    normals.CreateOutput("out", Sdf.ValueTypeNames.Vector3f)
    return normals


def _cut_out(stage: Usd.Stage, path: str, look: Material, opacity: UsdShade.Shader) -> UsdShade.Shader:
    """Add the node that rounds opacities to 0 and 1 where a look has a cutoff."""
    held = look.opacity
    if held is None or held.cutoff is None:
        return opacity
    rounded = _shader(stage, path, "ND_ifgreatereq_float")
    _connect(rounded, "value1", "Float", opacity)
    for name, value in (("value2", held.cutoff), ("in1", 1.0), ("in2", 0.0)):
        _set(rounded, name, "Float", value)
    rounded.CreateOutput("out", Sdf.ValueTypeNames.Float)
    return rounded


def _vertex_value(stage: Usd.Stage, path: str, name: str, kind: str, value_type: str) -> UsdShade.Shader:
    """Add the node that reads a primvar."""
    value = _shader(stage, f"{path}_{name}", f"ND_geompropvalue_{kind}")
    _set(value, "geomprop", "String", name)
    value.CreateOutput("out", getattr(Sdf.ValueTypeNames, value_type))
    return value


def _connect(shader: UsdShade.Shader, name: str, value_type: str, source: UsdShade.Shader) -> None:
    taken = shader.CreateInput(name, getattr(Sdf.ValueTypeNames, value_type))
    taken.ConnectToSource(source.ConnectableAPI(), "out")


def connect_opacity(stage: Usd.Stage, path: str) -> None:
    """Let the opacity of a material be that of vertices, the primvar displayOpacity."""
    reader = _primvar_reader(stage, f"{path}/opacity", 1, "displayOpacity")
    shader = UsdShade.Shader.Get(stage, f"{path}/surface")
    shader.GetInput("opacity").ConnectToSource(reader.ConnectableAPI(), "result")
    of_vertices = _vertex_value(stage, f"{path}/openpbr", "displayOpacity", "float", "Float")
    _connect(UsdShade.Shader.Get(stage, f"{path}/openpbr"), "geometry_opacity", "Float", of_vertices)


def _picture_reader(stage: Usd.Stage, path: str, picture: str, name: str, output: str) -> UsdShade.Shader:
    """Add the shader that reads a linear picture by texture coordinates: its colours, `rgb`, or numbers,
    `r`."""
    coordinates = _primvar_reader(stage, f"{path}/coordinates", 2, "st")
    reader = _shader(stage, f"{path}/{name}", "UsdUVTexture")
    _set(reader, "file", "Asset", Sdf.AssetPath(f"./{picture}"))
    _set(reader, "sourceColorSpace", "Token", "raw")
    coordinate = reader.CreateInput("st", Sdf.ValueTypeNames.Float2)
    coordinate.ConnectToSource(coordinates.ConnectableAPI(), "result")
    reader.CreateOutput(output, Sdf.ValueTypeNames.Float3 if output == "rgb" else Sdf.ValueTypeNames.Float)
    return reader


def _primvar_reader(stage: Usd.Stage, path: str, size: int, name: str) -> UsdShade.Shader:
    """Add the shader that reads a primvar of so many floats."""
    kind = f"Float{size}" if size > 1 else "Float"
    reader = _shader(stage, path, f"UsdPrimvarReader_{kind.lower()}")
    _set(reader, "varname", "String", name)
    reader.CreateOutput("result", getattr(Sdf.ValueTypeNames, kind))
    return reader


def _shader(stage: Usd.Stage, path: str, kind: str) -> UsdShade.Shader:
    shader = UsdShade.Shader.Define(stage, path)
    shader.CreateIdAttr(kind)
    return shader


def bind(prim: Usd.Prim, material: UsdShade.Material) -> None:
    """Bind a material to a prim."""
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)


def _set(shader: UsdShade.Shader, name: str, kind: str, value: Any) -> None:
    held = Gf.Vec3f(*value) if isinstance(value, tuple) else value
    shader.CreateInput(name, getattr(Sdf.ValueTypeNames, kind)).Set(held)
