"""Turntables: the object turns, then the lights; stage, balls and chart stand; looks stand side by side."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import FrameError, UsageError
from flowsculpt.pipeline.mesh import TriangleMesh, icosphere
from flowsculpt.pipeline.plugins.turntable.turntable_frames import TURNS, Turntable
from flowsculpt.pipeline.plugins.turntable.turntable_movie import (
    TurntableRequest,
    TurntableSheets,
    key_numbers,
    turn_and_angle,
)
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.framing import Framer, Framing, rotate_y
from flowsculpt.pipeline.production.request.render_request import MeshAngle, RenderRequest, ShotFrames
from flowsculpt.pipeline.production.request.shot_source import ShotSource
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.camera_path import CameraPath
from flowsculpt.render.base.serialise import from_plain, to_plain
from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.post.image import read_exr, read_png, write_png
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.reference_objects import ball, chart, positions
from flowsculpt.render.scene.render_camera import PERSPECTIVE, Camera
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from flowsculpt.render.scene.surface import Surface
from tests.conftest import commanded, done, lines
from tests.mesh_files import write_ply
from tests.needed_plugins import needs_plugins

NAME = "T010_tiny"
SCALE = "20%"
QUALITY = "draft.scale20"
SHOT = """\
title: A box, twisted
frames: 1-3
subject: {solid: box, size: [2, 1, 1]}
resample: off
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 3: 40}}}
camera: {position: [3, 1, 0], target: [0, 1, 0], roll: 20}
quality: {draft: {samples: 4, auxiliary_samples: 1}}
"""
MESH = TriangleMesh(
    [(0, 0, 0), (2, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
)
LOOKS_OF_SHOW = """\
looks:
  ink: {material: glaze, colour: [0.01, 0.02, 0.2]}
  paper: {material: clay, colour: paper.png}
  wet/ink: {material: ink, roughness: 0.03}
"""
ASPECT = 16 / 9


@dataclass(frozen=True)
class Desk:
    root: Path

    def turning(self, subject: str = NAME, at: int | None = 2, **asked: object) -> TurntableRequest:
        return TurntableRequest(Project(self.root, 2), subject, QUALITY, at, 4, **asked)  # type: ignore[arg-type]

    def command(self, *words: str) -> tuple[int, str]:
        return commanded(self.root, "-j", "2", "turntable", *words)


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    root = tmp_path_factory.mktemp("turntable")
    (root / "shots").mkdir()
    (root / "shots" / f"{NAME}.yaml").write_text(SHOT)
    (root / "shots" / "defaults.yaml").write_text(LOOKS_OF_SHOW)
    write_png(root / "shots" / "paper.png", np.full((2, 2, 3), 200, np.uint8))
    write_ply(MESH, root / "wedge.ply")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        yield Desk(root)


@pytest.fixture(scope="module")
def turned_in_two_looks(desk: Desk) -> Path:
    """Return the folder with the turntables of a shot's second frame, in clay and in glaze."""
    done(desk.root, desk.turning(looks=("clay", "glaze")).plan())
    looks = "--look", "clay,glaze"
    code, said = desk.command(NAME, "--at", "2", "--frames", "4", "--scale", SCALE, *looks, "--json")
    assert code == 0, said
    home = Path("renders/turntable") / f"{NAME}.0002"
    both = home / QUALITY / f"{NAME}.0002.clay-glaze"
    each = [home / look / QUALITY / f"{NAME}.0002.png" for look in ("clay", "glaze")]
    drawn = [both.with_suffix(".clay-glaze.mp4"), both.with_suffix(".clay-glaze.png"), *each]
    assert json.loads(said)["sheets"] == [path.as_posix() for path in drawn]
    return desk.root / home


def seen(folder: Path, kind: str, layer: str) -> list[np.ndarray]:
    return [read_exr(path)[0][layer] for path in sorted((folder / QUALITY / kind).glob("*.exr"))]


