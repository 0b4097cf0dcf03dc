"""Every file that is opened for a shot decides its keys; Linux says which are opened in any process."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from _pytest.mark import ParameterSet
from pxr import Usd, UsdGeom, UsdUtils

from flowsculpt.pipeline.mesh import box
from flowsculpt.pipeline.mesh.read import ModelFile, mesh_suffixes
from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.shot import Shot, read_shot
from flowsculpt.render.post.colour import view_exactly
from tests.needed_plugins import missing, needs_plugins
from tests.opened_files import opened_below
from tests.plugins.interchange.fbx_writer import N, binary, box_geometry, model, scene
from tests.plugins.interchange.gltf_scenes import box_scene
from tests.plugins.interchange.test_collada_files import document
from tests.plugins.interchange.test_model_paint import painted_box as paint_of_box
from tests.plugins.interchange.test_moving_files import BOX, alembic_mesh, archive
from tests.plugins.interchange.test_threemf_files import corner, model_part, package
from tests.sounds import sine, write_sound

Maker = Callable[[Path, float], object]
"""Writes a file, and those that it names, with another content for each size."""


def _marked(names: Iterable[str], quick: Iterable[str]) -> list[ParameterSet]:
    """Return parameters for tests; those that are not quick are tried in the long tests."""
    return [pytest.param(name, marks=() if name in quick else pytest.mark.soak) for name in sorted(names)]


def _mesh(path: Path, size: float) -> None:
    write_mesh(box(size), path)


def _gltf(path: Path, size: float) -> None:
    scene = box_scene(box(size))
    scene.json["images"] = [{"uri": "not_opened.png"}]
    scene.json["asset"]["generator"] = f"a test of size {size}"
    scene.gltf(path, "parts%20of/it.bin", "parts of/it.bin")


def _stage(path: Path, size: float) -> None:
    layer = path.with_name("layer.usda")
    stage = Usd.Stage.CreateInMemory()
    mesh = UsdGeom.Mesh.Define(stage, "/box")
    mesh.CreatePointsAttr(box(size).vertices.tolist())
    mesh.CreateFaceVertexCountsAttr([3] * 12)
    mesh.CreateFaceVertexIndicesAttr(box().faces.reshape(-1).tolist())
    stage.Export(str(layer))
    root = path if path.suffix != ".usdz" else path.with_suffix(".usda")
    root.unlink(missing_ok=True)
    whole = Usd.Stage.CreateNew(str(root))
    whole.GetRootLayer().subLayerPaths.append("./layer.usda")
    whole.GetRootLayer().documentation = f"a test of size {size}"
    whole.Save()
    if root != path:
        UsdUtils.CreateNewUsdzPackage(str(root), str(path))


def _fbx(path: Path, size: float) -> None:
    video = N("Video", (9, "Video::", "Clip"), [N("Filename", ("not_opened.png",))])
    nodes = [box_geometry(1), model(2, "box", Lcl__Scaling=(size, size, size)), video]
    path.write_bytes(binary(scene(nodes, [(2, 0), (1, 2)])))


def _collada(path: Path, size: float) -> None:
    images = "<library_images><image><init_from>not_opened.png</init_from></image></library_images>"
    scaled = f'<node><scale>{size} {size} {size}</scale><instance_geometry url="#box"/></node>'
    path.write_text(document(nodes=scaled, more=images))


def _package(path: Path, size: float) -> None:
    placed = f'<item objectid="1" transform="{size} 0 0 0 {size} 0 0 0 {size} 0 0 0"/>'
    package(path, a=model_part(corner(1), placed))


def _archive(path: Path, size: float) -> None:
    alembic_mesh(archive(path).getTop(), "box", 24.0, [BOX.vertices * size])


def _vtk(path: Path, size: float) -> None:
    """Write a tetrahedron as VTK's XML."""
    kind, section = {"vtp": ("PolyData", "Polys"), "vtu": ("UnstructuredGrid", "Cells")}[path.suffix[1:]]
    rows = {"vtp": "0 2 1 0 1 3 1 2 3 2 0 3", "vtu": "0 1 2 3"}[path.suffix[1:]]
    ends = {"vtp": "3 6 9 12", "vtu": "4"}[path.suffix[1:]]
    more = '<DataArray type="UInt8" Name="types" format="ascii">10</DataArray>'
    counts = 'NumberOfPolys="4" NumberOfCells="1"'
    path.write_text(
        f'<VTKFile type="{kind}"><{kind}><Piece NumberOfPoints="4" {counts}><Points>'
        f'<DataArray type="Float64" format="ascii">0 0 0 {size} 0 0 0 1 0 0 0 1</DataArray></Points>'
        f'<{section}><DataArray type="Int64" Name="connectivity" format="ascii">{rows}</DataArray>'
        f'<DataArray type="Int64" Name="offsets" format="ascii">{ends}</DataArray>{more}</{section}>'
        f"</Piece></{kind}></VTKFile>"
    )


