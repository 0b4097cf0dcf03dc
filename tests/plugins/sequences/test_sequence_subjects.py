"""Meshes over time of another program as subjects: what frames show, and messages about bad files."""

from __future__ import annotations

import re
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate, moved_to_subframe
from flowsculpt.pipeline.errors import FlowsculptError, FrameError
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere
from flowsculpt.pipeline.mesh.normals import trusted_normals
from flowsculpt.pipeline.production.request.manifest import mesh_keys
from flowsculpt.pipeline.production.request.shading import Shading
from flowsculpt.pipeline.shot import Shot, read_shot
from tests.mesh_files import write_ply
from tests.needed_plugins import needs_plugins

BALL = icosphere(3)


def place(points: np.ndarray, frame: float) -> np.ndarray:
    """Return where points of a ball are at a frame: they turn, and rise faster and faster."""
    angle = 0.1 * (frame - 1)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return points @ turn.T + [0.0, 0.02 * (frame - 1) ** 2, 0.0]


def write_ball(folder: Path, number: int, at: float | None = None, **named: np.ndarray) -> None:
    mesh = TriangleMesh(place(BALL.vertices, number if at is None else at), BALL.faces, named)
    write_ply(mesh, folder / f"ball_{number:04d}.ply")


def write_splash(folder: Path, number: int) -> None:
    """Write a ball whose number of faces changes, with its velocity."""
    ball = icosphere(2 + number % 3)
    speed = (place(ball.vertices, number + 0.01) - place(ball.vertices, number - 0.01)) / 0.02 * 24.0
    named = dict(zip(("vx", "vy", "vz"), speed.T, strict=True))
    write_ply(TriangleMesh(place(ball.vertices, number), ball.faces, named), folder / f"splash.{number}.ply")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in range(1, 7):
        write_ball(tmp_path / "cache", number)
        write_splash(tmp_path / "cache", number)
    return tmp_path


def read(folder: Path, subject: str, more: str = "", frames: str = "1-6") -> Shot:
    text = f"title: T\nframes: {frames}\nsubject: {{sequence: {subject}}}\n{more}"
    (folder / "a.yaml").write_text(text)
    return read_shot(folder / "a.yaml")


def told(folder: Path, subject: str, more: str = "", frames: str = "1-6") -> str:
    with pytest.raises(FlowsculptError) as error:
        list(animate(read(folder, subject, more, frames)))
    return str(error.value).replace(f"{folder}/", "")


def test_frames_show_the_files_of_their_numbers(folder: Path) -> None:
    frames = list(animate(read(folder, "cache/ball_####.ply")))
    for frame in frames:
        np.testing.assert_allclose(frame.mesh.vertices, place(BALL.vertices, frame.number), atol=1e-14)
        np.testing.assert_array_equal(frame.mesh.faces, BALL.faces)
        np.testing.assert_allclose(frame.material, BALL.vertices, atol=1e-14)


@pytest.mark.parametrize(
    "subject", ["cache/ball_%04d.ply", "'cache/ball_*.ply'", "cache/ball_##.ply, start: 3"]
)
def test_patterns_are_written_as_other_programs_write_them(folder: Path, subject: str) -> None:
    if "##" in subject:
        assert "no file matches" in told(folder, subject)  # ball_0001 has four digits
        assert "; a * stands for the number alone. Correct" in told(folder, "'cache/*.ply'")
    else:
        assert len(list(animate(read(folder, subject)))) == 6


def test_numbers_may_be_negative_and_start_anywhere(tmp_path: Path) -> None:
    for number in range(-3, 4):
        write_ball(tmp_path / "cache", number)
    shot = read(tmp_path, "cache/ball_####.ply, start: -2", frames="1001-1004")
    frames = list(animate(shot))
    np.testing.assert_allclose(frames[3].mesh.vertices, place(BALL.vertices, 1), atol=1e-14)
    assert "Write start: -3" in told(tmp_path, "cache/ball_####.ply", frames="1001-1004")