def raw_keys(request: RenderRequest) -> dict[int, str]:
    framing = Framing(Camera((0, 1, 9), (0, 1, 0)), StagePlacement())
    return {
        number: request.keys.raw(number, dict.fromkeys(request.angles, framing))
        for number in request.requested
    }


def test_the_object_turns_first_and_then_the_lights_each_without_its_end_point() -> None:
    angles = Turntable(at=7, frames=4).angles()
    quarters = [0.0, math.pi / 2, math.pi, 3 * math.pi / 2]
    assert list(angles) == list(range(1, 9))
    assert [angles[n] for n in range(1, 5)] == [MeshAngle(7, spin=angle) for angle in quarters]
    assert [angles[n] for n in range(5, 9)] == [MeshAngle(7, lights=angle) for angle in quarters]


def test_a_turntable_of_a_wide_shot_is_seen_in_perspective_and_its_parts_do_not_loop(tmp_path: Path) -> None:
    text = "title: A\nframes: 1-4\nsubject: {solid: icosphere}\nresample: off\nloop: {dissolve: 2}\n"
    (tmp_path / "a.yaml").write_text(text + "camera: {projection: dome}\n")
    shown = Project(tmp_path, 1, "llvm_ad_rgb").request(tmp_path / "a.yaml", "draft")
    turned = replace(shown, frame_source=Turntable(1, 4)).whole()
    assert shown.pictures.quality.rendered_size == (384, 384) and shown.loop == ("dissolve", 2)
    assert turned.pictures.quality.rendered_size == (480, 270) and turned.loop is None
    assert turned.pictures.projection == PERSPECTIVE and turned.pictures.flat_aspect == ASPECT
    view = turned.pictures.view(1)
    assert view.wide is None and np.degrees(view.field_of_view) == pytest.approx(40.0)
    assert shown.pictures.view(1).wide is not None


@pytest.mark.parametrize(("look", "follows"), [("speed", True), ("strain", False)])
def test_a_turntable_shows_the_speed_of_the_flow_at_its_frame(look: str, follows: bool) -> None:
    begin = f"title: A\nframes: 1-6\nsubject: {{solid: icosphere}}\nresample: off\nlook: {look}\nflows:\n"
    late = "  - translation: {rate: {ease: linear, keys: {1: [0, 0, 0], 3: [0, 0, 0], 6: [%d, 0, 0]}}}\n"
    table = Turntable(at=3, frames=4)
    requests = [
        RenderRequest(ShotSource(begin + late % rate, Path("a.yaml")), "draft", "none", (), table).whole()
        for rate in (8, 9)
    ]
    before, after = map(raw_keys, requests)
    assert [before[number] != after[number] for number in range(1, 9)] == [follows] * 8
    assert requests[0].pictures.follows_flow(2) == follows


def test_a_plan_keeps_its_turntable_and_one_of_a_shot_names_none(desk: Desk) -> None:
    (request,) = desk.turning().requests
    plain = to_plain(request)
    assert plain["turntable"] == {"at": 2, "frames": 4, "of_file": False, "look": None}
    assert from_plain(RenderRequest, plain) == request
    shown = replace(request, frame_source=ShotFrames())
    assert "turntable" not in to_plain(shown)
    assert from_plain(RenderRequest, {**to_plain(shown), "turntable": None}) == shown, "as earlier versions"


def test_pictures_are_the_same_whichever_turns_are_asked_for(desk: Desk) -> None:
    both, *alone = (raw_keys(desk.turning(turn=turn).requests[0]) for turn in ("both", *TURNS))
    assert alone[0] | alone[1] == both
    assert len(set(both.values())) == 8


