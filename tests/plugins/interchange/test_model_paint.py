"""The paint of models follows the flow: texture coordinates, vertex colours and materials."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from flowsculpt.pipeline.animation import MeshFrame, animate, material_of
from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.errors import MeshError, MissingInputError, ShotError
from flowsculpt.pipeline.mesh import TriangleMesh, box
from flowsculpt.pipeline.plugins.interchange.exported_frame import exported_frame
from flowsculpt.pipeline.plugins.interchange.model_paint import ModelPaint
from flowsculpt.pipeline.production.request.shading import Shading
from flowsculpt.pipeline.shot import Shot, read_shot
from flowsculpt.render.base.serialise import to_plain
from flowsculpt.render.scene.materials import Diffuse, Painted, Satin
from flowsculpt.render.scene.painted_faces import PaintedFaces
from flowsculpt.render.scene.surface import Surface
from tests.needed_plugins import needs_plugins
from tests.plugins.interchange.gltf_scenes import GltfScene
from tests.plugins.interchange.test_gltf_files import version_1

SHOT = """\
title: Painted
frames: 1-{last}
subject: {{model: {model}, paint: on}}
look: {look}
flows: [{flow}]
resample: {{max_edge_length: 0.25{more}}}
"""
FLOWS = {
    "twist": "twist: {axis: y, amount: {formula: 40 * frame}}",
    "vortex": "vortex: {axis: y, strength: 9, radius: 0.6}",
    "curl_noise": "curl_noise: {size: 1.1, strength: 1.5, octaves: 1, seed: 3}",
}
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
"""The sides of a box, by its corners: number 4 x + 2 y + z, each coordinate 0 or 1."""


def picture(path: Path, colour: tuple[float, float, float] = (0.2, 0.4, 0.6)) -> Path:
    pixels = oiio.ImageBuf(oiio.ImageSpec(8, 8, 3, "uint8"))
    oiio.ImageBufAlgo.fill(pixels, colour)
    assert pixels.write(str(path))
    return path


def painted_box(folder: Path) -> Path:
    """A box from -1 to 1 with one chart a side: an atlas of six tiles, one above the other."""
    lines = ["mtllib box.mtl"]
    lines += [f"v {x} {y} {z}" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    for k, side in enumerate(SIDES):
        lines += [f"vt {u} {(k + v) / 6}" for u, v in ((0, 0), (1, 0), (1, 1), (0, 1))]
        lines += [f"usemtl {'one' if k < 5 else 'other'}"]
        lines += ["f " + " ".join(f"{corner + 1}/{4 * k + i + 1}" for i, corner in enumerate(side))]
    (folder / "box.obj").write_text("\n".join(lines))
    (folder / "box.mtl").write_text("newmtl one\nmap_Kd atlas.png\nnewmtl other\nKd 1 0 0\nKs 1 1 1\nNs 98\n")
    picture(folder / "atlas.png")
    return folder / "box.obj"


def globe(folder: Path, columns: int = 16, rows: int = 8) -> Path:
    """A ball whose chart meets itself at a meridian."""
    lines = []
    for j in range(rows + 1):
        for i in range(columns + 1):
            a, b = 2 * np.pi * i / columns, np.pi * (j / rows - 0.5)
            lines += [f"v {np.cos(b) * np.sin(a):.9g} {np.sin(b):.9g} {np.cos(b) * np.cos(a):.9g}"]
            lines += [f"vt {i / columns} {j / rows}"]
    for j in range(rows):
        for i in range(columns):
            a = j * (columns + 1) + i + 1
            ring = [a, a + 1, a + columns + 2, a + columns + 1]
            corners = [ring[0], *ring[2:]] if j == 0 else ring[:3] if j == rows - 1 else ring
            lines += ["f " + " ".join(f"{corner}/{corner}" for corner in corners)]
    (folder / "globe.obj").write_text("\n".join(lines))
    return folder / "globe.obj"


def shot_of(model: Path, flow: str = "twist", look: str = "model", last: int = 6, more: str = "") -> Shot:
    text = SHOT.format(model=model.name, flow=f"{{{FLOWS[flow]}}}", look=look, last=last, more=more)
    (model.parent / "a.yaml").write_text(text)
    return read_shot(model.parent / "a.yaml")


def paint_of(shot: Shot, frame: MeshFrame) -> PaintedFaces:
    found = shot.motion.painted(material_of(frame.mesh), frame.mesh.faces)
    assert found is not None
    return found


def on_box(points: AnyArray, faces: AnyArray) -> AnyArray:
    """The texture coordinates (F, 3, 2) that the atlas of the box has on faces at rest."""
    corners = points[faces]
    middle = corners.mean(axis=1)
    axis = np.abs(middle).argmax(axis=1)
    side = 2 * axis + (middle[np.arange(len(middle)), axis] > 0)
    found = np.empty((len(faces), 3, 2))
    ends = 2.0 * np.array([[(k >> 2) & 1, (k >> 1) & 1, k & 1] for k in range(8)]) - 1.0
    for k in range(6):
        origin, right, up = (ends[SIDES[k][i]] for i in (0, 1, 3))
        away = corners[side == k] - origin
        u, v = (away @ (end - origin) / 4.0 for end in (right, up))
        found[side == k] = np.stack([u, (k + v) / 6.0], axis=2)
    return found


@needs_plugins("fields")
@pytest.mark.parametrize("flow", FLOWS)
def test_corners_take_the_texture_coordinates_of_their_place_at_rest(tmp_path: Path, flow: str) -> None:
    shot = shot_of(painted_box(tmp_path), flow)
    for frame in animate(shot):
        paint, rest = paint_of(shot, frame), material_of(frame.mesh)
        assert paint.coordinates == pytest.approx(on_box(rest, frame.mesh.faces), abs=1e-9)
        middle = rest[frame.mesh.faces].mean(axis=1)
        is_other = (np.abs(middle).argmax(axis=1) == 2) & (middle[:, 2] > 0)
        assert np.array_equal(paint.materials == 1, is_other)
    assert len(frame.mesh.vertices) > 300


def split_side() -> tuple[AnyArray, AnyArray, AnyArray]:
    """A square whose left half shows the right half of a texture: points, faces, coordinates (F, 3, 2)."""
    points = np.array([[x, y, 0.0] for y in (-1.0, 1.0) for x in (-1.0, 0.0, 1.0)])
    faces = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
    coordinates = 0.5 * points[faces][..., :2] + 0.5
    coordinates[:2, :, 0] += 0.5
    return points, faces, coordinates


@needs_plugins("fields")
def test_no_face_crosses_a_seam_where_the_surface_is_flat(tmp_path: Path) -> None:
    points, faces, coordinates = split_side()
    lines = [f"v {x} {y} {z}" for x, y, z in points]
    lines += [f"vt {u} {v}" for u, v in coordinates.reshape(-1, 2)]
    for number, face in enumerate(faces):
        lines.append("f " + " ".join(f"{v + 1}/{3 * number + i + 1}" for i, v in enumerate(face)))
    (tmp_path / "side.obj").write_text("\n".join(lines))
    shot = shot_of(tmp_path / "side.obj", "curl_noise", last=12)
    for frame in animate(shot):
        across = material_of(frame.mesh)[frame.mesh.faces][..., 0]
        assert ((across <= 1e-9).all(axis=1) | (across >= -1e-9).all(axis=1)).all()
        assert len(frame.mesh.seams) and not len(frame.mesh.creases)
        assert np.abs(material_of(frame.mesh)[frame.mesh.seams][..., 0]).max() < 1e-9


def test_a_seam_is_shaded_as_the_surface_around_it(tmp_path: Path) -> None:
    shot = shot_of(globe(tmp_path), "vortex", last=4, more=", hard_angle: 80")
    for frame in animate(shot):
        assert len(frame.mesh.seams) > 10
        shading = Shading.of(frame, shot.motion.resampling_at(1).thresholds, 1)
        assert shading.split is not None and len(shading.split.vertices) == len(frame.mesh.vertices)
        known = frame.mesh.attributes["normal"][np.unique(frame.mesh.seams)]
        assert np.linalg.norm(known, axis=1) == pytest.approx(1.0)


def test_a_pole_cuts_no_chart_beyond_its_own_faces(tmp_path: Path) -> None:
    columns, rows = 32, 16
    shot = shot_of(globe(tmp_path, columns, rows))
    meridians, around_poles = 2 * rows, 2 * 2 * columns
    assert len(shot.motion.mesh_at_rest().seams) <= meridians + around_poles


@needs_plugins("fields")
@pytest.mark.parametrize("flow", FLOWS)
def test_a_chart_that_meets_itself_smears_no_face(tmp_path: Path, flow: str) -> None:
    shot = shot_of(globe(tmp_path), flow, more=", hard_angle: 80")
    for frame in animate(shot):
        paint, rest = paint_of(shot, frame), material_of(frame.mesh)
        corners = rest[frame.mesh.faces]
        away_from_poles = (np.hypot(corners[..., 0], corners[..., 2]) > 0.4).all(axis=1)
        size = np.ptp(paint.coordinates[..., 0], axis=1)[away_from_poles]
        assert size.max() < 0.15
        around = np.arctan2(corners[..., 0], corners[..., 2]) / (2 * np.pi)
        error = paint.coordinates[..., 0][away_from_poles] - around[away_from_poles]
        assert np.abs(error - np.round(error)).max() < 0.02


@needs_plugins("fields")
def test_a_resumed_run_keeps_its_seams_to_the_bit(tmp_path: Path) -> None:
    shot = shot_of(painted_box(tmp_path), "curl_noise")
    frames = list(animate(shot))
    stored = MeshFrame.from_arrays(frames[2].to_arrays(), frames[2].number)
    assert np.array_equal(stored.mesh.seams, frames[2].mesh.seams) and len(stored.mesh.seams)
    for resumed, frame in zip(animate(shot, stored), frames[3:], strict=True):
        for name, values in frame.to_arrays().items():
            assert np.array_equal(resumed.to_arrays()[name], values) or name == "report", name


def test_frames_without_seams_are_stored_as_before(tmp_path: Path) -> None:
    shot = shot_of(painted_box(tmp_path))
    plain = (tmp_path / "a.yaml").read_text().replace(", paint: on", "").replace("look: model", "look: clay")
    (tmp_path / "b.yaml").write_text(plain)
    unpainted = read_shot(tmp_path / "b.yaml")
    assert "seams" not in next(animate(unpainted)).to_arrays()
    assert "paint" not in str(unpainted.motion.start_data()) and "paint" in str(shot.motion.start_data())


def test_a_changed_texture_changes_pictures_and_no_mesh(tmp_path: Path) -> None:
    first = shot_of(painted_box(tmp_path))
    picture(tmp_path / "atlas.png", (0.9, 0.4, 0.6))
    second = shot_of(tmp_path / "box.obj")
    assert first.motion.start_data() == second.motion.start_data()
    assert to_plain(first.picture.look) != to_plain(second.picture.look)
    assert {path.name for path, _ in second.files} == {"box.obj", "box.mtl", "atlas.png"}


def test_materials_of_an_obj_are_read(tmp_path: Path) -> None:
    look = shot_of(painted_box(tmp_path)).picture.look
    assert isinstance(look, Painted)
    one, other = look.parts
    assert isinstance(one, Diffuse) and one.colour_texture is not None
    assert isinstance(other, Satin) and other.colour == (1.0, 0.0, 0.0)
    assert other.roughness == pytest.approx((2 / 100) ** 0.25)


def test_roughness_and_metalness_of_an_obj_are_read_and_its_bumps_and_glow_are_not(tmp_path: Path) -> None:
    model = painted_box(tmp_path)
    (tmp_path / "box.mtl").write_text(
        "newmtl one\nKd 1 1 1\nPr 0.3\nPm 0.8\nmap_Bump dents.png\nmap_Ks shine.png\n"
        "Ke 1 1 1\nnewmtl other\nKd 1 0 0\n"
    )
    look = shot_of(model).picture.look
    assert isinstance(look, Painted)
    one, other = look.parts
    assert isinstance(one, Satin) and (one.roughness, one.metallic) == (0.3, 0.8)
    assert isinstance(other, Diffuse)


def test_a_normal_map_of_an_obj_is_read_with_its_strength(tmp_path: Path) -> None:
    model = painted_box(tmp_path)
    dents = picture(tmp_path / "dents.png", (1.0, 0.6, 0.8))
    (tmp_path / "box.mtl").write_text(
        "newmtl one\nnorm -bm 0.5 dents.png\nnewmtl other\nPr 0.3\nnorm dents.png\n"
    )
    shot = shot_of(model)
    look = shot.picture.look
    assert isinstance(look, Painted)
    one, other = (part.normal_texture for part in look.parts)
    assert one is not None and one.normals()[0, 0] == pytest.approx((0.5, 0.1, 0.6), abs=4e-3)
    assert other is not None and other.normals()[0, 0] == pytest.approx((1.0, 0.2, 0.6), abs=4e-3)
    assert dents in (path for path, _ in shot.files)
    picture(dents, (0.0, 0.6, 0.8))
    assert to_plain(shot_of(model).picture.look) != to_plain(look)
    dents.unlink()
    with pytest.raises(MissingInputError, match=r"names its texture dents\.png"):
        shot_of(model)


def test_vertex_colours_of_an_obj_are_srgb(tmp_path: Path) -> None:
    lines = [f"v {x} {y} {z} 0.5 0.5 1" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    lines += ["f " + " ".join(str(corner + 1) for corner in side) for side in SIDES]
    (tmp_path / "box.obj").write_text("\n".join(lines))
    shot = shot_of(tmp_path / "box.obj", last=1)
    colours = paint_of(shot, next(animate(shot))).colours
    assert colours is not None
    assert colours == pytest.approx(np.broadcast_to([0.21404, 0.21404, 1.0], colours.shape), abs=1e-4)


def test_pictures_lie_beside_the_materials_that_name_them(tmp_path: Path) -> None:
    model = painted_box(tmp_path)
    (tmp_path / "parts").mkdir()
    for name in ("box.mtl", "atlas.png"):
        (tmp_path / name).rename(tmp_path / "parts" / name)
    model.write_text(model.read_text().replace("mtllib box.mtl", "mtllib parts/box.mtl"))
    assert {path.name for path, _ in shot_of(model).files} == {"box.obj", "box.mtl", "atlas.png"}


def test_a_texture_of_a_look_takes_the_texture_coordinates_of_the_model(tmp_path: Path) -> None:
    model = painted_box(tmp_path)
    shot = shot_of(model, look="{material: clay, colour: atlas.png, projection: {kind: model}}", last=1)
    frame = next(animate(shot))
    exported = exported_frame(shot, frame)
    assert exported.texture == pytest.approx(on_box(material_of(frame.mesh), frame.mesh.faces))


def test_exports_have_the_texture_coordinates_and_the_colours_of_the_model(tmp_path: Path) -> None:
    shot = shot_of(painted_box(tmp_path), last=1)
    frame = next(animate(shot))
    exported = exported_frame(shot, frame)
    assert exported.texture == pytest.approx(on_box(material_of(frame.mesh), frame.mesh.faces))
    assert exported.colours is not None
    assert np.isclose(exported.colours, (1.0, 0.0, 0.0), atol=0.01).all(axis=1).any()


def test_copies_are_painted_alike(tmp_path: Path) -> None:
    painted_box(tmp_path)
    entry = "{model: box.obj, scale: 0.2, paint: on, copies: {count: 3, region: {sphere: {radius: 2}}}}"
    text = SHOT.format(model="box.obj", flow="{twist: {axis: y, amount: 9}}", look="model", last=1, more="")
    text = text.replace("subject: {model: box.obj, paint: on}", f"subjects: {{boxes: {entry}}}")
    (tmp_path / "a.yaml").write_text(text.replace("0.25", "0.1"))
    (part,) = read_shot(tmp_path / "a.yaml").subjects
    frame = next(animate(part))
    offsets = part.motion._standing[1].origins[part.motion.copy_indices(material_of(frame.mesh))]
    expected = on_box((material_of(frame.mesh) - offsets) / 0.2, frame.mesh.faces)
    assert paint_of(part, frame).coordinates == pytest.approx(expected, abs=1e-6)


def gltf_box(folder: Path, **material: Any) -> GltfScene:
    """The scene of one square with texture coordinates, down as in glTF, and a material."""
    points, faces, coordinates = split_side()
    mesh = TriangleMesh(points[faces].reshape(-1, 3), np.arange(12).reshape(-1, 3))
    scene = GltfScene()
    attributes = {
        "POSITION": scene.accessor(mesh.vertices),
        "TEXCOORD_0": scene.accessor(coordinates.reshape(-1, 2) * (1, -1) + (0, 1)),
    }
    indices = scene.accessor(mesh.faces.reshape(-1).astype(np.uint32))
    scene.node(mesh=scene.mesh({"attributes": attributes, "indices": indices, "material": 0}))
    scene.json["materials"] = [material]
    scene.json["textures"] = [{"source": 0}]
    content = picture(folder / "inside.png").read_bytes()
    scene.json["images"] = [{"bufferView": scene.view(content), "mimeType": "image/png"}]
    (folder / "inside.png").unlink()
    return scene


def test_a_picture_within_a_gltf_file_is_read(tmp_path: Path) -> None:
    surface = {
        "baseColorTexture": {"index": 0},
        "baseColorFactor": [0.5, 1, 1, 1],
        "metallicRoughnessTexture": {"index": 0},
        "roughnessFactor": 0.5,
    }
    model = gltf_box(tmp_path, pbrMetallicRoughness=surface).glb(tmp_path / "side.glb")
    shot = shot_of(model, last=1)
    frame, look = next(animate(shot)), shot.picture.look
    assert isinstance(look, Painted) and isinstance(look.parts[0], Satin)
    (part,) = look.parts
    assert part.colour_texture is not None and part.roughness_texture is not None
    linear = ((0.2 + 0.055) / 1.055) ** 2.4
    assert part.colour_texture.pixels()[0, 0, 0] == pytest.approx(0.5 * linear, abs=2e-3)
    assert part.roughness_texture.numbers()[0, 0, 0] == pytest.approx(0.2, abs=2e-3)  # 0.5 of green
    assert part.metallic_texture is not None
    assert part.metallic_texture.numbers()[0, 0, 0] == pytest.approx(0.6, abs=2e-3)
    rest = material_of(frame.mesh)[frame.mesh.faces]
    expected = 0.5 * rest[..., :2] + 0.5
    expected[(rest[..., 0].mean(axis=1) < 0), :, 0] += 0.5
    assert paint_of(shot, frame).coordinates == pytest.approx(expected, abs=1e-6)


def test_a_damaged_copy_of_a_picture_in_the_cache_is_written_again(tmp_path: Path) -> None:
    model = gltf_box(tmp_path, pbrMetallicRoughness={"baseColorTexture": {"index": 0}}).glb(
        tmp_path / "a.glb"
    )
    cached, whole = Path(), b""
    for damage in (lambda content: content, lambda content: content[:-20], lambda content: b""):
        look = shot_of(model, last=1).picture.look
        assert isinstance(look, Painted) and isinstance(look.parts[0], Satin)
        texture = look.parts[0].colour_texture
        assert texture is not None
        cached = Path(texture.path)
        whole = whole or cached.read_bytes()
        assert cached.read_bytes() == whole
        cached.write_bytes(damage(whole))


def test_a_normal_map_of_a_gltf_file_is_read_with_its_scale(tmp_path: Path) -> None:
    model = gltf_box(tmp_path, normalTexture={"index": 0, "scale": -2}).glb(tmp_path / "side.glb")
    shot = shot_of(model, last=1)
    look = shot.picture.look
    assert isinstance(look, Painted) and look.parts[0].normal_texture is not None
    found = look.parts[0].normal_texture.normals()
    assert found[0, 0] == pytest.approx((1.2, 0.4, 0.2), abs=2e-2)
    plain = shot_of(gltf_box(tmp_path).glb(tmp_path / "plain.glb"), last=1)
    assert "normal_texture" not in str(to_plain(plain.picture.look))


def test_vertex_colours_of_a_gltf_file_are_linear_and_multiply_its_factor(tmp_path: Path) -> None:
    scene = gltf_box(tmp_path, pbrMetallicRoughness={"baseColorFactor": [0.5, 0.5, 1, 1]})
    primitive = scene.json["meshes"][0]["primitives"][0]
    primitive["attributes"]["COLOR_0"] = scene.accessor(np.tile([0.4, 0.2, 1.0], (12, 1)))
    shot = shot_of(scene.glb(tmp_path / "side.glb"), last=1)
    frame = next(animate(shot))
    paint = paint_of(shot, frame)
    assert paint.colours is not None
    assert paint.colours == pytest.approx(np.broadcast_to([0.2, 0.1, 1.0], paint.colours.shape))
    flat = np.zeros_like(frame.mesh.vertices, np.float32)
    surface = Surface(flat, flat, frame.mesh.faces, rest=flat, paint=paint)
    found = shot.picture.look.vertex_colours(surface)
    assert found == pytest.approx(np.broadcast_to([0.2, 0.1, 1.0], flat.shape))


def test_a_transformed_texture_is_where_the_extension_puts_it(tmp_path: Path) -> None:
    transform = {"KHR_texture_transform": {"offset": [0.25, 0.0], "scale": [0.5, 1.0]}}
    surface = {"baseColorTexture": {"index": 0, "extensions": transform}}
    shot = shot_of(gltf_box(tmp_path, pbrMetallicRoughness=surface).glb(tmp_path / "side.glb"), last=1)
    frame = next(animate(shot))
    rest = material_of(frame.mesh)[frame.mesh.faces]
    right = 0.5 * rest[..., 0] + 0.5 + 0.5 * (rest[..., 0].mean(axis=1) < 0)[:, None]
    assert paint_of(shot, frame).coordinates[..., 0] == pytest.approx(0.5 * right + 0.25, abs=1e-6)


def test_maps_of_light_and_opacity_of_a_gltf_file_change_nothing(tmp_path: Path) -> None:
    surface = {"baseColorTexture": {"index": 0}}
    plain = gltf_box(tmp_path, pbrMetallicRoughness=surface).glb(tmp_path / "side.glb")
    look = to_plain(shot_of(plain).picture.look)
    maps = {name: {"index": 0} for name in ("occlusionTexture", "emissiveTexture")}
    coated = {"KHR_materials_clearcoat": {"clearcoatFactor": 1}}
    more = gltf_box(tmp_path, pbrMetallicRoughness=surface, **maps, alphaMode="BLEND", extensions=coated)
    assert re.sub(r"'digest': '\w+'", "", str(to_plain(shot_of(more.glb(plain)).picture.look))) == re.sub(
        r"'digest': '\w+'", "", str(look)
    )


def test_paint_of_gltf_1_is_refused(tmp_path: Path) -> None:
    with pytest.raises((ShotError, MeshError), match=r"old.glb: .*glTF 1\.0, whose paint is not read"):
        shot_of(version_1(tmp_path / "old.glb"))


@pytest.mark.parametrize(
    ("surface", "fact"),
    [
        (
            {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0, "texCoord": 1}},
            "different texture coordinates",
        ),
        ({"baseColorTexture": {"index": 3}}, "names texture 3; there are 1"),
        ({"normalTexture": {"index": 0, "scale": "strong"}}, "scale of normalTexture.* must be finite"),
        (
            {"baseColorTexture": {"index": 0}, "normalTexture": {"index": 0, "texCoord": 1}},
            "different texture coordinates",
        ),
    ],
)
def test_what_is_not_read_of_a_gltf_file_is_refused(
    tmp_path: Path, surface: dict[str, Any], fact: str
) -> None:
    material = {name: surface.pop(name) for name in ("normalTexture",) if name in surface}
    model = gltf_box(tmp_path, pbrMetallicRoughness=surface, **material).glb(tmp_path / "side.glb")
    with pytest.raises((ShotError, MeshError), match=f"side.glb: .*{fact}"):
        shot_of(model)


def test_a_missing_file_is_named_with_its_remedy(tmp_path: Path) -> None:
    model = painted_box(tmp_path)
    (tmp_path / "atlas.png").unlink()
    with pytest.raises(MissingInputError, match=r"a\.yaml:3:\d+: .*names its texture atlas\.png.*Copy it"):
        shot_of(model)
    (tmp_path / "box.mtl").unlink()
    with pytest.raises(MissingInputError, match=r"a\.yaml:3:\d+: .*names its materials box\.mtl"):
        shot_of(model)


def test_a_path_of_another_machine_finds_the_picture_beside_the_model(tmp_path: Path) -> None:
    model = painted_box(tmp_path)
    library = (tmp_path / "box.mtl").read_text()
    (tmp_path / "box.mtl").write_text(library.replace("atlas.png", "-clamp on C:\\work\\atlas.png"))
    look = shot_of(model).picture.look
    assert isinstance(look, Painted) and look.parts[0].colour_texture is not None
    digest = hashlib.sha256((tmp_path / "atlas.png").read_bytes()).hexdigest()
    assert look.parts[0].colour_texture.digest == digest


def test_a_moved_texture_of_an_obj_is_refused(tmp_path: Path) -> None:
    model = painted_box(tmp_path)
    library = (tmp_path / "box.mtl").read_text()
    (tmp_path / "box.mtl").write_text(library.replace("atlas.png", "-s 2 2 1 atlas.png"))
    with pytest.raises(ShotError, match="option -s"):
        shot_of(model)


@pytest.mark.parametrize(
    ("old", "new", "fact"),
    [
        (", paint: on", "", "4:.*look model shows the paint of a model"),
        ("box.obj", "box.stl", "3:.*paint is read from"),
        ("look: model", "look: {material: model, roughness: 0.3}", "leave roughness out"),
        (
            "look: model",
            "look: {material: clay, colour: atlas.png, projection: {kind: model, turn: 9}}",
            "turn, which model does not use",
        ),
    ],
)
def test_what_shows_no_paint_is_refused(tmp_path: Path, old: str, new: str, fact: str) -> None:
    painted_box(tmp_path)
    (tmp_path / "box.stl").write_bytes(b"solid a\nendsolid a\n")
    shot_of(tmp_path / "box.obj")
    (tmp_path / "a.yaml").write_text((tmp_path / "a.yaml").read_text().replace(old, new))
    with pytest.raises(ShotError, match=fact):
        read_shot(tmp_path / "a.yaml")


def test_every_position_of_a_chart_is_painted_in_one_way() -> None:
    random = np.random.default_rng(5)
    mesh = box(2.0, 0.5)
    coordinates = random.choice([0.0, 0.25, 0.5], (len(mesh.faces), 3, 2)).reshape(-1, 2)
    count = len(mesh.faces)
    paint = ModelPaint.of(
        mesh.vertices, np.full(count, 3), mesh.faces.reshape(-1), coordinates, np.arange(count) % 2
    )
    rows = np.column_stack([np.repeat(paint.charts, 3), paint.corners.reshape(-1)])
    both = np.column_stack([rows, paint.coordinates.reshape(-1, 2)])
    assert len(np.unique(rows, axis=0)) == len(np.unique(both, axis=0))
    of_charts = np.unique(np.column_stack([paint.charts, paint.materials]), axis=0)
    assert len(np.unique(of_charts[:, 0])) == len(of_charts)


def test_a_new_shot_of_a_painted_model_shows_its_paint(tmp_path: Path) -> None:
    from flowsculpt.pipeline.plugins.authoring.shot_templates import model_template, shot_of_flow

    model = painted_box(tmp_path)
    assert ", paint: on}" in (text := shot_of_flow("twist", "A", model_template(model, "box.obj")))
    assert re.search("\nlook: model +# or {material: clay", text)
    copied = model_template(model, "models/box.obj", is_copy=True)  # of the file alone, without its pictures
    assert "paint" not in copied.subject and copied.look is None
    (tmp_path / "atlas.png").unlink()
    assert "paint" not in model_template(model, "box.obj").subject