def test_faces_that_change_are_shown_as_they_are(folder: Path) -> None:
    shot = read(folder, "cache/splash.#.ply")
    frames = list(animate(shot))
    assert [len(frame.mesh.faces) for frame in frames] == [20 * (2 + n % 3) ** 2 for n in range(1, 7)]
    moved = moved_to_subframe(shot.motion, frames[3], 4.25).mesh
    np.testing.assert_allclose(moved.vertices, place(icosphere(3).vertices, 4.25), atol=2e-3)
    assert frames[0].births is None  # nothing says which vertex was which


def test_normals_of_files_shade_faces_that_change_except_where_a_vertex_has_several(tmp_path: Path) -> None:
    ball = icosphere(2)
    slanted = ball.vertices + np.array([0.0, 0.2, 0.0])
    apart = TriangleMesh(ball.vertices[ball.faces.ravel()], np.arange(3 * len(ball.faces)).reshape(-1, 3))
    slanted_apart = np.where(ball.faces.ravel()[:, None] == 0, apart.face_normals.repeat(3, axis=0), 0.0)
    for number, mesh, normals in [
        (1, ball, 3.0 * slanted),
        (2, apart, slanted_apart + np.array([0.0, 1e-9, 0.0])),
    ]:
        named = dict(zip(("nx", "ny", "nz"), normals.T, strict=True))
        write_ply(TriangleMesh(mesh.vertices, mesh.faces, named), tmp_path / f"n.{number}.ply")
    shot = read(tmp_path, "n.#.ply, faces: changing, rotate: [0, 0, 90], scale: 5", frames="1-2")
    first, second = (frame.mesh for frame in animate(shot))
    expected = slanted[:, [1, 0, 2]] * [-1, 1, 1] / np.linalg.norm(slanted, axis=1, keepdims=True)
    np.testing.assert_allclose(first.attributes["normal"], expected, atol=1e-9)
    assert trusted_normals(first).all()
    given = np.linalg.norm(second.attributes["normal"], axis=1)
    assert (given[0], given[1:].min()) == pytest.approx((0.0, 1.0)), "corners that differ have no one normal"


@pytest.mark.parametrize("flows", ["", "flows: [{rotation: {axis: y, speed: 137.50987}}]\n"])
def test_normals_of_files_shade_faces_that_stay_and_flows_turn_them(tmp_path: Path, flows: str) -> None:
    def turned(directions: np.ndarray, frame: float) -> np.ndarray:
        return place(directions, frame) - place(np.zeros(3), frame)

    slanted = BALL.vertices + np.array([0.2, 0.0, 0.0])
    slanted /= np.linalg.norm(slanted, axis=1, keepdims=True)
    for number in (1, 2):
        normals = turned(slanted, number)
        normals[0] = 0.0
        write_ball(tmp_path, number, **dict(zip(("nx", "ny", "nz"), normals.T, strict=True)))
    shot = read(tmp_path, "ball_####.ply, rate: 12, rotate: [90, 0, 0], scale: 5", flows, frames="1-3")
    for frame in animate(shot):
        step = 0.5 * (frame.number - 1)
        x, y, z = turned(slanted, 1.0 + step).T
        expected = np.column_stack([x, -z, y])
        if flows:
            expected = turned(expected, 1.0 + 2.0 * step)
        found = frame.mesh.attributes["normal"]
        assert found[1:] == pytest.approx(expected[1:], abs=2e-3 if step == 0.5 else 1e-6)
        assert not found[0].any(), "the triangles decide where a file has no normal"