def _vtk_of_files(path: Path, size: float) -> None:
    """Write a file that names another one of VTK."""
    suffix = {"pvtp": "vtp", "pvtu": "vtu", "pvd": "vtp"}[path.suffix[1:]]
    _vtk(path.with_name(f"part.{suffix}"), size)
    named = f'<Pieces><Piece Source="part.{suffix}"/></Pieces>'
    if path.suffix == ".pvd":
        named = f'<Collection><DataSet timestep="0" file="part.{suffix}"/></Collection>'
    path.write_text(f"<VTKFile><!-- {size} -->{named}</VTKFile>")


MODELS: Mapping[str, Maker] = {
    **dict.fromkeys(("obj", "ply", "stl", "off", "glb"), _mesh),
    "gltf": _gltf,
    "fbx": _fbx,
    "dae": _collada,
    "3mf": _package,
    "abc": _archive,
    **dict.fromkeys(("usd", "usda", "usdc", "usdz"), _stage),
    **({} if missing("fields") else dict.fromkeys(("vtp", "vtu"), _vtk)),
    **({} if missing("fields") else dict.fromkeys(("pvtp", "pvtu", "pvd"), _vtk_of_files)),
}
"""How a sample of each format is written: a new reader needs one here."""


def test_every_format_of_models_is_watched() -> None:
    assert set(MODELS) == set(mesh_suffixes())


@pytest.mark.parametrize("suffix", _marked(MODELS, MODELS.keys() - {"usd", "usdc"}))
def test_every_file_that_a_reader_opens_decides_the_digest_of_its_model(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"model.{suffix}"
    MODELS[suffix](path, 1.0)
    first = ModelFile(path).files()
    with opened_below(tmp_path) as opened:
        ModelFile(path).surface()
    assert opened == {file.resolve() for file, _ in first.files}
    before = {file: file.read_bytes() for file in opened}
    MODELS[suffix](path, 2.0)
    after = {file: content for file in opened if (content := file.read_bytes()) != before[file]}
    assert after
    for file, content in after.items():
        for other, old in before.items():
            other.write_bytes(content if other == file else old)
        assert ModelFile(path).files().digest != first.digest, file
    file.write_bytes(before[file])
    assert ModelFile(path).files().digest == first.digest


def test_every_file_that_paint_is_read_from_decides_the_keys_of_its_shot(tmp_path: Path) -> None:
    paint_of_box(tmp_path)
    text = (
        "title: A\nframes: 1-2\nsubject: {model: box.obj, paint: on}\nlook: model\nflows: []\nresample: off\n"
    )
    (tmp_path / "a.yaml").write_text(text)
    with opened_below(tmp_path) as opened:
        shot = read_shot(tmp_path / "a.yaml")
        mesh = shot.motion.mesh_at_rest()
        shot.motion.painted(mesh.vertices, mesh.faces)
    assert opened - {tmp_path / "a.yaml"} == {path for path, _ in shot.files}
    assert len(shot.files) == 3


SHOT = """\
extends: base
title: Everything
frames: 1-3
subjects:
  statue:
    model: models/statue.gltf
    look:
      material: glaze
      colour: {file: paint.png, space: srgb}
      roughness: wear.png
  bronze:
    model: models/bronze.usda
    look: {bsdf: {type: principled, base_color: {type: bitmap, filename: bronze.png}}}
  stars: {cloud: stars.ply, radius: size}
  sail: {net: sail.npz}
flows:
  - attraction: {mesh: magnet.gltf, rate: 2, radius: 5}
  - twist: {axis: y, amount: {audio: pulse.wav, gain: 10}}
  - within: {region: {mesh: zone.glb}, flows: [{twist: {axis: y, amount: {keys: {1: 0, 3: 9}}}}]}
  - sampled: {file: "wind_*.npz", outside: zero}
  - sampled: {file: gusts.npz, outside: zero}
  - python: {file: mine.py, function: move, reads: [shift.npy]}
resample: {max_edge_length: 0.5}
lights: {hdri: sky.exr}
sound: {file: song.wav}
view: {config: ocio/studio.ocio, space: LINEAR}
"""


def _stars(path: Path, size: float) -> None:
    rows = "0 0 0 {0}\n1 0 0 {0}\n".format(0.1 * size)
    header = "ply\nformat ascii 1.0\nelement vertex 2\n"
    properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "size"))
    path.write_text(f"{header}{properties}end_header\n{rows}")


