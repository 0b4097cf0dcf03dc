"""Clouds and nets in shot files: what good ones mean, and what bad ones are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MissingInputError, ShotError
from flowsculpt.pipeline.mesh import TriangleMesh
from flowsculpt.pipeline.mesh.control_net import PIECES, bspline_surface
from flowsculpt.pipeline.plugins.points.clouds import CloudInSolid, CloudOfFile
from flowsculpt.pipeline.plugins.points.nets import NetOfFile, NetOfRows, NetOfSolid
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.subjects import Solid
from tests.mesh_files import write_ply

HEAD = "title: T\nframes: 1-3\n"
BALL = "{solid: icosphere, radius: 2}"
ROWS = str([[[float(x), 0.0, float(z)] for x in range(4)] for z in range(5)])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    points = np.arange(12.0).reshape(4, 3)
    good = {"size": np.full(4, 0.5), "thin": np.array([0.1, 0.0, -1.0, 0.1])}
    write_ply(TriangleMesh(points, [], good), tmp_path / "stars.ply")
    np.savez(tmp_path / "sail.npz", points=np.arange(60.0).reshape(4, 5, 3))
    np.savez(tmp_path / "small.npz", points=np.zeros((3, 5, 3)))
    np.savez(tmp_path / "wild.npz", points=np.full((4, 3), np.nan))
    (tmp_path / "empty.xyz").write_text("# none\n")
    return tmp_path


def read(folder: Path, subject: str, more: str = ""):
    (folder / "a.yaml").write_text(f"{HEAD}subject: {subject}\n{more}")
    return read_shot(folder / "a.yaml")


def told(folder: Path, subject: str, more: str = "") -> list[str]:
    with pytest.raises((ShotError, MissingInputError)) as error:
        read(folder, subject, more)
    return str(error.value).replace(f"{folder}/", "").split("\n")


def test_a_cloud_in_a_solid_needs_no_resampling(folder: Path) -> None:
    shot = read(folder, f"{{cloud: {BALL}, count: 50, fill: surface, seed: 3, radius: 0.1}}")
    assert shot.motion.subject == CloudInSolid(Solid.of("icosphere", {"radius": 2}), 50, "surface", 3, 0.1)
    assert shot.motion.resampling is None
    mesh = shot.motion.mesh_at_rest()
    assert len(mesh.vertices) == 50
    assert len(mesh.faces) == 0
    assert (mesh.attributes["radius"] == 0.1).all()


def test_a_cloud_of_a_file_may_take_its_radii_from_there_and_scales_both(folder: Path) -> None:
    shot = read(folder, "{cloud: stars.ply, scale: 2, radius: size}", "resample: off\n")
    subject = shot.motion.subject
    assert isinstance(subject, CloudOfFile)
    points, radii = subject.points()
    assert points == pytest.approx(2 * np.arange(12.0).reshape(4, 3))
    assert radii == pytest.approx(np.ones(4))
    assert shot.files == ((folder / "stars.ply", subject.digest),)


def test_a_number_for_a_radius_is_not_scaled(folder: Path) -> None:
    subject = read(folder, "{cloud: stars.ply, scale: 2, radius: 0.25}").motion.subject
    assert subject.points()[1] == pytest.approx(np.full(4, 0.25))


def test_nets_come_from_solids_rows_and_files(folder: Path) -> None:
    tube = read(folder, "{net: {solid: tube, length: 4}, rows: 6, columns: 7}").motion.subject
    assert tube == NetOfSolid.of("tube", {"length": 4}, 6, 7)
    assert (tube.lattice.rows, tube.lattice.columns, tube.lattice.closed) == (6, 7, (False, True))
    rows = read(folder, f"{{net: {ROWS}, closed: rows}}").motion.subject
    assert isinstance(rows, NetOfRows)
    assert (rows.lattice.rows, rows.lattice.columns, rows.lattice.closed) == (5, 4, (True, False))
    sail = read(folder, "{net: sail.npz, scale: 3}").motion.subject
    assert isinstance(sail, NetOfFile)
    assert sail.build().vertices == pytest.approx(3 * np.arange(60.0).reshape(20, 3))


def test_rows_in_the_file_shape_the_surface(folder: Path) -> None:
    points, lattice = read(folder, f"{{net: {ROWS}}}").motion.subject.net()
    surface = bspline_surface(points, lattice)
    assert surface.vertices.min(axis=0) == pytest.approx([1, 0, 1])
    assert surface.vertices.max(axis=0) == pytest.approx([2, 0, 3])


def test_the_surface_of_a_net_is_fine_unless_the_shot_says_otherwise(folder: Path) -> None:
    assert read(folder, f"{{net: {ROWS}}}").picture.tessellate == PIECES
    assert read(folder, f"{{net: {ROWS}}}", "smooth: {tessellate: 3}\n").picture.tessellate == 3
    assert read(folder, f"{{cloud: {BALL}, radius: 1}}").picture.tessellate == 1


@pytest.mark.parametrize(
    ("subject", "message"),
    [
        ("{cloud: empty.xyz, radius: 1}", "3:11: empty.xyz: it has no points; a cloud needs at least one"),
        ("{cloud: gone.ply, radius: 1}", "3:11: cloud file gone.ply is not there; it is looked for"),
        ("{cloud: wild.npz, radius: 1}", "3:11: wild.npz: point 0 is not finite (and 3 more); coordinates"),
        (
            "{cloud: sail.npz, radius: 1}",
            "3:11: sail.npz: its points have shape (4, 5, 3); they must be (N, 3)",
        ),
        ("{cloud: a.yaml, radius: 1}", "3:11: a.yaml: .yaml is not a file of points; use one of ply, xyz"),
        ("{cloud: stars.ply}", "subject.radius: missing; it has no default"),
        ("{cloud: stars.ply, radius: 0}", "3:29: subject.radius: 0 is out of range; it must be above 0"),
        ("{cloud: stars.ply, radius: -1}", "3:29: subject.radius: -1 is out of range; it must be above 0"),
        ("{cloud: stars.ply, radius: 3 mm}", "subject.radius"),
        ("{cloud: stars.ply, radius: sized}", "no attribute 'sized' for a radius. Did you mean 'size'?"),
        ("{cloud: stars.ply, radius: thin}", "thin of point 1 is 0 (and 1 more); radii must be above 0"),
        (
            "{cloud: stars.ply, radius: 1, count: 9}",
            "3:40: count is for a cloud of a solid; this is one of a file",
        ),
        (f"{{cloud: {BALL}, radius: size}}", "points in a solid have no attribute 'size'; write a number."),
        (
            f"{{cloud: {BALL}, radius: 1, scale: 2}}",
            "scale is for a cloud of a file; this is one of a solid.",
        ),
        (
            f"{{cloud: {BALL}, radius: 1, count: 0}}",
            "subject.count: 0 is out of range; it must be at least 1",
        ),
        (
            f"{{cloud: {BALL}, radius: 1, fill: volum}}",
            "'volum' is not a way to fill a solid. Did you mean 'volume'",
        ),
        (f"{{cloud: {BALL}, radius: 1, sed: 0}}", "subject.sed: unknown name. Did you mean 'seed'?"),
        ("{cloud: {solid: sheet}, radius: 1}", "a sheet encloses no volume to fill. Write fill: surface."),
        ("{cloud: {solid: bx}, radius: 1}", "'bx' is not a solid. Did you mean 'box'?"),
        ("{cloud: {solid: box, length: 1}, radius: 1}", "length is not a measure of a box."),
        ("{net: small.npz}", "3:11: a net of 3 × 5 points is too small; a bicubic patch needs 4 × 4."),
        ("{net: gone.npz}", "3:11: net file gone.npz is not there"),
        ("{net: stars.ply}", "stars.ply: .ply is not a file of a net; use one of npz, obj"),
        ("{net: sail.npz, columns: 4}", "sail.npz: its rows have 5 points, not 4; leave columns out"),
        (
            "{net: sail.npz, rows: 4}",
            "rows is for a net of a solid; this is one of a file. Leave it out.",
        ),
        ("{net: [[[0, 0, 0]]]}", "a net of 1 × 1 points is too small"),
        ("{net: []}", "the net has no rows; a bicubic patch needs 4 × 4 points."),
        (
            "{net: [[[0, 0, 0]], []]}",
            "row 1 has 0 points and row 0 has 1; all rows of a net are equally long.",
        ),
        (
            f"{{net: {ROWS.replace('3.0, 0.0, 4.0', '3.0, 0.0')}}}",
            "subject.net.4.3: [3, 0] has 2 numbers; it must have",
        ),
        (f"{{net: {ROWS}, closed: row}}", "'row' is not a way to close a net. Did you mean 'rows'?"),
        ("{net: {solid: tube}, rows: 3}", "subject.rows: 3 is out of range; it must be at least 4"),
        ("{net: {solid: tub}}", "'tub' is not a net. Did you mean 'tube'?"),
        ("{net: {solid: tube, size: [1, 1]}}", "size is not a measure of a tube."),
        (
            "{net: {solid: torus, radius: 1, tube_radius: 2}}",
            "tube_radius 2 must be below radius 1, or the ring",
        ),
    ],
)
def test_a_bad_subject_of_points_is_told_once_with_its_place(
    folder: Path, subject: str, message: str
) -> None:
    messages = told(folder, subject)
    assert len(messages) == 1
    assert messages[0].startswith("a.yaml:3:")
    assert message in messages[0]


def test_a_missing_file_of_points_is_a_missing_input(folder: Path) -> None:
    for subject in ("{cloud: gone.ply, radius: 1}", "{net: gone.npz}"):
        with pytest.raises(MissingInputError):
            read(folder, subject)


@pytest.mark.parametrize("subject", ["{cloud: stars.ply, radius: 1}", "{net: sail.npz}"])
def test_points_are_not_resampled_and_a_shot_that_wants_it_is_told(folder: Path, subject: str) -> None:
    (message,) = told(folder, subject, "resample: {max_edge_length: 0.1}\n")
    assert message.startswith("a.yaml:4:1: ")
    assert message.endswith("and are not resampled. Write resample: off, or leave it out.")


def test_a_surface_says_how_it_is_resampled(folder: Path) -> None:
    assert told(folder, "{solid: box}") == [
        "a.yaml:1:1: resample: missing; it has no default. Write resample: {max_edge_length: 0.05}."
    ]


def test_a_shot_that_extends_a_solid_may_be_a_cloud_instead(folder: Path) -> None:
    (folder / "base.yaml").write_text(f"{HEAD}subject: {{solid: box, size: [1, 1, 1]}}\nresample: off\n")
    (folder / "b.yaml").write_text(f"extends: base\nsubject: {{cloud: {BALL}, count: 5, radius: 1}}\n")
    assert isinstance(read_shot(folder / "b.yaml").motion.subject, CloudInSolid)


def test_the_documented_points_are_good(folder: Path) -> None:
    page = (Path(__file__).parents[3] / "docs" / "shot-files.md").read_text("utf-8")
    lines = page.split("## Points")[1].split("```yaml\n")[1].split("```")[0].splitlines()
    kinds = []
    for line in lines:
        subject = line.partition(": ")[2].partition("  #")[0]
        rows = subject.partition("net: [")[1]
        kinds.append(type(read(folder, f"{{net: {ROWS}}}" if rows else subject).motion.subject))
    assert kinds == [CloudInSolid, CloudOfFile, NetOfSolid, NetOfFile, NetOfRows]