def test_creases_of_faces_that_stay_are_those_of_the_first_frame(tmp_path: Path) -> None:
    fold = np.array(
        [[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 0, 0], [3, 0, 0], [3, 0, 1], [3, 1, 0], [2, 0, 0]], float
    )
    faces = [[0, 1, 2], [1, 0, 3], [4, 5, 6], [5, 4, 7]]  # flat at first, and hard at first
    for number in (1, 2, 3):
        points = fold.copy()
        points[3, 1], points[6, 1] = 0.5 * (number - 1), 1.5 - 0.5 * number
        write_ply(TriangleMesh(points, faces), tmp_path / f"fold.{number}.ply")
    shot = read(tmp_path, "fold.#.ply", frames="1-3")
    for frame in animate(shot):
        shading = Shading.of(frame, shot.motion.thresholds_at(frame.number), 1)
        assert shading.split is not None and len(shading.split.vertices) == 8 + 2
        assert not {0, 1} & {*shading.split.source_vertex[8:].tolist()}, (
            "an edge that is bent later stays smooth"
        )


def test_vertices_follow_lines_or_curves_between_files(folder: Path) -> None:
    def error(between: str) -> float:
        shot = read(folder, f"cache/ball_####.ply, rate: 12, between: {between}", frames="1-9")
        frame = next(frame for frame in animate(shot) if frame.number == 6)
        return float(np.abs(frame.mesh.vertices - place(BALL.vertices, 3.5)).max())

    assert error("cubic") < 2e-4 < error("linear") < 1e-2 < error("hold")


def test_blur_follows_the_paths_of_vertices(folder: Path) -> None:
    shot = read(folder, "cache/ball_####.ply")
    for frame in animate(shot):
        for offset in (-0.25, 0.25):
            at = frame.number + offset
            moved = moved_to_subframe(shot.motion, frame, at).mesh.vertices
            atol = 7e-3 if frame.number in (1, 6) else 2e-3  # at the ends, paths go straight on
            np.testing.assert_allclose(moved, place(BALL.vertices, at), atol=atol)


def test_held_files_stand_still(folder: Path) -> None:
    shot = read(folder, "cache/ball_####.ply, rate: 12, between: hold", frames="1-8")
    for frame in animate(shot):
        now = moved_to_subframe(shot.motion, frame, frame.number + 0.5).mesh.vertices
        np.testing.assert_allclose(now, frame.mesh.vertices, atol=1e-12)


def test_a_loop_begins_again_after_the_last_file(folder: Path) -> None:
    frames = list(animate(read(folder, "cache/ball_####.ply, loop: true", frames="1-14")))
    np.testing.assert_array_equal(frames[6].mesh.vertices, frames[0].mesh.vertices)
    np.testing.assert_array_equal(frames[13].mesh.vertices, frames[1].mesh.vertices)


def test_a_loop_that_ends_as_it_begins_does_not_show_that_twice(folder: Path) -> None:
    write_ball(folder / "cache", 5, at=1)
    frames = list(
        animate(read(folder, "cache/ball_####.ply, start: 1, loop: true, faces: fixed", frames="1-6"))
    )
    assert frames[5].mesh.vertices == pytest.approx(place(BALL.vertices, 6)), "six files differ"
    (folder / "cache/ball_0006.ply").unlink()
    frames = list(animate(read(folder, "cache/ball_####.ply, loop: true", frames="1-9")))
    for number, shown in [(5, 1), (6, 2), (9, 1)]:
        assert frames[number - 1].mesh.vertices == pytest.approx(place(BALL.vertices, shown))


@needs_plugins("interchange")
def test_a_loop_of_an_animation_is_as_long_as_its_keys_say(tmp_path: Path) -> None:
    from tests.plugins.interchange.gltf_scenes import box_scene
    from tests.plugins.interchange.test_gltf_motion import animate as animate_node

    scene = box_scene(BALL)
    animate_node(scene, 0, "translation", [0, 0.25, 0.5], [[0, 0, 0], [1, 0, 0], [0, 0, 0]])
    scene.glb(tmp_path / "a.glb")
    shot = read(tmp_path, "a.glb, loop: true", frames="1-26")
    at = [float(frame.mesh.vertices[:, 0].mean()) for frame in animate(shot)]
    assert at[:13] == pytest.approx([1 - abs(1 - n / 6) for n in range(13)])
    assert at[12:25] == pytest.approx(at[:13]), "the first key follows 0.5 s after it"