def _sail(path: Path, size: float) -> None:
    rows, columns = np.meshgrid(np.arange(5.0), np.arange(4.0), indexing="ij")
    np.savez(path, points=size * np.stack([rows, columns, 0 * rows], axis=2))


def _wind(path: Path, size: float) -> None:
    axis = np.array([-9.0, 9.0])
    np.savez(path, x=axis, y=axis, z=axis, velocity=np.full((2, 2, 2, 3), 0.1 * size))


def _picture(path: Path, size: float) -> None:
    pixels = oiio.ImageBuf(oiio.ImageSpec(4, 2, 3, "half" if path.suffix == ".exr" else "uint8"))
    oiio.ImageBufAlgo.fill(pixels, (0.2 * size, 0.3, 0.4))
    assert pixels.write(str(path))


def _tone(path: Path, size: float) -> None:
    write_sound(path, sine(440.0, 0.1 * size))


CONFIG = """\
ocio_profile_version: 2
environment: {SHOW: tables}
search_path: [../elsewhere, $SHOW]
roles: {default: LINEAR, scene_linear: LINEAR}
displays:
  wall:
    - !<View> {name: Graded, colorspace: graded}
colorspaces:
  - !<ColorSpace> {name: LINEAR}
  - !<ColorSpace>
    name: graded
    from_scene_reference: !<GroupTransform>
      children:
        - !<FileTransform> {src: far.spi1d, interpolation: linear}
        - !<FileTransform> {src: near.ctf}
"""
TABLE = "Version 1\nFrom 0.0 1.0\nLength 2\nComponents 1\n{{\n0.0\n{}\n}}\n"


def _python(path: Path, size: float) -> None:
    shift = str(path.with_name("shift.npy"))
    path.write_text(
        f"import numpy as np\ndef move(p, t, dt):\n    return p + {size} * dt * np.load({shift!r})\n"
    )


TRANSFORM = """\
<?xml version="1.0" encoding="UTF-8"?>
<ProcessList id="a" version="1.7">
  <Matrix inBitDepth="32f" outBitDepth="32f">
    <Array dim="3 3">{0} 0 0 0 {0} 0 0 0 {0}</Array>
  </Matrix>
</ProcessList>
"""


def _text(content: str) -> Maker:
    return lambda path, size: path.write_text(content.format(size))


def _written_by_another(path: Path, size: float) -> None:
    """Leave a file as the maker of the file that names it wrote it."""


