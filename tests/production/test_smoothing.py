"""A shot's smoothing changes the rendered surface, and no stage before it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.mesh.normals import split_at_creases, tessellate
from flowsculpt.pipeline.mesh.solids import icosphere
from flowsculpt.pipeline.production.request.framing import Framing
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shading import pieces_for
from flowsculpt.pipeline.production.request.shot_source import ShotSource
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import Quality
from flowsculpt.render.scene.scene_stage import StagePlacement

TINY = """\
title: A box, twisted
frames: 1-6
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.5}
"""


def take_of(text: str) -> RenderRequest:
    source = ShotSource(text, Path("T010_tiny.yaml"))
    return RenderRequest(source, quality_name="draft", variant="none", requested=(1,))


def test_patches_change_the_picture_and_no_mesh() -> None:
    plain, smooth = take_of(TINY), take_of(TINY + "smooth: {tessellate: 3}\n")
    assert plain.shot.picture.tessellate == 1 and smooth.shot.picture.tessellate == 3
    assert plain.keys.mesh(3) == smooth.keys.mesh(3)
    assert plain.keys.normals(3) != smooth.keys.normals(3)


def test_a_number_of_pieces_that_cannot_be_is_told_with_its_place() -> None:
    with pytest.raises(ShotError, match=r"T010_tiny\.yaml:5:10: smooth.tessellate: 99 is"):
        read_shot("T010_tiny.yaml", TINY + "smooth: {tessellate: 99}\n")


def test_rendered_surfaces_are_cut_into_the_pieces_asked_for(project) -> None:
    project.shot.write_text(TINY + "smooth: {tessellate: 2}\n")
    project.render("1")
    home = project.path / "renders" / "T010_tiny"
    with np.load(home / "meshes" / "T010_tiny.0001.npz") as mesh:
        faces = len(mesh["faces"])
        assert {"creases", "attribute:rest", "attribute:normal"} <= set(mesh.files)
    with np.load(home / "normals" / "T010_tiny.0001.npz") as normals:
        assert len(normals["faces"]) == 4 * faces
        np.testing.assert_allclose(np.linalg.norm(normals["normals"], axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize(("written", "pixels"), [("2px", 2.0), ("1.5", 1.5), ("' .5 px'", 0.5)])
def test_dicing_is_said_in_pixels(written: str, pixels: float) -> None:
    shot = read_shot("T010_tiny.yaml", TINY + f"smooth: {{dicing: {written}}}\n")
    assert (shot.picture.dicing, shot.picture.tessellate) == (pixels, 1)


@pytest.mark.parametrize(
    ("written", "told"),
    [
        ("dicing: 2em", "5:10: smooth.dicing: '2em' is not a length"),
        ("dicing: 0px", "5:10: smooth.dicing: 0px is out of range; it must be at least 0.25"),
        ("dicing: 2px, tessellate: 2", "5:1: smooth has both tessellate"),
    ],
)
def test_dicing_that_cannot_be_is_told_with_its_place(written: str, told: str) -> None:
    with pytest.raises(ShotError, match=told):
        read_shot("T010_tiny.yaml", TINY + f"smooth: {{{written}}}\n")


def test_dicing_changes_the_picture_and_neither_mesh_nor_normals_nor_cameras() -> None:
    plain, diced = take_of(TINY), take_of(TINY + "smooth: {dicing: 2px}\n")
    assert plain.keys.mesh(1) == diced.keys.mesh(1) and plain.keys.normals(1) == diced.keys.normals(1)
    assert plain.keys.cameras == diced.keys.cameras
    framings = {n: Framing(Camera((0, 1, 6), (0, 1, 0)), StagePlacement()) for n in plain.angles}
    other = take_of(TINY + "smooth: {dicing: 3px}\n")
    assert len({request.keys.raw(1, framings) for request in (plain, diced, other)}) == 3
    assert diced.pictures.needs_mesh(1) and not plain.pictures.needs_mesh(1)


def _edges_in_pixels(vertices, faces, camera: Camera, quality: Quality):
    seen = camera.project(vertices, quality.aspect)[:, :2] * (quality.width / 2, quality.height / 2)
    return np.linalg.norm(seen[faces] - seen[np.roll(faces, 1, axis=1)], axis=-1)


@settings(deadline=None)  # the first example loads kernels
@given(distance=st.floats(3.0, 30.0), pixels=st.floats(3.0, 20.0), width=st.sampled_from((160, 320, 640)))
def test_pieces_span_no_more_pixels_than_asked_for_and_not_far_fewer(
    distance: float, pixels: float, width: int
) -> None:
    ball = icosphere(4)
    camera, quality = Camera((0.0, 0.0, distance), (0.0, 0.0, 0.0)), Quality(width, width * 9 // 16, 1, 2)
    assume((np.abs(camera.project(ball.vertices, quality.aspect)[:, :2]) < 1.0).all())
    pieces = pieces_for(ball.vertices, ball.faces, camera, quality, pixels, 16)
    longest = _edges_in_pixels(ball.vertices, ball.faces, camera, quality).max()
    assert pieces == 1 or longest / pieces <= pixels < longest / (pieces - 1)
    fine = tessellate(split_at_creases(ball, np.pi), pieces)
    bulge = 1.15  # patches are longer than their chords
    assert (
        _edges_in_pixels(fine.vertices, fine.faces, camera, quality).max() <= bulge * pixels or pieces == 16
    )


def test_what_is_behind_the_lens_or_beside_the_picture_is_not_diced_for() -> None:
    quality = Quality(320, 180, 1, 2)
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    faces, camera = np.array([[0, 1, 2]], np.int32), Camera((0.0, 0.0, 10.0), (0.0, 0.0, 0.0))
    assert pieces_for(triangle, faces, camera, quality, 2.0, 16) == 16
    assert pieces_for(triangle + np.array([0, 0, 10.5]), faces, camera, quality, 2.0, 16) == 1
    assert pieces_for(triangle + np.array([9, 0, 0]), faces, camera, quality, 2.0, 16) == 1


def test_diced_pictures_are_of_finer_surfaces_the_finer_they_are(project) -> None:
    project.shot.write_text(TINY + "smooth: {dicing: 2px}\naovs: [velocity]\n")
    cut = []
    for quality in ("draft.scale25", "draft.scale50"):
        project.render("2", quality=quality)
        told = project.path / "renders" / "T010_tiny" / quality / "statistics" / "T010_tiny.0002.json"
        cut.append(json.loads(told.read_text())["faces"])
    with np.load(project.path / "renders" / "T010_tiny" / "meshes" / "T010_tiny.0002.npz") as mesh:
        pieces = np.sqrt(np.array(cut) / len(mesh["faces"]))
    assert (pieces == pieces.round()).all() and 1 < pieces[0] < pieces[1]