def test_a_shot_that_runs_backwards_shows_the_files_backwards(folder: Path) -> None:
    shot = read(folder, "cache/ball_####.ply, start: 6, speed: -1")
    np.testing.assert_allclose([*animate(shot)][5].mesh.vertices, place(BALL.vertices, 1), atol=1e-14)
    again = read(folder, "cache/ball_####.ply", "speed: 0.5\n")
    np.testing.assert_allclose([*animate(again)][4].mesh.vertices, place(BALL.vertices, 3), atol=1e-14)


def test_a_resampled_surface_stays_on_the_faces_of_its_files(folder: Path) -> None:
    shot = read(folder, "cache/ball_####.ply", "resample: {max_edge_length: 0.2}\n")
    *_, last = animate(shot)
    mesh = last.mesh
    assert len(mesh.vertices) > 4 * len(BALL.vertices)
    rest = mesh.attributes["rest"]
    np.testing.assert_allclose(mesh.vertices, place(rest, 6), atol=1e-12)
    corners = BALL.vertices[BALL.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    away = np.einsum("vfi,fi->vf", rest[:, None] - corners[None, :, 0], normals)
    assert np.abs(away).min(axis=1).max() < 1e-12
    ends = mesh.vertices[mesh.faces] - np.roll(mesh.vertices[mesh.faces], -1, axis=1)
    assert np.linalg.norm(ends, axis=2).max() <= 0.2 + 1e-9


@pytest.mark.parametrize("resample", ["off", "{max_edge_length: 0.3}"])
def test_flows_act_on_the_surface_as_it_is_at_each_frame(folder: Path, resample: str) -> None:
    more = f"resample: {resample}\nflows: [{{translation: {{rate: [2.4, 0, 0]}}}}]\n"
    shot = read(folder, "cache/ball_####.ply", more)
    frames = list(animate(shot))
    for frame in frames:
        expected = place(frame.material, frame.number) + np.array([0.1 * (frame.number - 1), 0.0, 0.0])
        np.testing.assert_allclose(frame.mesh.vertices, expected, atol=1e-12)
    moved = moved_to_subframe(shot.motion, frames[2], 3.25).mesh.vertices
    expected = place(frames[2].material, 3.25) + np.array([0.225, 0.0, 0.0])
    np.testing.assert_allclose(moved, expected, atol=2e-3)


def test_frames_are_the_same_after_an_interruption(folder: Path) -> None:
    more = "resample: {max_edge_length: 0.3}\nflows: [{twist: {axis: y, amount: 30}}]\n"
    shot = read(folder, "cache/ball_####.ply", more)
    frames = list(animate(shot))
    *_, last = animate(shot, resume=frames[2])
    np.testing.assert_array_equal(last.mesh.vertices, frames[-1].mesh.vertices)
    np.testing.assert_array_equal(last.mesh.faces, frames[-1].mesh.faces)


def test_an_edited_file_makes_only_its_frame_and_the_two_beside_it_again(folder: Path) -> None:
    before = mesh_keys(read(folder, "cache/splash.#.ply").motion)
    text = (folder / "cache/splash.4.ply").read_text()
    (folder / "cache/splash.4.ply").write_text(text.replace("end_header", "comment later\nend_header"))
    after = mesh_keys(read(folder, "cache/splash.#.ply").motion)
    assert [number for number in before if before[number] != after[number]] == [3, 4, 5]


def test_files_that_no_frame_shows_do_not_count(folder: Path) -> None:
    shot = read(folder, "cache/splash.#.ply", frames="1-3")
    assert [path.name for path, _ in shot.files] == [f"splash.{n}.ply" for n in (1, 2, 3, 4)]


def test_missing_files_are_listed_or_the_one_before_is_held(folder: Path) -> None:
    for number in (3, 4, 6):
        (folder / f"cache/ball_{number:04d}.ply").unlink()
    assert told(folder, "cache/ball_####.ply", frames="1-8") == (
        "a.yaml:3:11: 5 files not there: 3-4 and 6-8, for frames 3-4 and 6-8. Choose -f 1-2 of "
        "those that are there, write frames: 1-2, or missing: hold, which shows the file before."
    )
    frames = list(animate(read(folder, "cache/ball_####.ply, missing: hold", frames="1-8")))
    shown = [float(frame.mesh.vertices[:, 1].mean()) for frame in frames]
    np.testing.assert_allclose(shown, [0.02 * (n - 1) ** 2 for n in (1, 2, 2, 2, 5, 5, 5, 5)], atol=1e-12)


def spoil(folder: Path, number: int, kind: str) -> None:
    path = folder / f"cache/ball_{number:04d}.ply"
    match kind:
        case "ragged":
            write_ply(icosphere(2), path)
        case "flipped":
            write_ply(TriangleMesh(BALL.vertices, BALL.faces[:, ::-1]), path)
        case "no faces":
            write_ply(TriangleMesh(BALL.vertices, []), path)
        case "empty":
            path.write_bytes(b"")
        case "NaN":
            lines = path.read_text().splitlines()
            row = lines.index("end_header") + 8
            lines[row] = "nan" + lines[row][lines[row].index(" ") :]
            path.write_text("\n".join(lines))


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (
            "ragged",
            "ball_0004.ply: it has 42 vertices and 80 faces, and ball_0001.ply has 92 and 180. Export",
        ),
        (
            "flipped",
            "ball_0004.ply: its faces are wound the other way round than those of ball_0001.ply. Export",
        ),
        ("no faces", "ball_0004.ply: it has no faces, so its frame shows nothing. Leave the frame out"),
        ("empty", "ball_0004.ply: the file is empty. Copy or export it again."),
        ("NaN", "ball_0004.ply: vertex 7 is at (nan, "),
    ],
)
def test_a_bad_file_fails_its_frame_with_one_line(folder: Path, kind: str, message: str) -> None:
    spoil(folder, 4, kind)
    shot, shown = read(folder, "cache/ball_####.ply"), []
    with pytest.raises(FrameError) as error:
        for frame in animate(shot):
            shown.append(frame.number)
    assert shown in ([1, 2, 3], [1, 2])  # frame 3 needs the file after it for its velocities
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("no faces", "cache/splash.4.ply: it has no faces, so its frame shows nothing. Leave the frame out"),
        ("empty", "cache/splash.4.ply: the file is empty. Copy or export it again."),
        ("NaN", "frame 4: splash.4.ply: vertex 7 is at (nan, "),
    ],
)
def test_a_bad_file_at_the_end_of_faces_that_change_fails_its_frame_with_one_line(
    folder: Path, kind: str, message: str
) -> None:
    (folder / "cache/ball_0004.ply").write_bytes((folder / "cache/splash.4.ply").read_bytes())
    spoil(folder, 4, kind)
    (folder / "cache/splash.4.ply").write_bytes((folder / "cache/ball_0004.ply").read_bytes())
    for later in (5, 6):
        (folder / f"cache/splash.{later}.ply").unlink(missing_ok=True)
    with pytest.raises(FrameError) as error:
        list(animate(read(folder, "cache/splash.#.ply", frames="1-4")))
    assert message in str(error.value) and "\n" not in str(error.value)


