"""Small sound files of every format that is read, made by code."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import av
import DracoPy
import numpy as np
import OpenImageIO as oiio
import trimesh
from PIL import ImageCms
from pxr import Sdf, UsdUtils

from flowsculpt.pipeline.mesh import box, icosphere, split_at_creases
from flowsculpt.pipeline.plugins.interchange.exported_frame import ExportedFrame
from flowsculpt.pipeline.plugins.interchange.model_export import write_glb, write_obj, write_ply
from flowsculpt.pipeline.plugins.lettering.fonts import font_file
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.rgb_spaces import ACESCG
from tests.plugins.interchange.fbx_writer import N, binary, box_geometry, layer, model, scene, text
from tests.plugins.interchange.gltf_scenes import GltfScene, with_instances
from tests.plugins.interchange.test_collada_files import BOX, document, faces
from tests.plugins.interchange.test_meshopt import STREAMS
from tests.plugins.interchange.test_model_paint import gltf_box
from tests.plugins.interchange.test_threemf_files import corner, model_part, package

FLOW = """\
import math
\"\"\"A flow.\"\"\"

def move(points, start, end):
    return points + math.sin(end) * [0.0, 1.0, f"{start!r}" and 0.0]
"""

VIEW = """\
ocio_profile_version: 2
roles: {default: LINEAR, scene_linear: LINEAR}
displays:
  wall:
    - !<View> {name: Plain, colorspace: rooted}
    - !<View> {name: Graded, colorspace: graded}