@pytest.mark.slow
def test_every_picture_of_the_lights_turn_shows_the_same_object_in_another_light(
    turned_in_two_looks: Path,
) -> None:
    mattes = seen(turned_in_two_looks / "clay", "raw", "matte")
    light = seen(turned_in_two_looks / "clay", "frames", "beauty")
    assert len(mattes) == len(light) == 8
    assert all(np.abs(matte - mattes[0]).mean() > 0.01 for matte in (mattes[1], mattes[3]))
    inside = mattes[4][..., 0] if mattes[4].ndim == 3 else mattes[4]
    for number in range(5, 8):
        assert np.abs(mattes[number] - mattes[4]).mean() < 0.02
        assert np.abs(light[number] - light[4])[inside > 0.99].mean() > 0.02
    cameras = json.loads((turned_in_two_looks / "clay" / f"{NAME}.0002.cameras.json").read_text())
    assert len(cameras) == 8 and all(camera == cameras["1"] for camera in cameras.values())


def test_looks_share_what_they_have_in_common_and_have_a_movie_side_by_side(
    desk: Desk, turned_in_two_looks: Path
) -> None:
    alone = probe_movie(turned_in_two_looks / "glaze" / QUALITY / f"{NAME}.0002.mp4")
    together = probe_movie(turned_in_two_looks / QUALITY / f"{NAME}.0002.clay-glaze.mp4")
    assert alone.frames == together.frames == 8
    assert together.width > 2 * alone.width and together.height > alone.height
    sheet = read_png(turned_in_two_looks / "clay" / QUALITY / f"{NAME}.0002.png")
    both = read_png(turned_in_two_looks / QUALITY / f"{NAME}.0002.clay-glaze.png")
    assert sheet.shape[1] <= both.shape[1] and sheet.shape[0] < both.shape[0]

    def to_do(**asked: object) -> dict[str, int]:
        return dict(desk.turning(**asked).plan().frame_counts())

    assert to_do(looks=("clay", "glaze")) == {}
    assert to_do(looks=("clay", "glaze"), turn="lights") == {"assemble": 8}
    assert to_do(looks=("chrome", "glass")) == {"render": 16, "finish": 16, "assemble": 16}
    again = turned_in_two_looks / QUALITY / f"{NAME}.0002.clay-glaze.mp4"
    before = again.stat().st_mtime_ns
    words = (NAME, "--at", "2", "--frames", "4", "--scale", SCALE, "--look", "clay, glaze,clay")
    code, said = desk.command(*words)
    assert code == 0 and said.startswith("Nothing to be done"), said
    assert again.stat().st_mtime_ns == before


def test_a_damaged_picture_makes_no_sheet_and_is_told(desk: Desk, turned_in_two_looks: Path) -> None:
    turning = desk.turning(turn="lights", looks=("clay", "glaze"))
    request = turning.requests[0]
    keys = request.keys.pictures(turning.project.store)
    assert keys is not None
    path = turning.project.store.path("frame", keys[6].frame)
    whole = path.read_bytes()
    path.chmod(0o644)
    path.write_bytes(whole[:-99])
    try:
        with pytest.raises(FrameError, match=f"{NAME}.0002.0006.exr is damaged"):
            TurntableSheets(turning).draw()
    finally:
        path.write_bytes(whole)
    assert not (turned_in_two_looks / "clay" / QUALITY / f"{NAME}.0002.lights.png").exists()


def test_a_mesh_file_in_several_looks_is_read_once(desk: Desk) -> None:
    plan = desk.turning("wedge.ply", at=None, looks=("clay", "glaze", "chrome")).plan()
    made = plan.frame_counts()
    assert made["simulate"] == made["smooth_normals"] == 1 and made["frame_camera"] == 8
    assert made["render"] == made["finish"] == 24
    homes = {Path(target).parts[2:4] for target in plan.targets if target.endswith(".mp4")}
    assert homes == {("wedge", look) for look in ("clay", "glaze", "chrome")}