def test_a_closed_surface_that_is_wound_the_other_way_round_in_a_file_is_turned_outwards(
    folder: Path,
) -> None:
    flipped = icosphere(2)
    write_ply(TriangleMesh(flipped.vertices, flipped.faces[:, ::-1]), folder / "cache/splash.2.ply")
    frames = list(animate(read(folder, "cache/splash.#.ply", frames="1-3")))
    for frame in frames:
        corners = frame.mesh.vertices[frame.mesh.faces] - frame.mesh.vertices.mean(axis=0)
        assert np.linalg.det(corners).sum() > 0.0


@pytest.mark.parametrize(
    ("repair", "noted", "words"),
    [
        ("on", {3}, "; they are reversed"),
        ("off", {1, 3}, ". Write repair: on, which reverses them"),
    ],
)
def test_notes_name_the_files_whose_closed_surfaces_face_inwards(
    tmp_path: Path, repair: str, noted: set[int], words: str
) -> None:
    """The first, the second and the last file are read; a repaired first one has its own line."""
    for number in (1, 2, 3):
        ball = icosphere(1 + number)
        faces = ball.faces if number == 2 else ball.faces[:, ::-1]
        write_ply(TriangleMesh(ball.vertices, faces), tmp_path / f"cache/s_{number}.ply")
    notes = read(tmp_path, f"cache/s_#.ply, repair: {repair}", frames="1-3").motion.subject.notes
    inwards = [note for note in notes if "the faces of its closed surface are turned inwards" in note]
    assert {int(note[len("s_")]) for note in inwards} == noted
    assert all(words in note for note in inwards)
    assert any("320 faces" in note or "80 faces" in note for note in notes) == (repair == "on")


