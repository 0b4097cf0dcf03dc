"""Clouds and nets go through the same production as surfaces."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from flowsculpt.pipeline.mesh.control_net import PIECES
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.request.shot_source import ShotSource
from flowsculpt.render.post.image import read_exr, read_header
from tests.conftest import QUALITY, done

CLOUD = """\
title: Motes
frames: 1-6
subject: {cloud: {solid: icosphere, radius: 1}, count: 300, radius: 0.06}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 4: 36, 6: 60}}}
"""
NET = CLOUD.replace("cloud: {solid: icosphere, radius: 1}, count: 300, radius: 0.06", "net: {solid: tube}")
NAME = "T010_tiny"


def take_of(text: str) -> RenderRequest:
    source = ShotSource(text, Path(f"{NAME}.yaml"))
    return RenderRequest(source, quality_name="draft", variant="none", requested=(1,))


def test_a_late_key_leaves_early_frames_of_points_alone() -> None:
    for text in (CLOUD, NET):
        before, after = take_of(text), take_of(text.replace("6: 60", "6: 90"))
        assert [before.keys.mesh(n) == after.keys.mesh(n) for n in range(1, 7)] == [True] * 4 + [False] * 2


def test_how_finely_a_net_is_cut_changes_pictures_and_cameras_but_no_mesh() -> None:
    before, after = take_of(NET), take_of(NET + "smooth: {tessellate: 3}\n")
    assert before.shot.picture.tessellate == PIECES
    assert before.keys.mesh(6) == after.keys.mesh(6)
    assert before.keys.normals(6) != after.keys.normals(6)
    assert before.keys.cameras != after.keys.cameras


def test_other_points_make_other_frames() -> None:
    def key(old: str, new: str) -> str:
        return take_of(CLOUD.replace(old, new)).keys.mesh(1)

    same = key("count: 300", "count: 300, seed: 0")  # what nothing said means
    others = {key("300", "301"), key("300", "300, seed: 1"), key("0.06", "0.05"), key("s: 1}", "s: 2}")}
    assert same == take_of(CLOUD).keys.mesh(1)
    assert len(others | {same}) == 5


def test_a_cloud_is_simulated_rendered_resumed_and_turned(project, monkeypatch) -> None:
    from flowsculpt.pipeline.plugins.turntable.turntable_movie import TurntableRequest

    project.shot.write_text(CLOUD)
    project.render("3")
    project.render("4")
    home = project.path / "renders" / NAME
    with np.load(home / "meshes" / f"{NAME}.0004.npz") as mesh:
        assert mesh["faces"].shape == (0, 3)
        assert {"attribute:radius", "attribute:identity", "births"} <= set(mesh.files)
        points = mesh["vertices"]
    with np.load(home / "normals" / f"{NAME}.0004.npz") as drawn:
        assert set(drawn.files) == {"vertices", "radii", "source_vertex", "material", "key"}
        assert np.array_equal(drawn["vertices"], points.astype(np.float32))
    matte = read_exr(home / QUALITY / "raw" / f"{NAME}.0004.exr")[0]["matte"]
    assert matte.max() > 0.99
    assert max(matte[0].max(), matte[-1].max(), matte[:, 0].max(), matte[:, -1].max()) == 0
    assert read_header(home / QUALITY / "frames" / f"{NAME}.0004.exr")["resample"] == "off"
    monkeypatch.chdir(project.path)
    done(project.path, TurntableRequest(Project(project.path, 1), NAME, QUALITY, 4, 2).plan())
    assert [*project.path.glob(f"renders/turntable/{NAME}.0004/{QUALITY}/*.mp4")]
    states = json.loads(project.call("--json", "status").out)
    assert NAME in json.dumps(states)


def test_a_net_is_rendered_as_its_smooth_surface(project) -> None:
    project.shot.write_text(NET + "smooth: {tessellate: 4}\n")
    project.render("6")
    home = project.path / "renders" / NAME
    with np.load(home / "meshes" / f"{NAME}.0006.npz") as mesh:
        assert mesh["net"].tolist() == [12, 8, 0, 1]
        assert len(mesh["vertices"]) == 12 * 8
    with np.load(home / "normals" / f"{NAME}.0006.npz") as drawn:
        assert len(drawn["vertices"]) == (9 * 4 + 1) * (8 * 4)
        assert np.abs(np.linalg.norm(drawn["normals"], axis=1) - 1).max() < 1e-6
    matte = read_exr(home / QUALITY / "raw" / f"{NAME}.0006.exr")[0]["matte"]
    assert matte.max() > 0.99