SHOW: Mapping[str, tuple[Maker, set[str]]] = {
    "a.yaml": (lambda path, size: path.write_text(SHOT), set()),
    "base.yaml": (_text("camera: {{azimuth: {0}}}\n"), set()),
    "defaults.yaml": (_text("intent: show {0}\n"), set()),
    "models/statue.gltf": (_gltf, {"meshes"}),
    "models/parts of/it.bin": (_written_by_another, {"meshes"}),
    "models/bronze.usda": (_stage, {"meshes"}),
    "models/layer.usda": (_written_by_another, {"meshes"}),
    "stars.ply": (_stars, {"meshes"}),
    "sail.npz": (_sail, {"meshes"}),
    "magnet.gltf": (_gltf, set()),
    "parts of/it.bin": (_written_by_another, {"meshes"}),
    "zone.glb": (_mesh, {"meshes"}),
    "wind_1.npz": (_wind, {"meshes"}),
    "wind_2.npz": (_wind, {"meshes"}),
    "gusts.npz": (_wind, {"meshes"}),
    "mine.py": (_python, {"meshes"}),
    "shift.npy": (lambda path, size: np.save(path, size * np.ones(3)), {"meshes"}),
    "paint.png": (_picture, {"look"}),
    "wear.png": (_picture, {"look"}),
    "bronze.png": (_picture, {"look"}),
    "sky.exr": (_picture, {"look"}),
    "pulse.wav": (_tone, {"meshes"}),
    "song.wav": (_tone, {"movie"}),
    "ocio/studio.ocio": (lambda path, size: path.write_text(f"{CONFIG}# {size}\n"), {"movie"}),
    "ocio/tables/near.ctf": (_text(TRANSFORM), {"movie"}),
    "elsewhere/far.spi1d": (_text(TABLE), {"movie"}),
}
"""The files of a show, how each is written, and which keys rest on its content.

Meshes that attract or bound act by their shape, whatever else stands in their file.
"""

QUICK = ("models/parts of/it.bin", "parts of/it.bin", "shift.npy", "elsewhere/far.spi1d")
"""Files whose changes are tried in every run of the tests; the others take as long each."""


@pytest.fixture
def show(tmp_path: Path) -> Path:
    for name, (make, _) in SHOW.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        make(tmp_path / name, 1.0)
    return tmp_path


def _keys(show: Path) -> dict[str, object]:
    request = Project(show, 2, allow_code=True).request(show / "a.yaml", "draft", variant="none")
    return {
        "meshes": request.keys.mesh(3),
        "look": request.keys.appearance(1),
        "movie": request.keys.movie(["a frame"]),
    }


def _use(shot: Shot) -> None:
    """Open what simulating and drawing a shot opens."""
    for part in shot.parts:
        mesh = part.motion.subject.build(0.5)
        part.motion.flow.displace(mesh.vertices, 0.0, 0.04)
    view_exactly(np.full((1, 1, 3), 0.5, np.float32), view=shot.picture.view)


@needs_plugins("fields", "points", "python")
def test_every_file_that_a_shot_opens_is_among_those_that_it_reports(show: Path) -> None:
    with opened_below(show) as opened:
        request = Project(show, 2, allow_code=True).request(show / "a.yaml", "draft", variant="none")
        _use(request.shot)
    assert opened == {show / name for name in SHOW}
    reported = {path.resolve() for path, _ in request.shot.files}
    assert opened - reported == {show / "a.yaml", *(show / name for name, _ in request.source.beside)}


@needs_plugins("fields", "points", "python")
@pytest.mark.parametrize("name", _marked(SHOW.keys() - {"a.yaml"}, QUICK))
def test_a_change_of_a_file_moves_the_keys_that_rest_on_it(show: Path, name: str) -> None:
    first, before = _keys(show), {other: (show / other).read_bytes() for other in SHOW}
    for other, (make, _) in SHOW.items():
        make(show / other, 2.0)
    assert (show / name).read_bytes() != before[name]
    for other in SHOW.keys() - {name}:
        (show / other).write_bytes(before[other])
    now = _keys(show)
    assert {key for key in first if now[key] != first[key]} == SHOW[name][1]
