"""Materials of USD stages as OpenPBR: networks that MaterialX reads, with the light of our renders."""

from __future__ import annotations

import math
from collections.abc import Iterator

import MaterialX
import numpy as np
import pytest
from MaterialX.PyMaterialXGenGlsl import GlslShaderGenerator
from MaterialX.PyMaterialXGenShader import GenContext
from pxr import Sdf, Usd, UsdShade

from flowsculpt.pipeline.plugins.interchange.usd_materials import add_material, connect_opacity
from flowsculpt.render.scene.materials import (
    LOOKS,
    Absorption,
    Glass,
    Opacity,
    Plastic,
    Satin,
    Smoke,
    Subsurface,
)

TYPES = {
    "color3f": "color3",
    "float": "float",
    "float2": "vector2",
    "vector3f": "vector3",
    "asset": "filename",
    "string": "string",
}
PICTURES = {name: f"{name}.exr" for name in ("diffuseColor", "roughness", "metallic", "normal", "opacity")}


@pytest.fixture(scope="module")
def library() -> MaterialX.Document:
    """The nodes of MaterialX."""
    library = MaterialX.createDocument()
    MaterialX.loadLibraries(
        MaterialX.getDefaultDataLibraryFolders(), MaterialX.getDefaultDataSearchPath(), library
    )
    return library


def shaders(material: UsdShade.Material) -> Iterator[UsdShade.Shader]:
    for prim in material.GetPrim().GetChildren():
        shader = UsdShade.Shader(prim)
        if shader.GetShaderId().startswith("ND_"):
            yield shader


def value_of(shader_input: UsdShade.Input) -> str:
    value = shader_input.Get(1.0) if shader_input.Get() is None else shader_input.Get()
    if isinstance(value, Sdf.AssetPath):
        return str(value.path)
    return value if isinstance(value, str) else ", ".join(map(str, np.atleast_1d(np.array(value))))


def network(material: UsdShade.Material, library: MaterialX.Document) -> MaterialX.Document:
    """Return the network at `mtlx:surface` as MaterialX writes it, each node as its definition has it."""
    document = MaterialX.createDocument()
    document.setDataLibrary(library)
    for shader in shaders(material):
        definition = library.getNodeDef(shader.GetShaderId())
        assert definition, f"MaterialX has no node {shader.GetShaderId()}"
        name = shader.GetPrim().GetName()
        node = document.addNode(definition.getNodeString(), name, definition.getType())
        for shader_input in shader.GetInputs():
            known, title = definition.getActiveInput(shader_input.GetBaseName()), shader_input.GetFullName()
            assert known, f"{shader.GetShaderId()} has no input {title}"
            kind = TYPES[str(shader_input.GetTypeName())]
            assert known.getType() == kind, title
            own = node.addInput(shader_input.GetBaseName(), kind)
            if shader_input.HasConnectedSource():
                own.setNodeName(shader_input.GetConnectedSources()[0][0].source.GetPrim().GetName())
            else:
                own.setValueString(value_of(shader_input))
    surface = document.addNode("surfacematerial", "whole", "material")
    source = material.GetSurfaceOutput("mtlx").GetConnectedSources()[0][0].source.GetPrim().GetName()
    surface.addInput("surfaceshader", "surfaceshader").setNodeName(source)
    return document


def assert_is_read(material: UsdShade.Material, library: MaterialX.Document) -> None:
    document = network(material, library)
    valid, message = document.validate()
    assert valid, message
    generator = GlslShaderGenerator.create()
    context = GenContext(generator)
    context.registerSourceCodeSearchPath(MaterialX.getDefaultDataSearchPath())
    shader = generator.generate("whole", document.getNode("whole"), context)
    assert "main()" in shader.getSourceCode("pixel")


@pytest.mark.parametrize("name", ["clay", "honey", "smoke", "pearl", "chrome", "cream"])
def test_materialx_makes_a_shader_of_each_kind_of_look(name, library):
    stage = Usd.Stage.CreateInMemory()
    assert_is_read(add_material(stage, "/look", LOOKS[name], is_coloured=name == "pearl"), library)


def test_materialx_reads_pictures_cut_outs_and_opacities_of_vertices(library):
    stage = Usd.Stage.CreateInMemory()
    look = Satin((1.0, 1.0, 1.0), opacity=Opacity(cutoff=0.5))
    assert_is_read(add_material(stage, "/whole", look, PICTURES), library)
    floor = add_material(stage, "/floor", LOOKS["clay"], is_coloured=True)
    connect_opacity(stage, "/floor")
    assert_is_read(floor, library)


@pytest.mark.parametrize("name", sorted(LOOKS))
def test_all_looks_have_inputs_that_openpbr_knows(name, library):
    stage = Usd.Stage.CreateInMemory()
    valid, message = network(add_material(stage, "/look", LOOKS[name]), library).validate()
    assert valid, message


def test_light_that_crosses_a_body_of_glass_loses_as_much_as_in_renders():
    glass = Glass((1.0, 0.8, 0.36), absorption=Absorption((0.96, 0.72, 0.3), 0.4))
    inputs = glass.openpbr()
    crossed = np.array(inputs["transmission_color"]) ** (2.0 / inputs["transmission_depth"])
    rendered = np.array(glass.colour) ** 2 * np.array(glass.absorption.colour) ** (2.0 / 0.4)
    np.testing.assert_allclose(crossed, rendered, rtol=1e-9)


def test_milky_glass_scatters_once_in_each_radius():
    radius = (0.5, 0.25, 0.2)
    inputs = Glass((1.0, 1.0, 1.0), subsurface=Subsurface(radius)).openpbr()
    rate = np.array(inputs["transmission_scatter"]) / inputs["transmission_depth"]
    np.testing.assert_allclose(rate, 1.0 / np.array(radius))
    assert max(inputs["transmission_scatter"]) <= 1.0


def test_smoke_scatters_as_often_as_its_density_says():
    inputs = Smoke((0.9, 0.8, 0.7), density=4.0).openpbr()
    lost = -np.log(inputs["transmission_color"]) / inputs["transmission_depth"]
    np.testing.assert_allclose(lost, 4.0)
    scattered = np.array(inputs["transmission_scatter"]) / inputs["transmission_depth"]
    np.testing.assert_allclose(scattered / lost, (0.9, 0.8, 0.7))


def test_lengths_are_in_scene_units_and_follow_a_subject_that_grows():
    stage, look = (
        Usd.Stage.CreateInMemory(),
        Plastic((0.8, 0.7, 0.5), subsurface=Subsurface((0.2, 0.1, 0.05))),
    )
    add_material(stage, "/look", look, sizes={1: 3.0, 2: 6.0})
    shader = UsdShade.Shader.Get(stage, "/look/openpbr")
    radius = shader.GetInput("subsurface_radius")
    assert math.isclose(radius.Get(1.0), 0.6, rel_tol=1e-6)
    assert math.isclose(radius.Get(2.0), 1.2, rel_tol=1e-6)
    np.testing.assert_allclose(shader.GetInput("subsurface_radius_scale").Get(), (1.0, 0.5, 0.25))
