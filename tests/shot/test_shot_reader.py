"""Shot files: what good ones mean."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.flow import Sequence, Streamlines, keyed
from flowsculpt.pipeline.flow.catalogue.basic import Rotation
from flowsculpt.pipeline.flow.catalogue.deformations import Twist
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.mesh import validate
from flowsculpt.pipeline.mesh.solids import box
from flowsculpt.pipeline.resample import Thresholds
from flowsculpt.pipeline.shot import Motion, Resampling, read_shot
from flowsculpt.render.scene.render_quality import QUALITIES
from tests.mesh_files import write_ply
from tests.needed_plugins import missing

GOOD = (Path(__file__).parent / "cube.yaml").read_text(encoding="utf-8")


def written(folder: Path, text: str, name: str = "a.yaml") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


def test_a_shot_file_becomes_motion_and_picture(tmp_path: Path) -> None:
    shot = read_shot(written(tmp_path, GOOD, "A1_cube.yaml"))
    vortex = Vortex((0.0, 0.0, 1.0), (0.9, 0.0, 0.0), 0.8, keyed((0.0, 1.0), (0.0, 4.0)))
    flow = shot.motion.flow
    assert isinstance(flow, Sequence) and isinstance(flow.flows[0], Streamlines)
    assert flow.flows[0].field.fields == (vortex, Rotation(speed=math.radians(90)))
    assert flow.flows[1] == Twist(amount=keyed((0.0, 2.0), (0.0, 60 * math.radians(1)), "linear"))
    assert (shot.name, shot.title, str(shot.frames), str(shot.rate)) == ("A1_cube", "Cube", "1-49", "24")
    assert shot.picture.camera.at(1.0)[0] == pytest.approx(0.0, abs=1e-12)
    assert shot.picture.camera.at(2.0)[0] == pytest.approx(math.radians(30))


def test_frames_and_seconds_are_never_confused(tmp_path: Path) -> None:
    frames = read_shot(written(tmp_path, GOOD))
    seconds = read_shot(written(tmp_path, GOOD.replace('"2s": 60', "49: 60")))
    assert frames.motion == seconds.motion


def test_a_key_may_have_an_easing_of_its_own(tmp_path: Path) -> None:
    text = GOOD.replace("1: 0, 25: 4", "1: {value: 0, ease: constant}, 25: 4")
    vortex = read_shot(written(tmp_path, text)).motion.flow.flows[0].field.fields[0]  # type: ignore[attr-defined]
    assert vortex.strength.eases == ("constant", "sine_in_out")


def data_of(motion: Motion) -> list[Any]:
    """All that decides the meshes, as keys see it."""
    return [motion.start_data(), *(motion.step_data(frame) for frame in motion.frames.numbers[1:])]


def test_a_motion_is_json_and_equal_data_means_equal_motion(tmp_path: Path) -> None:
    one = data_of(read_shot(written(tmp_path, GOOD)).motion)
    assert json.loads(json.dumps(one)) == one
    commented = GOOD.replace("rate: 24", "rate: 24.0  # film")
    assert data_of(read_shot(written(tmp_path, commented, "b.yaml")).motion) == one
    assert data_of(read_shot(written(tmp_path, GOOD.replace("0.8", "0.7"))).motion) != one


def test_the_budget_of_vertices_is_no_part_of_any_mesh(tmp_path: Path) -> None:
    one, roomier, finer = (
        read_shot(written(tmp_path, GOOD.replace("max_edge_length: 0.25", resample))).motion.start_data()
        for resample in (
            "max_edge_length: 0.25",
            "max_edge_length: 0.25, max_vertices: 9000000",
            "max_edge_length: 0.2",
        )
    )
    assert one == roomier != finer


def test_every_setting_of_the_resampling_stands_in_the_shot(tmp_path: Path) -> None:
    spelt = (
        "max_edge_length: 0.25, method: triangles, placement: curved, splits: edges, min_roundness: 1, "
        "normals: geometric, rest_interval: 12, creases: none"
    )
    resampling = read_shot(written(tmp_path, GOOD.replace("max_edge_length: 0.25", spelt))).motion.resampling
    assert resampling == Resampling(
        Thresholds(0.25), "triangles", "curved", "edges", 1.0, "geometric", 12, "none"
    )
    assert read_shot(written(tmp_path, GOOD)).motion.resampling == Resampling(Thresholds(0.25))


def test_settings_that_another_placement_ignores_are_no_part_of_any_mesh(tmp_path: Path) -> None:
    def data(settings: str) -> Any:
        text = GOOD.replace("max_edge_length: 0.25", f"max_edge_length: 0.25, {settings}")
        return read_shot(written(tmp_path, text)).motion.start_data()

    assert data("placement: chord") == data("placement: chord, rest_interval: 10, normals: geometric")
    assert data("placement: exact") != data("placement: exact, normals: geometric")
    assert data("min_roundness: 0.6") == data("") != data("min_roundness: 0.7")


def test_a_renewal_is_said_by_its_frames_alone(tmp_path: Path) -> None:
    """So that another rhythm goes on from the last frame that both have."""

    def renewing(settings: str) -> list[int]:
        text = GOOD.replace("max_edge_length: 0.25", f"max_edge_length: 0.25, {settings}")
        motion = read_shot(written(tmp_path, text)).motion
        data = {number: motion.step_data(number) for number in motion.frames.numbers[1:]}
        return [number for number, step in data.items() if isinstance(step, dict) and step.get("renewed")]

    assert renewing("rest_interval: 20") == [21, 41]
    assert renewing("rest_interval: 48") == [49]
    assert renewing("rest_interval: 49") == renewing("") == []
    assert renewing("rest_interval: 20, placement: chord") == []
    if not missing("polyhedra"):
        assert renewing("rest_interval: 20, method: polyhedra") == []


def test_without_resampling_a_motion_has_data_too(tmp_path: Path) -> None:
    off = GOOD.replace("{max_edge_length: 0.25}", "off")
    assert read_shot(written(tmp_path, off)).motion.start_data()["resampling"] is None


def test_relighting_changes_the_picture_alone(tmp_path: Path) -> None:
    before = read_shot(written(tmp_path, GOOD))
    after = read_shot(written(tmp_path, GOOD + "look: glaze\nlights: {rig: studio, exposure: 1}\n"))
    assert after.motion == before.motion
    assert after.picture != before.picture


def test_a_shot_may_ask_more_of_one_quality(tmp_path: Path) -> None:
    picture = read_shot(written(tmp_path, GOOD + "quality: {draft: {samples: 6, denoise: high}}\n")).picture
    assert picture.qualities["draft"] == replace(QUALITIES["draft"], samples=6, denoise="high")
    assert {**picture.qualities, "draft": QUALITIES["draft"]} == QUALITIES


def test_a_key_changed_late_leaves_the_earlier_steps_alone(tmp_path: Path) -> None:
    keys = "keys: {1: 0, 25: 4, 30: 4, 49: %s}"
    one, other = (
        read_shot(written(tmp_path, GOOD.replace("keys: {1: 0, 25: 4}", keys % last))).motion
        for last in ("0", "2")
    )
    assert all(one.step_data(frame) == other.step_data(frame) for frame in range(2, 31))
    assert all(one.step_data(frame) != other.step_data(frame) for frame in range(32, 50))
    assert one.start_data() == other.start_data()


def test_a_shot_says_how_its_velocities_are_followed(tmp_path: Path) -> None:
    def motion(text: str) -> Motion:
        return read_shot(written(tmp_path, GOOD.replace("camera:", f"{text}\ncamera:"))).motion

    def settings_of(motion: Motion) -> tuple[Any, ...]:
        assert isinstance(motion.flow, Sequence)
        first = motion.limit_steps(motion.flow, 5)
        assert isinstance(first, Sequence) and isinstance(first.flows[0], Streamlines)
        return first.flows[0].substeps, first.flows[0].tolerance, first.flows[0].max_step

    assert settings_of(motion("")) == settings_of(motion("integrator: rk4")) == (None, None, None)
    assert settings_of(motion("integrator: adaptive")) == (None, 1e-5, None)
    assert settings_of(motion("integrator: adaptive\ntolerance: 0.001\nmax_step: 2")) == (None, 1e-3, 0.5)
    assert settings_of(motion("substeps: 3\nmax_step: 0.1")) == (3, None, 0.025)
    plain, adaptive = motion(""), motion("integrator: adaptive")
    assert plain.step_data(9) != adaptive.step_data(9) and plain.start_data() == adaptive.start_data()


@pytest.mark.parametrize(
    ("lengths", "max_step"),
    [
        ("{keys: {1: 0.2, 49: 0.4}, ease: linear}", 0.1 * (1 + 12 / 48)),
        ("{curvature: {tolerance: 0.01, finest: 0.1, coarsest: 0.3}}", 0.15),
        ("{camera: {position: [0, 0, 6], pixels: 8, finest: 0.1, coarsest: 0.2}}", 0.1),
        ("{formula: 0.2 + 0.1*abs(y)}", None),
    ],
)
def test_maximum_steps_are_shares_of_the_longest_edge_of_their_frame(
    tmp_path: Path, lengths: str, max_step: float | None
) -> None:
    text = GOOD.replace("0.25}", f"{lengths}}}").replace("\ncamera:", "\nmax_step: 0.5\ncamera:")
    motion = read_shot(written(tmp_path, text)).motion
    flow = motion.limit_steps(motion.flow, 13)
    assert isinstance(flow, Sequence) and isinstance(flow.flows[0], Streamlines)
    assert flow.flows[0].max_step == pytest.approx(max_step)


def test_a_model_is_known_by_its_contents(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    for name in ("one.ply", "two.ply"):
        write_ply(box(), tmp_path / "models" / name)
    shots = [
        read_shot(written(tmp_path, GOOD.replace("solid: box", f"model: models/{name}, scale: 2")))
        for name in ("one.ply", "two.ply")
    ]
    assert shots[0].motion.start_data() == shots[1].motion.start_data()
    assert shots[0].motion.subject.build().bounds.tolist() == [[-2.0] * 3, [2.0] * 3]


@pytest.mark.parametrize(
    ("subject", "closed"),
    [
        ("solid: box, size: [1, 2, 3]", True),
        ("solid: icosphere, radius: 2", True),
        ("solid: rod, length: 2, radius: 0.4, caps: flat", True),
        ("solid: torus, radius: 1, tube_radius: 0.2", True),
        ("solid: sheet, size: [2, 3]", False),
    ],
)
def test_every_solid_is_a_sound_mesh_within_the_bracket(tmp_path: Path, subject: str, closed: bool) -> None:
    shot = read_shot(written(tmp_path, GOOD.replace("solid: box", subject)))
    mesh = shot.motion.subject.build(0.25)
    sound = validate(mesh)
    assert sound.sound and sound.closed == closed


@pytest.mark.parametrize("solid", ["box", "icosphere", "rod", "sheet", "torus"])
def test_the_largest_of_numbers_makes_data_that_json_can_hold(tmp_path: Path, solid: str) -> None:
    text = (
        GOOD.replace("solid: box", f"solid: {solid}")
        .replace("25: 4", "25: -1e12, 49: 1e12")
        .replace("radius: 0.8", "radius: 1e-9")
    )
    json.dumps(data_of(read_shot(written(tmp_path, text)).motion), allow_nan=False)


def test_the_documented_shot_is_good(tmp_path: Path) -> None:
    page = Path(__file__).parents[2] / "docs" / "shot-files.md"
    example = page.read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
    assert read_shot(written(tmp_path, example)).motion.resampling is not None