colorspaces:
  - !<ColorSpace> {name: LINEAR}
  - !<ColorSpace>
    name: rooted
    from_scene_reference: !<ExponentTransform> {value: 2, direction: inverse}
  - !<ColorSpace>
    name: graded
    from_scene_reference: !<MatrixTransform> {matrix: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
"""

OBJ = """\
# a box of quads with parts, creases and a long statement
mtllib box.mtl
o box
v -1 -1 -1
v 1 -1 -1
v 1 1 -1
v -1 1 -1
v -1 -1 1
v 1 -1 1
v 1 1 1
v -1 1 1
vt 0 0
vn 0 0 1
s 1
usemtl red
f 1/1/1 4/1/1 3/1/1 2/1/1
f 5//1 6//1 \\
  7//1 8//1
g sides
s off
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f -8 -4 -1 -5
t crease 2/1/0 0 1 2.5
"""


STAGE = """\
#usda 1.0
(
    defaultPrim = "World"
    startTimeCode = 2
    endTimeCode = 3
    upAxis = "Z"
)

class Xform "part"
{
    def Mesh "box"
    {
        uniform token orientation = "leftHanded"
        int[] faceVertexCounts = [4, 4, 4, 4, 4]
        int[] faceVertexIndices = [2, 3, 1, 0, 5, 7, 6, 4, 1, 5, 4, 0, 6, 7, 3, 2, 4, 6, 2, 0]
        point3f[] points = [
            (-1, -1, -1), (-1, -1, 1), (-1, 1, -1), (-1, 1, 1), (1, -1, -1), (1, -1, 1), (1, 1, -1), (1, 1, 1)
        ]
        int[] creaseIndices = [4, 6, 7]
        int[] creaseLengths = [3]
        float[] creaseSharpnesses = [10]
        int[] holeIndices = [2]
        uniform token subdivisionScheme = "none"
    }
}

def Xform "World"
{
    double3 xformOp:translate = (1, 2, 3)
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 4: (0, 0, 9) }
    uniform token[] xformOpOrder = ["xformOp:translate"]

    def "one" (
        instanceable = true
        references = </part>
    )
    {
    }

    def PointInstancer "many"
    {
        rel prototypes = <proto>
        int[] protoIndices = [0, 0]
        point3f[] positions = [(9, 0, 0), (18, 0, 0)]
        quath[] orientations = [(1, 0, 0, 0), (0, 1, 0, 0)]
        float3[] scales = [(1, 1, 1), (-1, 2, 1)]

        def Xform "proto" (
            payload = </part>
        )
        {
        }
    }
}
"""


DRAWING = """<?xml version="1.0" encoding="UTF-8"?>
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100" width="200" height="200"><style>
.a{fill:none;stroke:red;stroke-width:3px}@media screen and (min-width:10px){.b{fill:blue !important}}
@media print{.a{display:none}}@layer x{#c{opacity:.5}}</style><defs>
<g id="g"><circle cx="5" cy="5" r="4"/><rect width="9" height="3" rx="1"/></g>
<symbol id="s"><ellipse rx="3" ry="5"/></symbol></defs>
<g transform="translate(10,20) rotate(30 5 5) scale(2)" style="transform-origin:center;
transform-box:fill-box">
<path class="a" d="M10 10h30v5.5e0l-4 4c1 2 3 4 5 6s2 3 9 9q1 2 8 8t2 2a5 6 30 01 9 9z"
stroke-dasharray="0 0"/>
</g><switch><g systemLanguage="de"><path d="M0 0h9v9z"/></g><use href="#g" x="40" y="3"/></switch>
<polygon class="b" points="1,2 30,4 12,40"/><use href="#s" x="70" y="70"/>
<polyline fill="none" stroke="#000f" stroke-linecap="square" points="50 50 60 80 90 55"/></svg>
"""


class Sample(NamedTuple):
    """kind: the reader that takes it, one of `files.READERS`."""

    kind: str
    path: Path


def samples(folder: Path) -> list[Sample]:
    """Write a sample of each format into a folder, and return them."""
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for kind, name, content in _contents(folder):
        (folder / name).write_bytes(content)
        made.append(Sample(kind, folder / name))
    others = (*_stages(folder), *_pictures(folder), *_sounds(folder))
    return made + [Sample(kind, path) for kind, path in others]


def _scene_of_features(path: Path) -> bytes:
    """Return a GLB with compressed, sparse, skinned and instanced meshes."""
    scene, ball = GltfScene(), icosphere(3)
    packed = scene.view(DracoPy.encode(ball.vertices.astype(np.float32), ball.faces))
    draco = {"KHR_draco_mesh_compression": {"bufferView": packed, "attributes": {"POSITION": 0}}}
    compressed = scene.triangles(ball, extensions=draco)
    for accessor in scene.json["accessors"]:
        del accessor["bufferView"]
    stream = STREAMS["triangles of a ball, version 1"]
    counts = {"count": stream["count"], "byteStride": stream["stride"], "mode": stream["mode"]}
    view = scene.json["bufferViews"][scene.view(stream["encoded"])]
    view["extensions"] = {"KHR_meshopt_compression": {**view, **counts}}
    plain = scene.triangles(ball)
    primitive = scene.json["meshes"][plain]["primitives"][0]
    scene.json["accessors"][primitive["indices"]]["bufferView"] = scene.json["bufferViews"].index(view)
    moved = {"bufferView": scene.view(np.arange(9, dtype=np.uint8).tobytes()), "componentType": 5121}
    values = {"bufferView": scene.view(ball.vertices[:9].astype(np.float32).tobytes())}
    positions = scene.json["accessors"][primitive["attributes"]["POSITION"]]
    positions["sparse"] = {"count": 9, "indices": moved, "values": values}
    skinned = scene.triangles(ball, mode=5)
    weights = np.tile([[255, 0, 0, 0]], (len(ball.vertices), 1)).astype(np.uint8)
    scene.json["meshes"][skinned]["primitives"][0]["attributes"] |= {
        "JOINTS_0": scene.accessor(np.zeros_like(weights)),
        "WEIGHTS_0": scene.accessor(weights, normalized=True),
    }
    bone = scene.node(rotation=[0.0, 0.6, 0.0, 0.8])
    scene.json["skins"] = [{"joints": [bone]}]
    scene.node(mesh=skinned, skin=0)
    scene.node(mesh=compressed, scale=[1.0, -1.0, 1.0])
    turns = np.array([[0, 0, 0, 1], [0, 0.6, 0, 0.8]])
    scene.node(mesh=plain, extensions=with_instances(scene, TRANSLATION=np.eye(3)[:2], ROTATION=turns))
    return scene.glb(path).read_bytes()


def _painted(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Yield files with materials: glTF of gloss and of metalness, as one file and as JSON, OBJ and MTL."""
    texture = {"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2], "rotation": 0.5}}}
    glossy = {"diffuseFactor": [1, 0.5, 0, 1], "diffuseTexture": texture, "glossinessFactor": 0.3}
    first = gltf_box(folder, extensions={"KHR_materials_pbrSpecularGlossiness": glossy})
    surface = {"baseColorTexture": texture, "metallicRoughnessTexture": texture, "roughnessFactor": 0.5}
    more = {"alphaMode": "MASK", "alphaCutoff": 0.25, "emissiveFactor": [0, 1, 0]}
    second = gltf_box(folder, pbrMetallicRoughness=surface, **more)
    second.json["textures"] = [{"extensions": {"EXT_texture_webp": {"source": 0}}, "sampler": 0}]
    second.json["samplers"] = [{"wrapS": 33071, "wrapT": 33648}]
    yield "gloss.glb", first.glb(folder / "gloss.glb").read_bytes()
    yield "metal.gltf", second.gltf(folder / "metal.gltf").read_bytes()
    yield "painted.obj", b"v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nvt 0 2\nusemtl one\nf 1/1 2/1 3/1\n"
    yield "one.mtl", b"newmtl one\nKd 1 0.5 0\nKs 1 1 1\nNs 40\nd 0.5\nPr 0.3\nPm 1\nKe 0 0 1\n"


def _timeline(folder: Path) -> Path:
    """Write a timeline with frames, a movie, a dissolve, a clip at twice its speed, and a sound."""
    from opentimelineio import schema

    from tests.plugins.delivery.test_imported_edit import clip, frames, movie, saved, span, transition

    marked = clip(frames(available=span(0, 24)))
    marked.markers.append(schema.Marker("look", span(2, 1)))
    marked.effects.append(schema.LinearTimeWarp("twice", time_scalar=2.0))
    film = movie("file:///films/A.1-24.prores4444.mov", span(86400, 24))
    sound = schema.Clip(
        "music", schema.ExternalReference("a.wav", span(0, 96_000, 48_000)), span(0, 48_000, 48_000)
    )
    shown = (clip(frames(available=span(0, 24))), transition(), clip(film, span(86402, 3)), marked)
    return saved(folder, *shown, sounds=(sound,))


def _contents(folder: Path) -> Iterator[tuple[str, str, bytes]]:
    ball = trimesh.creation.icosphere(1)
    yield "model", "box.obj", OBJ.encode()
    yield "model", "binary.ply", ball.export(file_type="ply")
    yield "model", "text.ply", ball.export(file_type="ply", encoding="ascii")
    yield "model", "uneven.ply", _uneven_ply()
    yield "model", "binary.stl", ball.export(file_type="stl")
    yield "model", "text.stl", ball.export(file_type="stl_ascii").encode()
    yield "model", "line.stl", b" ".join(ball.export(file_type="stl_ascii").encode().split())
    yield "model", "ball.off", ball.export(file_type="off").encode()
    yield "model", "binary.off", _binary_off(ball)
    yield "model", "strips.ply", _strips_ply()
    yield "model", "utf16.obj", OBJ.encode("utf-16")
    yield "scene", "ball.glb", trimesh.Scene([ball, trimesh.creation.box()]).export(file_type="glb")
    yield "scene", "features.glb", _scene_of_features(folder / "features.glb")
    yield from (("paint", name, content) for name, content in _painted(folder))
    yield "stage", "box.usda", STAGE.encode()
    yield "timeline", "cut.otio", _timeline(folder).read_bytes()
    yield "model", "box.dae", collada().encode()
    yield "model", "two.3mf", _package()
    for form, write in (("text", text), ("binary", binary)):
        yield "fbx", f"{form}.fbx", write(_fbx())
    for form, write in (("ply", write_ply), ("obj", write_obj)):
        write(folder / f"export.{form}", exported())
        yield "model", f"export.{form}", (folder / f"export.{form}").read_bytes()
    write_glb(folder / "export.glb", exported(), LOOKS["clay"])
    yield "scene", "export.glb", (folder / "export.glb").read_bytes()
    yield "flow", "flow.py", FLOW.encode()
    yield "drawing", "rich.svg", DRAWING.encode()
    yield "font", "bold.ttf", Path(font_file("")).read_bytes()
    yield "view", "view.ocio", VIEW.encode()
    points = np.random.default_rng(0).normal(size=(24, 3))
    yield "points", "cloud.xyz", "\n".join(f"{x:.4f}, {y:.4f} {z:.4f} 7" for x, y, z in points).encode()
    yield "points", "cloud.ply", trimesh.PointCloud(points).export(file_type="ply")
    yield "points", "cloud.npz", _npz(points=points, size=np.ones(24), names=np.array(["a", "b"]))
    yield "net", "net.npz", _npz(vertices=points.reshape(6, 4, 3))
    yield "net", "net.obj", "".join(f"v {x} {y} {z}\n" for x, y, z in points).encode()
    axis = np.linspace(-1.0, 1.0, 4)
    velocity = np.ones((2, 4, 4, 4, 3), np.float32)
    yield "field", "wind.npz", _npz(x=axis, y=axis, z=axis, t=np.arange(2.0), velocity=velocity)
    yield "field", "text.vti", _vtk("ascii", "").encode()
    yield "field", "packed.vti", _vtk("binary", 'compressor="vtkZLibDataCompressor"').encode()
    yield "field", "wind.vtr", _rectilinear().encode()


def collada() -> str:
    """Return a COLLADA file with faces of every kind, nodes, instances and a skin."""
    sets = "".join(
        faces(*given)
        for given in (
            ("polygons", "0 1 3 2", "4 6 7 5"),
            ("tristrips", "0 4 1 5"),
            ("trifans", "2 3 7 6"),
            ("triangles", "0 2 6"),
        )
    )
    nodes = """<node><rotate>0 0 1 90</rotate><scale>1 2 1</scale><instance_geometry url="#box"/></node>
    <node><matrix>-1 0 0 30  0 1 0 0  0 0 1 0  0 0 0 1</matrix><instance_node url="#part"/>
    <instance_controller url="#skin"/></node>"""
    more = """<library_nodes><node id="part"><translate>0 9 0</translate>
    <instance_geometry url="#box"/></node></library_nodes>
    <library_controllers><controller id="skin"><skin source="#box"/></controller>
    </library_controllers>"""
    asset = '<unit meter="0.0254"/><up_axis>Z_UP</up_axis>'
    return document(BOX.replace("count", 'material="red" count', 1) + sets, nodes, asset, more=more)


def _package() -> bytes:
    """Return a 3MF package of two model parts."""
    component = '<component objectid="1" p:path="/3D/b.model" transform="-2 0 0 0 2 0 0 0 2 0 0 0"/>'
    pair = f'<object id="2"><components>{component}</components></object>'
    file = io.BytesIO()
    package(
        file,
        a=model_part(pair + corner(1), '<item objectid="2"/><item objectid="1"/>'),
        b=model_part(corner(1), ""),
    )
    return file.getvalue()


def _fbx() -> list[N]:
    """Return a scene of FBX with layers, pivots, a mirrored instance and a parent."""
    layers = (
        layer("LayerElementMaterial", "ByPolygon", "Materials", [1, 0, 0, 0, 0, 0]),
        N("Edges", (list(range(4)),)),
        layer("LayerElementSmoothing", "ByEdge", "Smoothing", [0, 1, 1, 1]),
        layer("LayerElementHole", "ByPolygon", "Hole", [0, 0, 1, 0, 0, 0]),
    )
    turned = {"Lcl__Rotation": (0.0, 0.0, 90.0), "RotationPivot": (1.0, 0.0, 0.0), "RotationActive": 1}
    nodes = [
        model(2, "box", **turned, GeometricTranslation=(0.0, 0.0, 5.0)),
        model(3, "above", "Null", Lcl__Translation=(0.0, 9.0, 0.0)),
        model(4, "mirrored", Lcl__Scaling=(-1.0, 1.0, 1.0)),
        *(N("Material", (number, f"Material::{number}", "")) for number in (8, 9)),
    ]
    values = [float(k == 0) for k in range(3)] * 24
    values[:3] = 0.0, 1.0, 0.0
    normals = layer("LayerElementNormal", "ByPolygonVertex", "Normals", values)
    boxes = [box_geometry(1, *layers), box_geometry(5, normals)]
    links = [(3, 0), (2, 3), (4, 0), (1, 2), (5, 4), (8, 2), (9, 2)]
    return scene([*boxes, *nodes], links, UpAxis=2, UnitScaleFactor=2.54)


def exported() -> ExportedFrame:
    """Return a box with every attribute that exported mesh files hold."""
    mesh, random = box(1), np.random.default_rng(0)
    split, count = split_at_creases(mesh), len(mesh.vertices)
    return ExportedFrame(
        mesh.vertices,
        mesh.faces,
        split.normals,
        split.faces,
        velocities=random.normal(size=(count, 3)),
        rest=mesh.vertices,
        creases=mesh.creases,
        colours=random.random((count, 3)),
        texture=random.random((len(mesh.faces), 3, 2)),
    )


def _npz(**arrays: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def _uneven_ply() -> bytes:
    """Return a pyramid over a square, big-endian, with a property beside the corners."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]], ">f4")
    faces = [[3, 2, 1, 0], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    head = (
        "ply\nformat binary_big_endian 1.0\ncomment a pyramid\nelement vertex 5\nproperty float x\n"
        "property float y\nproperty float z\nelement face 5\nproperty uchar red\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    rows = (b"\x07" + bytes([len(face)]) + np.array(face, ">i4").tobytes() for face in faces)
    return head.encode() + points.tobytes() + b"".join(rows)


def _strips_ply() -> bytes:
    """Return a tetrahedron as one triangle and a strip, which -1 ends."""
    head = (
        "ply\rformat binary_little_endian 1.0\relement vertex 4\rproperty float x\rproperty float y\r"
        "property float z\relement face 1\rproperty list uchar int vertex_indices\relement tristrips 1\r"
        "property list int int vertex_indices\rend_header\r"
    )
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4")
    face, strip = np.array([0, 2, 1], "<i4"), np.array([6, 0, 1, 3, 2, 0, -1], "<i4")
    return head.encode() + points.tobytes() + b"\x03" + face.tobytes() + strip.tobytes()


def _binary_off(ball: trimesh.Trimesh) -> bytes:
    """Return a ball with a homogeneous coordinate, and a colour in each face."""
    counts = np.array([len(ball.vertices), len(ball.faces), 0], ">i4")
    points = np.column_stack([2.0 * ball.vertices, np.full(len(ball.vertices), 2.0)]).astype(">f4")
    faces = np.column_stack([np.full(len(ball.faces), 3), ball.faces, np.ones_like(ball.faces[:, :2])])
    return b"4OFF BINARY\n" + counts.tobytes() + points.tobytes() + faces.astype(">i4").tobytes()


def _vtk(form: str, compressor: str) -> str:
    import base64
    import zlib

    values = np.ones((64, 3), "<f8")
    text = " ".join(f"{value:g}" for value in values.ravel())
    if form == "binary":
        block = zlib.compress(values.tobytes())
        header = np.array([1, values.nbytes, 0, len(block)], "<u4").tobytes()
        text = (base64.b64encode(header) + base64.b64encode(block)).decode()
    return (
        f'<?xml version="1.0"?>\n<VTKFile type="ImageData" byte_order="LittleEndian" {compressor}>\n'
        '<ImageData WholeExtent="0 3 0 3 0 3" Origin="-1 -1 -1" Spacing="1 1 1">\n'
        '<Piece Extent="0 3 0 3 0 3"><PointData Vectors="u">\n'
        f'<DataArray type="Float64" Name="u" NumberOfComponents="3" format="{form}">\n{text}\n'
        "</DataArray></PointData></Piece></ImageData></VTKFile>"
    )


def _rectilinear() -> str:
    axis = '<DataArray type="Float32" format="ascii">0 1 3</DataArray>'
    values = " ".join(["0.5"] * 81)
    return (
        '<VTKFile type="RectilinearGrid"><RectilinearGrid WholeExtent="0 2 0 2 0 2">\n'
        f'<Piece Extent="0 2 0 2 0 2"><Coordinates>\n{axis}\n{axis}\n{axis}\n</Coordinates>\n<PointData>\n'
        f'<DataArray type="Float32" Name="u" NumberOfComponents="3" format="ascii">{values}</DataArray>\n'
        "</PointData></Piece></RectilinearGrid></VTKFile>"
    )


def _stages(folder: Path) -> Iterator[tuple[str, Path]]:
    text = str(folder / "box.usda")
    Sdf.Layer.FindOrOpen(text).Export(str(folder / "box.usdc"))
    UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(text), str(folder / "box.usdz"))
    for name in ("box.usdc", "box.usdz"):
        yield "stage", folder / name


def _pictures(folder: Path) -> Iterator[tuple[str, Path]]:
    random = np.random.default_rng(0)
    for kind, name, compression, height in (
        ("picture", "picture.png", "", 24),
        ("picture", "picture.jpg", "", 24),
        ("picture", "picture.tif", "zip", 24),
        ("picture", "tiles.exr", "zip", 24),
        ("picture", "wavelets.exr", "piz", 24),
        ("sky", "sky.hdr", "", 16),
        ("sky", "sky.exr", "zips", 16),
        ("picture", "layers.exr", "zip", 24),
    ):
        spec = oiio.ImageSpec(32, height, 3, "half" if name.endswith("exr") else "uint8")
        if name == "layers.exr":
            spec.channelnames = ("View.Combined.R", "View.Combined.G", "View.Combined.B")
            spec.attribute("chromaticities", "float[8]", ACESCG.chromaticities)
            spec.x, spec.full_width, spec.full_height = 4, 32, 32
        if name == "picture.jpg":
            profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
            spec.attribute("ICCProfile", f"uint8[{len(profile)}]", np.frombuffer(profile, np.uint8))
            spec.attribute("Orientation", 6)
        if compression:
            spec.attribute("compression", compression)
        if name == "tiles.exr":
            spec.tile_width = spec.tile_height = 16
        output = oiio.ImageOutput.create(str(folder / name))
        output.open(str(folder / name), spec)
        output.write_image(random.random((height, 32, 3), dtype=np.float32))
        output.close()
        yield kind, folder / name


def _sounds(folder: Path) -> Iterator[tuple[str, Path]]:
    noise = np.random.default_rng(0).integers(-9000, 9000, (1, 4800), dtype=np.int16)
    for name, codec in (
        ("a.wav", "pcm_s16le"),
        ("a.flac", "flac"),
        ("a.mp3", "mp3"),
        ("a.m4a", "aac"),
        ("a.ogg", "vorbis"),
    ):
        with av.open(str(folder / name), "w") as container:
            stream = container.add_stream(codec, rate=24000, layout="mono" if codec != "vorbis" else "stereo")
            if codec == "vorbis":
                stream.options = {"strict": "experimental"}
            frame = av.AudioFrame.from_ndarray(noise, format="s16", layout="mono")
            frame.sample_rate = 24000
            resampler = av.AudioResampler(
                format=stream.format.name if stream.format else "s16",
                layout=stream.layout.name,
                rate=24000,
                frame_size=stream.codec_context.frame_size or 0,
            )
            for part in (*resampler.resample(frame), *resampler.resample(None)):
                container.mux(stream.encode(part))
            container.mux(stream.encode(None))
        yield "sound", folder / name
