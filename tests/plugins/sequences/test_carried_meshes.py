"""One mesh of sequences whose faces change: how near it is to the files, and what is refused."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.flow.regions import TriangleTree
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, sheet
from flowsculpt.pipeline.mesh.normals import vertex_normals
from flowsculpt.pipeline.production.store.store import Store
from tests.conftest import commanded
from tests.mesh_files import write_ply
from tests.needed_plugins import needs_plugins

pytestmark = needs_plugins("interchange")

Place = Callable[[np.ndarray, float], np.ndarray]


def write(folder: Path, number: int, rest: TriangleMesh, place: Place, moves: bool = True) -> TriangleMesh:
    """Write a file of a surface at rest, moved to a frame, with its velocities at 24 frames a second."""
    points = place(rest.vertices, number)
    speed = (place(rest.vertices, number + 0.01) - place(rest.vertices, number - 0.01)) / 0.02 * 24.0
    named = dict(zip(("vx", "vy", "vz"), speed.T, strict=True)) if moves else {}
    write_ply(TriangleMesh(points, rest.faces, named), folder / "cache" / f"s_{number:04d}.ply")
    return TriangleMesh(points, rest.faces)


def shot(folder: Path, frames: str) -> Path:
    path = folder / "shots/T010_s.yaml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(f"title: S\nframes: {frames}\nsubject: {{sequence: ../cache/s_####.ply}}\n")
    return path


def carried(folder: Path, frames: str, **settings: float | int) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Return the faces of one mesh of all frames, and its points in each."""
    from flowsculpt.pipeline.plugins.interchange.unifying import Unification
    from tests.plugins.interchange.unified_shots import of_text

    request = of_text(folder / "shots", shot(folder, frames).read_text())
    mesh = Unification(request, Store(folder), **settings).one_mesh()  # type: ignore[arg-type]
    return mesh.faces, {number: mesh.frame(number).points for number in mesh.frames}


def away(points: np.ndarray, mesh: TriangleMesh) -> float:
    """Return the largest distance of points from a surface."""
    face, shares = TriangleTree.of(mesh.vertices[mesh.faces]).nearest(points)
    a, b, c = mesh.vertices[mesh.faces[face]].swapaxes(0, 1)
    return float(np.linalg.norm(a + shares[:, :1] * (b - a) + shares[:, 1:] * (c - a) - points, axis=1).max())


def sides_of(mesh: TriangleMesh) -> np.ndarray:
    corners = mesh.vertices[mesh.faces]
    return np.asarray(np.roll(corners, 1, axis=1) - corners)


def apart(faces: np.ndarray, points: np.ndarray, file: TriangleMesh) -> float:
    """Return the largest distance of a mesh and a file's surface, both ways, in median edges of the file."""
    ours = TriangleMesh(points, faces)
    edge = np.median(np.linalg.norm(sides_of(file), axis=2))
    both = [(ours, file), (file, ours)]
    return max(away(one.scattered(4000, 3)[0], other) for one, other in both) / float(edge)


def turned_ball(number: int) -> TriangleMesh:
    """Return a ball whose triangles are others in each frame."""
    turn, _ = np.linalg.qr(np.random.default_rng(number).normal(size=(3, 3)))
    turn[0] *= np.linalg.det(turn)
    ball = icosphere(10 + number % 3)
    return ball.with_vertices(ball.vertices @ turn.T)


def stretched(points: np.ndarray, frame: float) -> np.ndarray:
    """Return where points of a ball are while it turns and becomes three times as long."""
    angle, long = 0.15 * frame, 1.0 + 0.25 * frame
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return points * [long, long**-0.5, long**-0.5] @ turn.T


@pytest.fixture(scope="module")
def balls(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[int, TriangleMesh]]:
    folder = tmp_path_factory.mktemp("balls")
    return folder, {n: write(folder, n, turned_ball(n), stretched) for n in range(1, 9)}