@pytest.mark.parametrize(
    ("suffix", "up", "height"),
    [("stl", None, 4.0), ("stl", "y", 3.0), ("stl", "z", 4.0), ("obj", None, 3.0), ("obj", "z", 4.0)],
)
def test_mesh_files_stand_with_the_usual_axis_of_their_format_up_or_the_one_asked_for(
    desk: Desk, suffix: str, up: str | None, height: float
) -> None:
    from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh

    box = icosphere(2)
    low, high = box.vertices.min(axis=0), box.vertices.max(axis=0)
    write_mesh(
        box.with_vertices((box.vertices - low) / (high - low) * [2.0, 3.0, 4.0]), desk.root / f"tall.{suffix}"
    )
    (request,) = desk.turning(f"tall.{suffix}", at=None, up=up).requests
    assert np.ptp(request.shot.motion.subject.build().vertices[:, 1]) == pytest.approx(height, rel=1e-6)


@pytest.mark.parametrize(("subject", "up"), [(NAME, "z"), ("wedge.ply", "x")])
def test_up_is_refused_for_shots_and_for_other_axes(desk: Desk, subject: str, up: str) -> None:
    with pytest.raises(UsageError, match=f"--up {up}"):
        desk.turning(subject, up=up)


def test_balls_and_chart_stand_beside_it_unless_it_is_to_be_bare(desk: Desk) -> None:
    (request,), (bare,) = desk.turning().requests, desk.turning(bare=True).requests
    assert request.shot.picture.stage == STAGES["turntable"]
    assert bare.shot.picture.stage == STAGES["cyclorama"]
    assert request.pictures.view(1).roll == 0.0 and request.pictures.view(1).position is None
    assert request.pictures.view(1).azimuth == pytest.approx(math.pi / 2)
    assert bare.pictures.view(1).roll != 0.0 and bare.pictures.view(1).position is not None


def test_looks_that_the_show_names_are_looks_of_shots_and_of_mesh_files(desk: Desk) -> None:
    for subject, at in ((NAME, 2), ("wedge.ply", None)):
        requests = desk.turning(subject, at, looks=("ink", "paper")).requests
        ink, paper = (request.shot.picture.look for request in requests)
        assert ink == LOOKS["glaze"].with_values(colour=(0.01, 0.02, 0.2))
        assert str(Path("shots/paper.png").absolute()) in repr(paper)


def test_settings_count_over_what_turntables_take_for_granted(desk: Desk) -> None:
    project = Project(desk.root, 2, settings=("stage=plinth",))
    (request,) = TurntableRequest(project, NAME, QUALITY, 2, 4, looks=("chrome",)).requests
    assert request.shot.picture.stage.kind == STAGES["plinth"].kind
    assert request.movie_path.name == f"{NAME}.0002.mp4"


@pytest.mark.parametrize(
    ("frames", "turns", "angles"),
    [
        (72, TURNS, "0 45 90 135 180 225 270 315 0 90 180 270"),
        (72, ("lights",), "0 90 180 270"),
        (4, ("object",), "0 90 180 270"),
        (3, TURNS, "0 120 240 0 120 240"),
        (100, ("object",), "0 43.2 90 136.8 180 223.2 270 316.8"),
    ],
)
def test_sheets_show_the_pictures_nearest_to_eighths_and_quarters(
    frames: int, turns: tuple[str, ...], angles: str
) -> None:
    table = Turntable(1, frames)
    found = [turn_and_angle(table, number) for number in key_numbers(table, turns)]
    assert [angle for _, angle in found] == [f"{angle}°" for angle in angles.split()]
    assert list(dict.fromkeys(turn for turn, _ in found)) == list(turns)


cameras = st.builds(
    CameraPath,
    azimuth=st.floats(-3.0, 3.0),
    elevation=st.floats(-0.2, 0.9),
    field_of_view=st.floats(0.2, 1.5),
    margin=st.floats(0.0, 0.2),
    roll=st.floats(-1.0, 1.0),
    dolly=st.floats(0.2, 3.0),
    distance=st.none() | st.floats(0.5, 50.0),
    target=st.none() | st.tuples(*[st.floats(-5.0, 5.0)] * 3),
    position=st.none(),
    aperture=st.none() | st.just(1.4),
)
sizes = st.tuples(*[st.floats(0.2, 4.0)] * 3)