def test_settings_that_need_fixed_faces_are_refused_where_faces_change(folder: Path) -> None:
    for more, setting in (
        ("resample: {max_edge_length: 0.2}\n", "resample"),
        ("flows: [{twist: {amount: 30}}]\n", "flows"),
    ):
        message = told(folder, "cache/splash.#.ply", more)
        assert re.match(r"a.yaml:4:\d+: the faces of splash.1.ply change from frame to frame", message)
        assert f"Leave {setting} out." in message


def test_files_in_steps_need_a_rate(tmp_path: Path) -> None:
    for number in (0, 10, 20):
        write_ball(tmp_path / "cache", number, at=1 + number / 10)
    message = told(tmp_path, "cache/ball_####.ply, start: 0", frames="1-3")
    assert "0, 10, … in steps of 10, and how long a step takes is not known. Write rate: 24" in message
    frames = list(animate(read(tmp_path, "cache/ball_####.ply, start: 0, rate: 24", frames="1-3")))
    np.testing.assert_allclose(frames[2].mesh.vertices, place(BALL.vertices, 3), atol=1e-14)


def test_a_file_in_another_format_than_the_others_is_named(tmp_path: Path) -> None:
    for number in (1, 3, 4, 5):
        write_ball(tmp_path, number)
    (tmp_path / "ball_0002.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "ball_0002.mtl").write_text("")
    said = told(tmp_path, "ball_####.ply", frames="1-5")
    assert (
        "1 file not there: 2, for frame 2. ball_0002.obj is in another format; write all files in one."
        in said
    )
    for number in (4, 5):
        (tmp_path / f"ball_{number:04d}.ply").unlink()
    assert "ball_0002.obj is in another format" in told(tmp_path, "ball_####.ply", frames="1-3")


def test_a_subject_fitted_and_turned_keeps_its_motion(folder: Path) -> None:
    plain, placed = (
        list(animate(read(folder, f"cache/ball_####.ply{more}")))
        for more in ("", ", fit: 4, rotate: [0, 90, 0]")
    )
    middle = plain[0].mesh.vertices.mean(axis=0)
    heights = [frame.mesh.vertices[:, 1].mean() - middle[1] for frame in plain]
    twice = [frame.mesh.vertices[:, 1].mean() for frame in placed]
    scale = 4.0 / np.ptp(plain[0].mesh.vertices, axis=0).max()
    np.testing.assert_allclose(np.subtract(twice, twice[0]), scale * np.array(heights), atol=1e-9)


def test_two_sequences_may_be_subjects_of_one_shot(folder: Path) -> None:
    text = (
        "title: T\nframes: 1-6\nsubjects:\n  a: {sequence: cache/ball_####.ply, place: [3, 0, 0]}\n"
        "  b: {sequence: cache/splash.#.ply}\n  c: {solid: box}\nresample: {max_edge_length: 0.5}\n"
    )
    (folder / "a.yaml").write_text(text)
    shot = read_shot(folder / "a.yaml")
    a, b, _ = (list(animate(part)) for part in shot.subjects)
    np.testing.assert_allclose(a[5].mesh.vertices, place(BALL.vertices, 6) + np.array([3, 0, 0]), atol=1e-12)
    assert len(b[4].mesh.faces) == 20 * 4**2


def test_without_velocities_a_note_says_what_blur_follows(folder: Path) -> None:
    shot = read(folder, "cache/ball_####.ply, faces: changing")
    assert shot.motion.subject.notes == (
        "ball_0001.ply has no velocities; blur follows vertices where files have the same faces",
    )
    frames = list(animate(shot))
    moved = moved_to_subframe(shot.motion, frames[2], 3.25).mesh.vertices
    np.testing.assert_allclose(moved, place(BALL.vertices, 3.25), atol=2e-3)


def test_equal_shots_are_equal(folder: Path) -> None:
    one, other = (read(folder, "cache/ball_####.ply") for _ in range(2))
    assert mesh_keys(one.motion) == mesh_keys(other.motion)
    moved = replace(one.motion, frames=type(one.motion.frames).parse("11-16"))
    assert list(mesh_keys(moved).values())[:1] == list(mesh_keys(one.motion).values())[:1]


@needs_plugins("interchange")
def test_an_animation_in_one_file_is_shown_at_its_own_times(folder: Path) -> None:
    samples = np.array([place(BALL.vertices, number) for number in range(1, 7)], "<f4")
    header = struct.pack("<12siiffi", b"POINTCACHE2", 1, len(BALL.vertices), 1.0, 1.0, len(samples))
    (folder / "ball.pc2").write_bytes(header + samples.tobytes())
    subject = "ball.pc2, mesh: cache/ball_0001.ply"
    shot = read(folder, subject, "resample: {max_edge_length: 0.4}\n")
    assert (
        len(set(mesh_keys(shot.motion).values()))
        == len(set(mesh_keys(read(folder, subject).motion).values()))
        == 6
    )
    frames = list(animate(shot))
    np.testing.assert_allclose(frames[4].mesh.vertices, place(frames[4].material, 5), atol=1e-6)
    assert "is over. Write frames: 1-6, missing: hold, or loop: true." in told(folder, subject, frames="1-8")
    held = list(animate(read(folder, f"{subject}, missing: hold", frames="1-8")))
    np.testing.assert_array_equal(held[7].mesh.vertices, held[5].mesh.vertices)


@needs_plugins("interchange")
def test_an_animation_whose_samples_are_not_evenly_spaced_goes_on_between_them(folder: Path) -> None:
    rise, times = np.array([0.0, 0.24, 0.0]), np.array([0.0, 1.0, 2.0, 2.5, 4.0, 5.5]) / 24.0
    samples = np.array([BALL.vertices + 24.0 * time * rise for time in times], ">f4")
    header = struct.pack(">ii", len(times), len(BALL.vertices)) + times.astype(">f4").tobytes()
    (folder / "ball.mdd").write_bytes(header + samples.tobytes())
    for faces in ("fixed", "changing"):
        shot = read(folder, f"ball.mdd, mesh: cache/ball_0001.ply, faces: {faces}", frames="1-6")
        for frame in animate(shot):
            risen = BALL.vertices + (frame.number - 1) * rise
            np.testing.assert_allclose(frame.mesh.vertices, risen, atol=1e-6)
            velocity = frame.mesh.attributes["velocity"]
            np.testing.assert_allclose(velocity, np.broadcast_to(24.0 * rise, velocity.shape), atol=2e-3)


@needs_plugins("interchange")
def test_one_of_several_animations_of_a_file_is_chosen_by_its_name(tmp_path: Path) -> None:
    from tests.plugins.interchange.gltf_scenes import box_scene
    from tests.plugins.interchange.test_gltf_motion import animate as animate_node

    scene = box_scene(BALL)
    for name, far in [("Walk", 1.0), ("Run", 3.0)]:
        animate_node(scene, 0, "translation", [0, 0.5], [[0, 0, 0], [far, 0, 0]], name=name)
    scene.glb(tmp_path / "a.glb")
    assert "it has several animations: Walk, Run. Write animation: Walk, or another." in told(
        tmp_path, "a.glb"
    )
    shot = read(tmp_path, "a.glb, animation: Run", frames="1-13")
    frames, keys = list(animate(shot)), mesh_keys(shot.motion)
    assert frames[12].mesh.vertices[:, 0].mean() == pytest.approx(3.0)
    others = mesh_keys(read(tmp_path, "a.glb, animation: Walk", frames="1-13").motion)
    assert not {*keys.values()} & {*others.values()}


def test_one_mesh_for_all_frames_follows_files(folder: Path) -> None:
    shot = read(folder, "cache/ball_####.ply")
    points, motion = BALL.vertices, shot.motion
    for number in range(2, 7):
        points = motion.step_into(motion.flow, number).apply(points)
    np.testing.assert_allclose(points, place(BALL.vertices, 6), atol=1e-12)


def test_a_file_that_changes_during_a_run_is_not_stored_under_the_key_of_the_old_one(folder: Path) -> None:
    shot = read(folder, "cache/splash.#.ply")
    frames = animate(shot)
    next(frames)
    write_splash(folder / "cache", 3)
    text = (folder / "cache/splash.4.ply").read_text()
    (folder / "cache/splash.4.ply").write_text(text.replace("end_header", "comment later\nend_header"))
    with pytest.raises(FrameError, match=r"splash.4.ply: it was changed since the work was planned"):
        list(frames)


@needs_plugins("interchange")
def test_paint_of_the_first_file_stays_on_a_resampled_surface(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    faces = "usemtl red\nf 1/1 2/2 5/3 4/4\nusemtl blue\nf 2/1 3/2 6/3 5/4\n"
    uv = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    for number in range(1, 4):
        points = [(x + number, y, 0.2 * number * x) for y in (0, 1) for x in (0, 1, 2)]
        rows = "".join("v {} {} {}\n".format(*point) for point in points)
        (tmp_path / f"sheet_{number}.obj").write_text(f"mtllib a.mtl\n{rows}{uv}{faces}")
    shot = read(
        tmp_path, "sheet_#.obj, paint: on", "resample: {max_edge_length: 0.3}\nlook: model\n", frames="1-3"
    )
    *_, last = animate(shot)
    paint = shot.motion.painted(last.material, last.mesh.faces)
    middles = last.mesh.vertices[last.mesh.faces].mean(axis=1)
    assert paint is not None
    np.testing.assert_array_equal(paint.materials, (middles[:, 0] > 4.0).astype(int))


@needs_plugins("interchange")
def test_paint_of_a_model_stays_on_its_faces_where_an_animation_begins_in_another_pose(
    tmp_path: Path,
) -> None:
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    flat = np.array([(x, y, 0.0) for y in (0, 1) for x in (0, 1, 2)])
    rows = "".join("v {} {} {}\n".format(*point) for point in flat)
    faces = "usemtl red\nf 1/1 2/2 5/3 4/4\nusemtl blue\nf 2/1 3/2 6/3 5/4\n"
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{rows}vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n{faces}")
    turned = np.array([2.0, 1.0, 0.0]) + flat * [-1.0, -1.0, 1.0]
    samples = np.array([turned, turned + np.array([0.0, 0.0, 1.0])], "<f4")
    (tmp_path / "a.pc2").write_bytes(
        struct.pack("<12siiffi", b"POINTCACHE2", 1, 6, 1.0, 1.0, 2) + samples.tobytes()
    )
    subject = "a.pc2, mesh: a.obj, paint: on"
    shot = read(tmp_path, subject, "resample: {max_edge_length: 0.3}\nlook: model\n", frames="1-2")
    for frame in animate(shot):
        paint = shot.motion.painted(frame.material, frame.mesh.faces)
        middles = frame.mesh.vertices[frame.mesh.faces].mean(axis=1)
        assert paint is not None
        np.testing.assert_array_equal(paint.materials, (middles[:, 0] < 1.0).astype(int))
        assert len(frame.mesh.seams) >= 1
