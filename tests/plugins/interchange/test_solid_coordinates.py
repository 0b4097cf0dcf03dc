"""Solids have texture coordinates of their own: for pictures of a look, and in exports."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from pxr import Usd, UsdGeom

from flowsculpt.pipeline.animation import animate, material_of
from flowsculpt.pipeline.arrays import Floats
from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.mesh.analytic_surfaces import SolidSurface
from flowsculpt.pipeline.plugins.interchange.exported_frame import exported_frame, surface_recipe
from flowsculpt.pipeline.plugins.interchange.model_export import write_glb, write_obj
from flowsculpt.pipeline.shot import Shot, read_shot
from tests.needed_plugins import needs_plugins
from tests.plugins.interchange.test_animated_gltf import Player
from tests.plugins.interchange.test_animation_commands import export
from tests.plugins.interchange.test_model_paint import FLOWS, paint_of, painted_box, picture
from tests.simulated_show import simulated

NAME = "T010_tiny"
SOLIDS = {
    "box": "{solid: box, size: [2, 1.4, 1.2]}",
    "ball": "{solid: icosphere}",
    "torus": "{solid: torus}",
    "rod": "{solid: rod, length: 2.4}",
    "can": "{solid: rod, length: 2, radius: 0.6, caps: flat}",
    "sheet": "{solid: sheet}",
    "lattice": "{solid: lattice}",
}
SHOT = """\
title: Checkered
frames: 1-{last}
subject: {subject}
look: {look}
flows: [{flow}]
resample: {{max_edge_length: {edge}}}
"""
TEXTURED = "{material: clay, colour: grid.png, projection: {kind: model}}"


def text_of(subject: str, flow: str = "twist", look: str = "clay", last: int = 4, edge: float = 0.3) -> str:
    return SHOT.format(subject=subject, flow=f"{{{FLOWS[flow]}}}", look=look, last=last, edge=edge)


def shot_of(
    folder: Path, subject: str, flow: str = "twist", look: str = "clay", last: int = 4, edge: float = 0.3
) -> Shot:
    picture(folder / "grid.png")
    (folder / "a.yaml").write_text(text_of(subject, flow, look, last, edge))
    return read_shot(folder / "a.yaml")


def at_middles(surface: SolidSurface, corners: Floats) -> Floats:
    """The texture coordinates (F, 2) of the points of a surface nearest to the middles of faces (F, 3, 3)."""
    middles = surface(corners.mean(axis=1))
    around = middles[:, None] + 1e-4 * (corners - corners.mean(axis=1, keepdims=True))
    faces = np.arange(3 * len(middles), dtype=np.int32).reshape(-1, 3)
    return surface.texture(around.reshape(-1, 3), faces)[0].mean(axis=1)


@needs_plugins("fields")
@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("solid", SOLIDS)
def test_faces_show_what_the_picture_has_at_their_place_at_rest(
    tmp_path: Path, solid: str, flow: str
) -> None:
    shot = shot_of(tmp_path, SOLIDS[solid], flow, edge=0.15, last=3)
    surface = shot.motion.subject.project
    assert surface is not None
    for frame in animate(shot):
        corners = material_of(frame.mesh)[frame.mesh.faces]
        found = paint_of(shot, frame).coordinates
        error = np.abs(found.mean(axis=1) - at_middles(surface, corners))
        error = np.minimum(error, np.abs(1.0 - error))  # the picture repeats
        if solid in ("ball", "rod"):  # the picture is pinched at the poles
            error = error[(np.hypot(corners[..., 0], corners[..., 2]) > 0.4).all(axis=1)]
        assert len(error) > 30 and error.max() < 1.0 / 255.0


def test_a_seam_is_no_crease_and_costs_no_vertex_of_a_mesh(tmp_path: Path) -> None:
    textured, plain = (shot_of(tmp_path, SOLIDS["ball"], look=look) for look in (TEXTURED, "clay"))
    for one, other in zip(animate(textured), animate(plain), strict=True):
        assert np.array_equal(one.mesh.vertices, other.mesh.vertices) and not len(one.mesh.seams)


def test_copies_and_several_subjects_have_coordinates_of_their_own(tmp_path: Path) -> None:
    copies = "copies: {count: 3, region: {sphere: {radius: 2}}}"
    text = text_of("", last=1).replace(
        "subject: ",
        "subjects:\n"
        f"  balls: {{solid: icosphere, radius: 0.3, {copies}, look: {TEXTURED}}}\n"
        "  box: {solid: box, size: [1, 1, 1], place: [0, 3, 0]}",
    )
    picture(tmp_path / "grid.png")
    (tmp_path / "a.yaml").write_text(text)
    balls, box = read_shot(tmp_path / "a.yaml").subjects
    frame = next(animate(balls))
    texture, rest = exported_frame(balls, frame).texture, material_of(frame.mesh)
    offsets = balls.motion._standing[1].origins
    copy = balls.motion.copy_indices(rest)
    expected, _ = balls.motion.subject.project.texture(rest - offsets[copy], frame.mesh.faces)
    assert texture == pytest.approx(expected)
    assert all(np.ptp(texture[copy[frame.mesh.faces[:, 0]] == k], axis=(0, 1)).min() > 0.9 for k in range(3))
    texture = exported_frame(box, next(animate(box))).texture
    assert texture is not None and np.ptp(texture, axis=(0, 1)) == pytest.approx((1.0, 1.0))


@pytest.mark.parametrize(
    ("subject", "look", "fact"),
    [
        (
            "{cloud: {solid: box}, radius: 0.1}",
            TEXTURED,
            r"needs texture coordinates.* Take a solid, or a model",
        ),
        ("{model: box.obj}", TEXTURED, r"needs texture coordinates of the subject\. Write paint: on there"),
        ("{solid: box}", "model", "look model shows the paint of a model"),
    ],
)
def test_what_has_no_coordinates_is_refused(tmp_path: Path, subject: str, look: str, fact: str) -> None:
    painted_box(tmp_path)
    with pytest.raises(ShotError, match=fact):
        shot_of(tmp_path, subject, look=look)


def test_mesh_files_have_the_coordinates_of_the_subject(tmp_path: Path) -> None:
    shot = shot_of(tmp_path, SOLIDS["rod"])
    *_, frame = animate(shot)
    exported = exported_frame(shot, frame)
    texture, corners = exported.texture, exported.points[exported.faces]
    assert texture is not None and np.ptp(texture[..., 0]) > 0.9

    def rows(places: Floats, coordinates: Floats) -> Floats:
        found = np.concatenate([places, coordinates], axis=2).astype(np.float32).reshape(len(places), -1)
        return found[np.lexsort(np.round(found, 4).T)]

    write_glb(tmp_path / "a.glb", exported, shot.picture.look)
    write_obj(tmp_path / "a.obj", exported)
    for suffix in ("glb", "obj"):
        read = trimesh.load(tmp_path / f"a.{suffix}", force="mesh", process=False)
        assert rows(read.vertices[read.faces], read.visual.uv[read.faces]) == pytest.approx(
            rows(corners, texture), abs=2e-6
        )


def test_a_painted_model_is_exported_with_its_coordinates_whatever_its_look(tmp_path: Path) -> None:
    painted_box(tmp_path)
    shot = shot_of(tmp_path, "{model: box.obj, paint: on}", last=1)
    frame = next(animate(shot))
    assert exported_frame(shot, frame).texture == pytest.approx(paint_of(shot, frame).coordinates)
    plain = shot_of(tmp_path, "{model: box.obj}", last=1)
    assert exported_frame(plain, next(animate(plain))).texture is None
    assert surface_recipe(plain) == [None] and surface_recipe(shot) != [None]


def test_animations_have_the_coordinates_of_the_subject(tmp_path: Path) -> None:
    simulated(tmp_path, text_of(SOLIDS["ball"]))
    export(tmp_path, "gltf", NAME)
    export(tmp_path, "vat", NAME)
    for name in ("models", "vat"):
        player = Player(tmp_path / "renders" / NAME / name / f"{NAME}.glb")
        coordinates = player.values(player.primitive["attributes"]["TEXCOORD_0"])
        assert np.ptp(coordinates, axis=0).min() > 0.95
    for words, file in (
        (("usd", NAME), f"{NAME}.usda"),
        (("usd", NAME, "--one-mesh"), f"{NAME}.one_mesh.usda"),
    ):
        export(tmp_path, *words)
        stage = Usd.Stage.Open(str(tmp_path / "renders" / NAME / "usd" / file))
        sculpture = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(f"/{NAME}/sculpture"))
        st = sculpture.GetPrimvar("st")
        assert st.GetInterpolation() == "faceVarying" and np.ptp(st.Get(3.0), axis=0).min() > 0.95