@pytest.mark.slow
def test_one_mesh_stays_on_a_ball_that_turns_stretches_and_is_meshed_again(
    balls: tuple[Path, dict[int, TriangleMesh]],
) -> None:
    folder, files = balls
    faces, points = carried(folder, "1-8", carry_from=1)
    for number, file in files.items():
        assert apart(faces, points[number], file) < 0.25
    lengths = np.linalg.norm(points[8][faces] - np.roll(points[8][faces], 1, axis=1), axis=2)
    assert len(points[1]) > len(files[1].vertices), "it is refined where it stretches"
    assert np.quantile(lengths, 0.99) < 3 * np.median(lengths)


@pytest.mark.slow
def test_one_mesh_follows_a_ball_that_is_drawn_out_and_meshed_finer(tmp_path: Path) -> None:
    def drawn_out(points: np.ndarray, frame: float) -> np.ndarray:
        long = 1.0 + frame
        return points * [long, long**-0.5, long**-0.5]

    files = {n: write(tmp_path, n, icosphere(4 + 8 * n), drawn_out) for n in range(3)}
    faces, points = carried(tmp_path, "0-2", carry_from=0)
    for number, file in files.items():
        assert apart(faces, points[number], file) < 0.25
    sides = points[2][faces] - np.roll(points[2][faces], 1, axis=1)
    ours, theirs = (np.quantile(np.linalg.norm(each, axis=-1), 0.99) for each in (sides, sides_of(files[2])))
    assert ours < 2.0 * theirs


def test_material_stays_where_velocities_carry_it(balls: tuple[Path, dict[int, TriangleMesh]]) -> None:
    _, points = carried(balls[0], "1-8")
    at_rest = points[5] @ np.linalg.inv(stretched(np.eye(3), 5))
    off = np.linalg.norm(stretched(at_rest, 8) - points[8], axis=1)
    assert np.quantile(off, 0.95) < 0.02


def test_two_files_of_the_same_faces_carry_the_mesh_where_velocities_miss_a_sudden_start(
    tmp_path: Path,
) -> None:
    def jump(points: np.ndarray, frame: float) -> np.ndarray:
        return points + np.array([0.4, 0.0, 0.0]) * (round(frame) >= 2)

    for number, ball in ((1, turned_ball(1)), (2, turned_ball(1)), (3, turned_ball(3))):
        write(tmp_path, number, ball, jump)
    _, points = carried(tmp_path, "1-3", carry_from=1)
    np.testing.assert_allclose(
        points[2] - points[1], np.tile([0.4, 0.0, 0.0], (len(points[1]), 1)), atol=1e-6
    )