@settings(max_examples=40, deadline=None)
@given(cameras, sizes, st.sampled_from([ASPECT, 9 / 16, 1.0, 2.39]))
def test_through_the_whole_turn_the_object_touches_neither_balls_nor_chart(
    camera: CameraPath, size: tuple[float, ...], aspect: float
) -> None:
    box = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size
    angles = [rotate_y(box, angle) for angle in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)]
    shot = read_shot(Path("turn.yaml"), SHOT + "stage: turntable\n")
    turned = Turntable(1, 12).adapt_shot(replace(shot, picture=replace(shot.picture, camera=camera)))
    (framing, *_) = Framer(
        ([turned.picture.camera.at(0.0)] * 12), angles.__getitem__, aspect, follow=0.0
    ).all()
    framing = framing.with_stage_in_view(STAGES["turntable"], aspect)
    seen = framing.camera
    object_ = np.concatenate([seen.project(angle, aspect) for angle in angles])
    grey, chrome, board = positions(seen, framing.placement, aspect)
    pieces: list[Surface] = [ball(grey), ball(chrome), chart(board, seen)]
    projected = [seen.project(piece.vertices, aspect) for piece in pieces]
    assert np.abs(object_[:, :2]).max() < 1.0
    # A wide lens stretches the balls a little.
    assert max(piece[:, 1].max() for piece in projected) < object_[:, 1].min() + 0.02
    assert all(np.abs(piece[:, :2]).max() < 1.0 for piece in projected)


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("none.ply",), 3, "none.ply: no such mesh file"),
        (("T010_tinny",), 3, "did you mean T010_tiny"),
        ((NAME, "--at", "9"), 2, "frame 9 is not in T010_tiny, which has frames 1-3"),
        ((NAME, "--frames", "0"), 2, "a turntable of 0 frames does not turn"),
        ((NAME, "--frames", "1"), 2, "72"),
        ((NAME, "--look", "clay,glace"), 2, "'glace' is not a look. Did you mean 'glaze'?"),
        (("wedge.ply", "--look", "inck"), 2, "'inck' is not a look. Did you mean 'ink'?"),
        (("wedge.ply", "--look", "wet/ink"), 2, "'wet/ink' cannot name a folder of pictures"),
        ((NAME, "--look", "swell.gold"), 2, "It needs plug-in swell, which is not installed"),
        ((NAME, "--look", " ,"), 2, "--look names no look"),
        ((NAME, "--turn", "light"), 2, "--turn light: it does not turn. Did you mean 'lights'?"),
    ],
)
def test_what_cannot_be_turned_is_told_in_one_line(
    desk: Desk, words: tuple[str, ...], code: int, says: str
) -> None:
    found, said = desk.command(*words)
    assert found == code
    assert says in said
    assert len(said.strip().splitlines()) == 1


@needs_plugins("interchange")
@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("empty.obj", "v 0 0 0\n", "no faces"),
        ("nan.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
    ],
)
def test_a_mesh_that_is_no_surface_is_refused_in_one_line(project, name, text, says):
    (project.path / name).write_text(text)
    done = project.call("turntable", name, "--frames", "2")
    assert done.code == 2
    assert says in done.err
    assert name in done.err
    assert len(lines(done.err)) == 1


def pixels(paths):
    return [read_exr(path)[0]["beauty"] for path in paths]


def test_a_turntable_turns_a_mesh_file_once_around(project):
    write_ply(MESH, project.path / "wedge.ply")
    done = project.run("turntable", "wedge.ply", "--frames", "4", "--turn", "object", "--bare", "-q", QUALITY)
    assert done.code == 0, done.err
    folder = project.path / "renders/turntable/wedge" / QUALITY
    first, *others = pixels(sorted((folder / "frames").glob("*.exr")))
    assert len(others) == 3
    assert all(np.abs(first - other).max() > 0.05 for other in others)
    assert probe_movie(folder / "wedge.object.mp4").frames == 4
