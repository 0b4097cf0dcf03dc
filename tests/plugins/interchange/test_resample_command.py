"""`flowsculpt resample`: one mesh file in, one out, and what was done."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, read_mesh, read_polygons, validate
from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh
from flowsculpt.pipeline.plugins.interchange.resample_command import REFUSALS
from flowsculpt.pipeline.resample.kernels.collapse import REASONS


def lengths(mesh: TriangleMesh):
    corners = mesh.vertices[mesh.faces]
    return np.linalg.norm(corners - corners[:, (1, 2, 0)], axis=2)


def test_a_file_is_resampled_and_its_table_tells_what_was_done(project):
    write_mesh(box((2, 2, 2), 0.5), project.path / "box.obj")
    done = project.call("resample", "box.obj", "out/box.ply", "--max-edge-length", "0.2")
    assert done.code == 0, done.err
    mesh = read_mesh(project.path / "out" / "box.ply")
    assert lengths(mesh).max() <= 0.2
    assert validate(mesh).require(closed=True).euler == 2
    assert f"98 → {len(mesh.vertices)}" in done.out
    assert "100.00%" in done.out


def test_json_has_the_counts_and_the_reasons(project):
    write_mesh(icosphere(8), project.path / "ball.stl")
    done = project.call("--json", "resample", "ball.stl", "ball.npz", "--max-edge-length", "0.4")
    facts = json.loads(done.out)
    assert facts["collapses"] > 0
    assert facts["vertices"] == 642 - facts["collapses"]
    assert facts["too_short"] == sum(facts["refused"].values())
    assert facts["after"]["mean_edge"] > facts["before"]["mean_edge"]
    with np.load(project.path / "ball.npz") as arrays:
        assert len(arrays["vertices"]) == facts["vertices"]


def test_curved_placement_rounds_what_chords_leave_flat(project):
    write_mesh(icosphere(3), project.path / "ball.ply")
    worst = {}
    for placement in ("chord", "curved"):
        words = ("ball.ply", f"{placement}.ply", "--max-edge-length", "0.2", "--placement", placement)
        assert project.call("resample", *words).code == 0
        radii = np.linalg.norm(read_mesh(project.path / f"{placement}.ply").vertices, axis=1)
        worst[placement] = np.abs(radii - 1).max()
    assert worst["curved"] < 0.4 * worst["chord"]


def test_polyhedra_keep_faces_of_many_sides(project):
    write_mesh(box((2, 2, 2), 1.0), project.path / "box.obj")
    words = ("box.obj", "cut.obj", "--max-edge-length", "0.3", "--method", "polyhedra")
    assert project.call("resample", *words).code == 0
    faces = [
        line.split()[1:] for line in (project.path / "cut.obj").read_text().splitlines() if line[0] == "f"
    ]
    assert max(map(len, faces)) > 3


@pytest.mark.parametrize(("suffix", "many"), [("obj", True), ("ply", True), ("off", True), ("stl", False)])
def test_polygons_are_written_where_the_format_can(project, suffix: str, many: bool):
    (project.path / "quad.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    words = ("quad.obj", f"cut.{suffix}", "--max-edge-length", "0.3", "--method", "polyhedra")
    done = project.call("--json", "resample", *words)
    assert done.code == 0, done.err
    found = read_polygons(project.path / f"cut.{suffix}")
    assert (found.average_sides > 3.5) == many
    if many:
        assert json.loads(done.out)["average_sides"] == pytest.approx(found.average_sides)
        assert json.loads(done.out)["cuts"] == len(found) - 1


def test_faces_are_cut_into_four_when_asked(project):
    write_mesh(icosphere(2), project.path / "ball.ply")
    words = ("ball.ply", "four.ply", "--max-edge-length", "0.4", "--min-edge-length", "0")
    assert project.call("resample", *words, "--splits", "faces").code == 0
    assert len(read_mesh(project.path / "four.ply").faces) == 4 * len(icosphere(2).faces)


def test_every_reason_to_stay_short_has_its_words():
    assert set(REFUSALS) == {*REASONS, "area"}


def test_the_help_teaches_how_to_choose_the_length(project):
    done = project.call("resample", "--help")
    assert done.code == 0
    for word in ("--max-edge-length", "--min-edge-length", "--placement", "bunny.obj", "smallest", "--json"):
        assert word in done.out


def test_a_dry_run_writes_nothing(project):
    write_mesh(box(), project.path / "box.obj")
    done = project.call("--dry-run", "resample", "box.obj", "out.ply", "--max-edge-length", "0.2")
    assert done.code == 0 and "would be written" in done.out
    assert not (project.path / "out.ply").exists()


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("no.obj", "o.ply", "--max-edge-length", "1"), 3, "no.obj: file not found"),
        (("box.obj", "o.fbx", "--max-edge-length", "1"), 2, "use one of ply, obj"),
        (("box.obj", "o.ply", "--max-edge-length", "1", "--min-edge-length", "0.7"), 2, "70%"),
        (("box.obj", "o.ply", "--max-edge-length", "1", "--placement", "curvd"), 2, "Did you mean 'curved'?"),
        (("box.obj", "o.ply", "--max-edge-length", "1", "--splits", "face"), 2, "Did you mean 'faces'?"),
        (
            ("box.obj", "o.ply", "--max-edge-length", "1", "--splits", "faces", "--placement", "curved"),
            2,
            "--splits faces puts new vertices in the middle of their edges",
        ),
        (
            ("box.obj", "o.ply", "--max-edge-length", "1", "--splits", "faces", "--method", "polyhedra"),
            2,
            "--splits is for triangles",
        ),
        (("box.obj", "o.ply", "--max-edge-length", "1e-7"), 1, "budget"),
        (("box.obj", "shots/o.ply/o.ply", "--max-edge-length", "1"), 4, "cannot be written"),
    ],
)
def test_what_cannot_be_is_told_in_one_line(project, words: tuple[str, ...], code: int, says: str):
    write_mesh(box(), project.path / "box.obj")
    (project.path / "shots" / "o.ply").write_text("")
    done = project.call("resample", *words)
    assert done.code == code
    assert says in done.err
    assert len([line for line in done.err.splitlines() if line.strip()]) == 1
    assert not Path(project.path / "o.ply").exists()