@pytest.mark.parametrize("grows", [False, True])
def test_a_mesh_that_gets_no_nearer_or_only_larger_is_soon_given_up(grows: bool) -> None:
    from flowsculpt.pipeline.plugins.interchange.carrying import ENOUGH_ROUNDS, PATIENCE, Carrier, Deviation
    from flowsculpt.pipeline.plugins.interchange.shown_surfaces import CarriedFaces, Places, ShownSurface

    class NeverNear(Carrier):
        def _far_frames(self, faces: CarriedFaces, *others: object) -> list[int]:
            self._deviations = {2: Deviation(1.0, (0.0, 0.0, 0.0))}
            self._mark(faces.edges[:1], np.ones(1), np.full(1, 2.0))
            return [2]

        def _compare_edges(self, shown: ShownSurface, edges: np.ndarray, here: Places) -> None:
            many = edges[: len(here.points) // 8] if grows else edges[:0]
            self._mark(many, np.ones(len(many)), np.full(len(many), 2.0))

    rounds = list[str]()
    ball = ShownSurface(1, 0.0, icosphere(8), 1.0)
    carrier = NeverNear(lambda number: ball, range(1, 3), 1, 0.25, 100_000)
    carrier.carried(lambda name, count: rounds.append(name) or (lambda: None))  # type: ignore[func-returns-value]
    assert len(rounds) <= max(ENOUGH_ROUNDS, PATIENCE) + 2


def test_its_normals_are_those_of_the_files(balls: tuple[Path, dict[int, TriangleMesh]]) -> None:
    from flowsculpt.pipeline.plugins.interchange.unifying import Unification
    from tests.plugins.interchange.unified_shots import of_text

    request = of_text(balls[0] / "shots", shot(balls[0], "1-8").read_text())
    frame = Unification(request, Store(balls[0])).one_mesh().frame(8)
    file = balls[1][8]
    face, shares = TriangleTree.of(file.vertices[file.faces]).nearest(frame.points)
    weights = np.column_stack([1 - shares.sum(axis=1), shares])
    theirs = np.einsum("nk,nkj->nj", weights, vertex_normals(file)[file.faces[face]])
    theirs /= np.linalg.norm(theirs, axis=1, keepdims=True)
    degrees = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", theirs, frame.normals), -1, 1)))
    assert np.quantile(degrees, 0.95) < 5.0


def test_both_sides_of_a_thin_plate_stay_apart_and_its_edges_stay_sharp(tmp_path: Path) -> None:
    def place(points: np.ndarray, frame: float) -> np.ndarray:
        return points + np.array([0.0, 0.05 * frame**2, 0.0])

    files = {n: write(tmp_path, n, box((2.0, 0.02, 2.0), 0.2 + 0.03 * (n % 3)), place) for n in range(1, 6)}
    faces, points = carried(tmp_path, "1-5")
    side = {n: points[n][:, 1] > 0.05 * n**2 for n in files}
    for number, file in files.items():
        np.testing.assert_array_equal(side[number], side[3])
        assert apart(faces, points[number], file) < 0.01


def test_a_cloth_keeps_its_rim(tmp_path: Path) -> None:
    def place(points: np.ndarray, frame: float) -> np.ndarray:
        x, y, z = points.T
        return np.column_stack([x + 0.1 * frame * z, y + 0.1 * frame * np.sin(2 * x), z])

    files = {n: write(tmp_path, n, sheet((2.0, 2.0), 0.12 + 0.02 * (n % 3)), place) for n in range(1, 6)}
    faces, points = carried(tmp_path, "1-5")
    for number, file in files.items():
        assert apart(faces, points[number], file) < 0.25


def drops(folder: Path) -> None:
    """Write two drops that near each other and are one from frame 5 on."""
    ball = icosphere(10)
    for number in range(1, 7):
        apart = 1.25 - 0.05 * number if number < 5 else 1.15 - 0.05 * number
        moves = np.array([-0.05 * 24.0, 0.0, 0.0])
        if number < 5:
            away = np.array([apart, 0.0, 0.0])
            points = np.concatenate([ball.vertices + away, ball.vertices - away])
            faces = np.concatenate([ball.faces, ball.faces + len(ball.vertices)])
        else:
            x = ball.vertices[:, :1]
            points, faces = ball.vertices * (apart * abs(x) + np.sqrt(1 - apart**2 * (1 - x**2))), ball.faces
        speed = np.sign(points[:, :1]) * moves
        named = dict(zip(("vx", "vy", "vz"), speed.T, strict=True))
        write_ply(TriangleMesh(points, faces, named), folder / "cache" / f"s_{number:04d}.ply")


@pytest.mark.slow
def test_drops_that_merge_are_refused_at_that_frame_and_place_and_followed_before(tmp_path: Path) -> None:
    drops(tmp_path)
    words = "export", "gltf", str(shot(tmp_path, "1-6"))
    code, said = commanded(tmp_path, *words)
    assert code == 1
    assert "frame 5: the surface merges or splits at (" in said and "-f 1-4" in said
    assert "it has 1 part, 0 handles and 0 rims, and 2 parts, 0 handles and 0 rims in frame 4" in said
    place = np.array(said.split("splits at (")[1].split(")")[0].split(","), float)
    assert np.linalg.norm(place) < 0.6
    assert not list((tmp_path / "renders").rglob("*.glb"))
    code, said = commanded(tmp_path, *words, "-f", "1-4")
    assert code == 0 and "4 frames" in said
    assert len(list((tmp_path / "renders").rglob("*.glb"))) == 1


@pytest.mark.slow
def test_a_surface_that_the_velocities_do_not_lead_to_is_refused_with_frame_and_remedy(
    tmp_path: Path,
) -> None:
    for number in range(1, 6):
        write(tmp_path, number, turned_ball(number), lambda p, n: p + 3.0 * (round(n) == 5))
    code, said = commanded(tmp_path, "export", "abc", str(shot(tmp_path, "1-5")), "--carry-from", "2")
    assert code == 1
    assert "frame 5: the mesh of frame 2, carried here, is" in said
    assert "Choose -f 1-4 --carry-from 2, which is carried already" in said, (
        "with the mesh that is near there"
    )
    assert not list((tmp_path / "renders").rglob("*.abc"))


def test_a_cloth_that_is_wound_the_other_way_round_from_a_frame_on_is_refused_there(tmp_path: Path) -> None:
    for number in range(1, 6):
        cloth = sheet((2.0, 2.0), 0.2 + 0.02 * (number % 3))
        faces = cloth.faces if number > 3 else cloth.faces[:, ::-1]
        write(tmp_path, number, TriangleMesh(cloth.vertices, faces), lambda p, n: p + 0.01 * n)
    with pytest.raises(FrameError, match=r"frame 3: .* faces, which may be wound the other way") as refused:
        carried(tmp_path, "1-5", carry_from=5)
    assert options_of(refused.value) == ("4-5", 5)


def options_of(error: FrameError) -> tuple[str, int]:
    """Return the frames of the command in a message, and the frame whose mesh is carried."""
    found = re.search(r"Choose -f (\S+) --carry-from (\d+), which is carried already", str(error))
    assert found, str(error)
    return found[1], int(found[2])


@pytest.mark.parametrize("seed", range(3))
def test_the_command_of_a_refusal_succeeds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """The surface jumps to where no velocity leads, before or after the frame that the mesh begins with."""
    from flowsculpt.pipeline.plugins.interchange import carrying

    monkeypatch.setattr(carrying, "MOST_ROUNDS", 2)
    drawn = np.random.default_rng(seed)
    jump, away = int(drawn.integers(2, 5)), drawn.normal(size=3) + 3.0
    for number in range(1, 6):
        write(tmp_path, number, turned_ball(number), lambda p, n: p + away * (round(n) >= jump))
    start = jump + 1 if drawn.random() < 0.5 else jump - 1
    with pytest.raises(FrameError) as refused:
        carried(tmp_path, "1-5", carry_from=start)
    if "Choose" not in str(refused.value):
        assert start == 1 == jump - 1, "one frame alone is near"
        return
    frames, start = options_of(refused.value)
    faces, points = carried(tmp_path, frames, carry_from=start)
    assert set(points) < {1, 2, 3, 4, 5} and len(points) > 1
    for number, here in points.items():
        file = turned_ball(number)
        assert apart(faces, here, file.with_vertices(file.vertices + away * (number >= jump))) < 0.25


def test_a_refusal_names_frames_that_a_mesh_was_carried_through(
    balls: tuple[Path, dict[int, TriangleMesh]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mesh of fewer frames is another one, so it may be refused where the first was near."""
    from flowsculpt.pipeline.plugins.interchange import carried_sequence, carrying

    class Refusing(carrying.Carrier):
        def carried(self, began: Callable[[str, int], Callable[[], None]]) -> carrying.CarriedMesh:
            mesh = super().carried(began)
            for number in {6: (5, 6), 5: (5,)}.get(self.numbers[-1], ()):
                mesh.deviations[number] = carrying.Deviation(3.0, (0.0, 0.0, 0.0))
            return mesh

    (tmp_path / "cache").symlink_to(balls[0] / "cache")
    monkeypatch.setattr(carried_sequence, "Carrier", Refusing)
    monkeypatch.setattr(carrying, "MOST_ROUNDS", 1)
    with pytest.raises(FrameError, match="frame 5: the mesh of frame 4") as refused:
        carried(tmp_path, "2-6", tolerance=2.0)
    assert options_of(refused.value) == ("2-4", 4)
    monkeypatch.setattr(carried_sequence, "Carrier", None)
    assert set(carried(tmp_path, "2-4", tolerance=2.0, carry_from=4)[1]) == {2, 3, 4}, "it is stored"


def test_a_vertex_is_drawn_to_a_tip_that_faces_cut_off() -> None:
    from flowsculpt.pipeline.plugins.interchange.carrying import Carrier
    from flowsculpt.pipeline.plugins.interchange.shown_surfaces import CarriedFaces, ShownSurface

    ball = icosphere(10)
    points = ball.vertices.copy()
    points[40] *= 1.0 + 0.3 / 10
    blunt, file = (ShownSurface(2, 0.0, ball.with_vertices(p), 1.0) for p in (ball.vertices, points))
    here, carrier = blunt.vertices_places(), Carrier(lambda number: file, range(1, 3), 1, 0.25, 10_000)
    away = carrier._compared(file, CarriedFaces(ball), here).distance
    drawn = carrier._drawn_to_tips(file, CarriedFaces(ball), here)
    assert away > 0.2 and carrier._compared(file, CarriedFaces(ball), drawn).distance < 0.01
    np.testing.assert_array_equal(np.flatnonzero((drawn.points != here.points).any(axis=1)), [40])


def test_a_vertex_on_an_edge_of_a_box_is_drawn_to_the_corner_that_faces_cut_off() -> None:
    from flowsculpt.pipeline.plugins.interchange.carrying import Carrier
    from flowsculpt.pipeline.plugins.interchange.shown_surfaces import CarriedFaces, ShownSurface

    solid = box((2.0, 2.0, 2.0), 0.25)
    file = ShownSurface(2, 0.0, solid, 0.7)
    here = file.vertices_places()
    corner = int(np.argmax(solid.vertices.sum(axis=1)))
    here = here._replace(points=solid.vertices.copy())
    here.points[corner] -= [0.1, 0.0, 0.0]
    faces, carrier = CarriedFaces(file.with_creases()), Carrier(lambda number: file, range(1, 3), 1, 0.25, 0)
    assert carrier._compared(file, faces, here).distance > 0.2
    drawn = carrier._drawn_to_tips(file, faces, here)
    np.testing.assert_allclose(drawn.points, solid.vertices, atol=1e-12)


def test_settings_of_a_carried_mesh_are_checked(balls: tuple[Path, dict[int, TriangleMesh]]) -> None:
    with pytest.raises(UsageError, match="--carry-from 9: the frames are 1-8"):
        carried(balls[0], "1-8", carry_from=9)
    with pytest.raises(UsageError, match="such a mesh is not reduced"):
        carried(balls[0], "1-8", vertices=100)


def test_a_page_says_why_such_a_mesh_does_not_play_without_options_of_an_export(
    balls: tuple[Path, dict[int, TriangleMesh]],
) -> None:
    from flowsculpt.pipeline.plugins.interchange.animation_export import animation
    from tests.plugins.interchange.unified_shots import of_text

    request = of_text(balls[0] / "shots", shot(balls[0], "1-8").read_text())
    with pytest.raises(UsageError, match=f"^{request.name} has other faces in each frame$"):
        animation(request, Store(balls[0]), 1000)
