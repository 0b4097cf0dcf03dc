"""Shot files: what good ones mean, and what bad ones are told."""

from __future__ import annotations

import contextlib
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.errors import MissingInputError, ShotError
from pipeline.flow import Sequence, Streamlines, keyed
from pipeline.flow.catalogue import Rotation, Twist, Vortex
from pipeline.mesh import validate, write_mesh
from pipeline.mesh.solids import box
from pipeline.resample import Thresholds
from pipeline.shot import Motion, Resampling, read_film, read_shot
from render.quality import QUALITIES

GOOD = """\
title: Cube
frames: 1-49
rate: 24
subject: {solid: box}
resample: {max_edge_length: 0.25}
flows:
  - sum:
      - vortex: {axis: z, centre: [0.9, 0, 0], radius: 0.8, strength: {keys: {1: 0, 25: 4}}}
      - rotation: {speed: 90}
  - twist: {amount: {ease: linear, keys: {1: 0, "2s": 60}}}
camera: {azimuth: {keys: {1: -30, 49: 30}}}
"""


def written(folder: Path, text: str, name: str = "a.yaml") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


def told(folder: Path, text: str) -> list[str]:
    """The messages of a bad shot, without the folder."""
    with pytest.raises((ShotError, MissingInputError)) as error:
        read_shot(written(folder, text))
    return str(error.value).replace(f"{folder}/", "").split("\n")


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
        "max_edge_length: 0.25, method: polyhedra, placement: curved, splits: faces, shape: 1, "
        "normals: geometric, renew: 12, creases: none"
    )
    resampling = read_shot(written(tmp_path, GOOD.replace("max_edge_length: 0.25", spelt))).motion.resampling
    assert resampling == Resampling(
        Thresholds(0.25), "polyhedra", "curved", "faces", 1.0, "geometric", 12, "none"
    )
    assert read_shot(written(tmp_path, GOOD)).motion.resampling == Resampling(Thresholds(0.25))


def test_settings_that_another_placement_ignores_are_no_part_of_any_mesh(tmp_path: Path) -> None:
    def data(settings: str) -> Any:
        text = GOOD.replace("max_edge_length: 0.25", f"max_edge_length: 0.25, {settings}")
        return read_shot(written(tmp_path, text)).motion.start_data()

    assert data("placement: chord") == data("placement: chord, renew: 10, normals: geometric")
    assert data("placement: exact") != data("placement: exact, normals: geometric")
    assert data("shape: 0.6") == data("") != data("shape: 0.7")


def test_a_renewal_is_said_by_its_frames_alone(tmp_path: Path) -> None:
    """So that another rhythm goes on from the last frame that both have."""

    def renewing(settings: str) -> list[int]:
        text = GOOD.replace("max_edge_length: 0.25", f"max_edge_length: 0.25, {settings}")
        motion = read_shot(written(tmp_path, text)).motion
        data = {number: motion.step_data(number) for number in motion.frames.numbers[1:]}
        return [number for number, step in data.items() if isinstance(step, dict) and step.get("renewed")]

    assert renewing("renew: 20") == [21, 41]
    assert renewing("renew: 48") == [49]
    assert renewing("renew: 49") == renewing("") == []
    assert renewing("renew: 20, placement: chord") == renewing("renew: 20, method: polyhedra") == []


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


BROKEN = [
    ("axis: z, cen", "axiz: z, cen",
     "a.yaml:8:18: axiz is not known under flows.0.sum.0.vortex. Did you mean 'axis'?"),
    ("strength", "strengths",
     "a.yaml:8:61: strengths is not known under flows.0.sum.0.vortex. Did you mean 'strength'?"),
    ("- vortex", "- vortx", "a.yaml:8:9: vortx is not known under flows.0.sum.0. Did you mean 'vortex'?"),
    ("solid: box", "solid: bax", "a.yaml:4:11: subject.solid: 'bax' is no solid. Did you mean 'box'?"),
    ("linear", "lineal",
     "a.yaml:10:22: flows.1.twist.amount.ease: 'lineal' is no easing. Did you mean 'linear'?"),
    ("radius: 0.8", "radius: wide",
     "a.yaml:8:48: flows.0.sum.0.vortex.radius is 'wide'; "
     "it must be a number. Write it plainly, without quotes or units."),
    ("radius: 0.8", "radius: -1", "a.yaml:8:48: flows.0.sum.0.vortex.radius is -1; it must be above 0"),
    ("radius: 0.8", "radius: {keys: {1: 0.5, 9: 0}}",
     "a.yaml:8:72: flows.0.sum.0.vortex.radius.keys.9 is 0; it must be above 0"),
    ("[0.9, 0, 0]", "[0.9, 0]", "a.yaml:8:27: flows.0.sum.0.vortex.centre has 2 items; "
     "it must have at least 3"),
    ("25: 4", "250: 4",
     "a.yaml:8:85: key 250 is outside of the shot, which has frames 1-49 (2 s). Move it inside."),
    ("1: 0, 25: 4", "25: 4, 1: 0",
     "a.yaml:8:86: key 1 comes after key 25; keys go forward in time. Sort them."),
    ("25: 4", "soon: 4",
     "a.yaml:8:85: key 'soon' is no time; write a frame, such as 12, or seconds, such as 0.5s"),
    ("max_edge_length: 0.25", "max_edge_length: 0.05, min_edge_length: 0.03",
     "a.yaml:5:35: min_edge_length 0.03 is 60% of max_edge_length 0.05; it must be below 50% (P13), "
     "or splitting and collapsing undo each other. Try 0.02."),
    ("1-49", "1-49x2", "a.yaml:2:1: frames 1-49x2 skip or turn back; a shot plays all. Write 1-96."),
    ("1-49", "all",
     "a.yaml:2:1: 'all' is not a frame range; write one as 12, 1-48, 1-48x2 or 1-24,30,40-48"),
    ("rate: 24", "rate: fast",
     "a.yaml:3:1: 'fast' is not a frame rate; write 24, 23.976 or 24000/1001"),
    ("title: Cube\n", "", "a.yaml:1:1: title is missing; it has no default. Add `title: …`."),
    ("title: Cube", "title: Cube\ntitle: Box",
     "a.yaml:2:1: title is given twice, first in line 1; one would be lost. Remove one of them."),
    ("solid: box", "solid: box, radius: 1",
     "a.yaml:4:23: radius is no measure of a box. There are: size."),
    ("solid: box", "solid: box, size: [1, 2]",
     "a.yaml:4:23: size of a box has 3 numbers, not 2. Write all of them."),
    ("solid: box", "model: bunny.obj",
     "a.yaml:4:11: model file bunny.obj is not there; it is looked for beside the shot file, as bunny.obj. "
     "Put it there or correct the name."),
    ("axis: z", "axis: [0, 0, 0]",
     "a.yaml:8:18: axis [0, 0, 0] has no direction. Write x, y, z or a vector."),
    ("axis: z", "axis: w", "a.yaml:8:18: flows.0.sum.0.vortex.axis: 'w' is no axis. There are: x, y, z."),
    ("      - rotation: {speed: 90}", "      - {rotation: {speed: 90}, lorenz: }",
     "a.yaml:9:9: flows.0.sum.1: a flow is one name and its parameters, "
     "and this entry has lorenz and rotation. Start each flow with a dash of its own."),
    ("{max_edge_length: 0.25}", "no",
     "a.yaml:5:1: resample is 'no'; it must be 'off'"),
    ("max_edge_length: 0.25", "max_edge_length: 0.25, placement: exct",
     "a.yaml:5:35: resample.placement: 'exct' is no placement. Did you mean 'exact'?"),
    ("max_edge_length: 0.25", "max_edge_length: 0.25, renew: 0",
     "a.yaml:5:35: resample.renew is 0; it must be at least 1"),
    ("max_edge_length: 0.25", "max_edge_length: 0.25, crease: rest",
     "a.yaml:5:35: crease is not known under resample. Did you mean 'creases'?"),
    ("camera:", "integrator: adaptiv\ncamera:",
     "a.yaml:11:1: integrator: 'adaptiv' is no integrator. Did you mean 'adaptive'?"),
    ("camera:", "tolerance: 0.001\ncamera:",
     "a.yaml:11:1: tolerance is for the error that integrator: adaptive estimates, and rk4 estimates none. "
     "Write integrator: adaptive, or take it out."),
    ("camera:", "stride: 0\ncamera:", "a.yaml:11:1: stride is 0; it must be above 0"),
    ("camera:", "substeps: 0\ncamera:", "a.yaml:11:1: substeps is 0; it must be at least 1"),
    ("rate: 24", "rate: 1e-320",
     "a.yaml:3:1: frame rate 1e-320 is not from 0.1 to 1000, in frames per second; 24 is usual"),
    ("rate: 24", "rate: 1e999999999",
     "a.yaml:3:1: inf is not a frame rate; write 24, 23.976 or 24000/1001"),
    ("rate: 24", "rate: '1e999999999'",
     "a.yaml:3:1: '1e999999999' is not a frame rate; write 24, 23.976 or 24000/1001"),
    ("1-49", "1-100000000",
     "a.yaml:2:1: '1-100000000' reaches over more than 100000 frames; cut it in parts"),
    ('"2s"', f'"{"9" * 400}s"',
     f"a.yaml:10:49: key {'9' * 49}…999s is outside of the shot, which has frames 1-49 (2 s). "
     "Move it inside."),
    ("25: 4", f"{'9' * 290}: 4",
     f"a.yaml:8:85: key {'9' * 50}…99999 is outside of the shot, which has frames 1-49 (2 s). "
     "Move it inside."),
    ("25: 4", f"{'9' * 400}: 4",
     "a.yaml:8:85: key inf is no time; write a frame, such as 12, or seconds, such as 0.5s"),
    ("25: 4", "25: 1e308",
     "a.yaml:8:85: flows.0.sum.0.vortex.strength.keys.25: 1e+308 is too large to compute with; "
     "numbers go up to 1e12. Write a smaller one."),
    ("25: 4", f"25: -{'9' * 400}",
     "a.yaml:8:85: flows.0.sum.0.vortex.strength.keys.25 is -inf; "
     "it must be a finite number. Write its value."),
    ("[0.9, 0, 0]", "[0.9, 0, 2e12]",
     "a.yaml:8:44: flows.0.sum.0.vortex.centre.2: 2e+12 is too large to compute with; "
     "numbers go up to 1e12. Write a smaller one."),
    ("radius: 0.8", "radius: 1e-200",
     "a.yaml:8:48: flows.0.sum.0.vortex.radius: 1e-200 is too small to compute with; "
     "measures start at 1e-9. Write a larger one."),
    ("solid: box", "solid: icosphere, radius: 1e300",
     "a.yaml:4:29: subject.radius: 1e+300 is too large to compute with; "
     "numbers go up to 1e12. Write a smaller one."),
    ("camera:", "substeps: 100000000\ncamera:",
     "a.yaml:11:1: substeps is 100000000; it must be at most 10000"),
    ("camera:", "look: velvet\ncamera:",
     "a.yaml:11:1: look: 'velvet' is no look. There are: clay, putty, glaze, ceramic, "
     "chrome, brushed, taffy, swirl, pearl, marble, cream, coffee, honey, glass, smoke, speed, strain, "
     "symbolics_1990."),
    ("camera:", "quality: {draught: {samples: 6}}\ncamera:",
     "a.yaml:11:11: draught is not known under quality. Did you mean 'draft'?"),
    ("camera:", "quality: {final: {samples: 100}}\ncamera:",
     "a.yaml:11:19: quality.final.samples: 100 samples do not divide into passes of 16. "
     "Write up to 16, or a multiple of it."),
    ("camera:", "quality: {daily: {noise_threshold: 0.02}}\ncamera:",
     "a.yaml:11:19: daily takes 16 samples, of which no pass could be saved; noise_threshold needs "
     "48 or more. Write samples: 256 beside it."),
]  # fmt: skip


def test_a_shot_says_how_its_velocities_are_followed(tmp_path: Path) -> None:
    def motion(text: str) -> Motion:
        return read_shot(written(tmp_path, GOOD.replace("camera:", f"{text}\ncamera:"))).motion

    def settings_of(motion: Motion) -> tuple[Any, ...]:
        assert isinstance(motion.flow, Sequence)
        first = motion.bounded(motion.flow, 5)
        assert isinstance(first, Sequence) and isinstance(first.flows[0], Streamlines)
        return first.flows[0].substeps, first.flows[0].tolerance, first.flows[0].stride

    assert settings_of(motion("")) == settings_of(motion("integrator: rk4")) == (None, None, 0.125)
    assert settings_of(motion("integrator: adaptive")) == (None, 1e-5, 0.125)
    assert settings_of(motion("integrator: adaptive\ntolerance: 0.001\nstride: 2")) == (None, 1e-3, 0.5)
    assert settings_of(motion("substeps: 3\nstride: 0.1")) == (3, None, 0.025)
    plain, adaptive = motion(""), motion("integrator: adaptive")
    assert plain.step_data(9) != adaptive.step_data(9) and plain.start_data() == adaptive.start_data()


@pytest.mark.parametrize(
    ("lengths", "stride"),
    [
        ("{keys: {1: 0.2, 49: 0.4}, ease: linear}", 0.1 * (1 + 12 / 48)),
        ("{curvature: {tolerance: 0.01, finest: 0.1, coarsest: 0.3}}", 0.15),
        ("{camera: {position: [0, 0, 6], pixels: 8, finest: 0.1, coarsest: 0.2}}", 0.1),
        ("{formula: 0.2 + 0.1*abs(y)}", None),
    ],
)
def test_strides_are_shares_of_the_longest_edge_of_their_frame(
    tmp_path: Path, lengths: str, stride: float | None
) -> None:
    motion = read_shot(written(tmp_path, GOOD.replace("0.25}", f"{lengths}}}"))).motion
    flow = motion.bounded(motion.flow, 13)
    assert isinstance(flow, Sequence) and isinstance(flow.flows[0], Streamlines)
    assert flow.flows[0].stride == pytest.approx(stride)


@pytest.mark.parametrize(("good", "bad", "message"), BROKEN, ids=[bad[:30] for _, bad, _ in BROKEN])
def test_a_mistake_is_told_with_its_place(tmp_path: Path, good: str, bad: str, message: str) -> None:
    assert good in GOOD
    assert told(tmp_path, GOOD.replace(good, bad)) == [message]


def test_all_mistakes_are_told_at_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    text = GOOD.replace("1-49", "1-24").replace("solid: box", "solid: bax").replace("speed", "sped")
    places = [line.split(": ")[0] for line in told(tmp_path, text)]
    assert places == [
        "a.yaml:4:11",
        "a.yaml:8:85",
        "a.yaml:9:9",
        "a.yaml:9:20",
        "a.yaml:10:49",
        "a.yaml:11:35",
    ]


def test_only_a_missing_model_is_a_missing_input(tmp_path: Path) -> None:
    missing = GOOD.replace("solid: box", "model: bunny.obj")
    with pytest.raises(MissingInputError) as error:
        read_shot(written(tmp_path, missing))
    assert error.value.exit_code == 3
    with pytest.raises(ShotError) as wrong:
        read_shot(written(tmp_path, missing.replace("rate: 24", "rate: 0")))
    assert wrong.value.exit_code == 2 and len(wrong.value.messages) == 2


def test_a_model_is_known_by_its_contents(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    for name in ("one.obj", "two.obj"):
        write_mesh(box(), tmp_path / "models" / name)
    shots = [
        read_shot(written(tmp_path, GOOD.replace("solid: box", f"model: models/{name}, scale: 2")))
        for name in ("one.obj", "two.obj")
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


def test_a_torus_that_meets_itself_is_refused_with_its_place(tmp_path: Path) -> None:
    text = GOOD.replace("solid: box", "solid: torus, radius: 1, tube_radius: 2")
    assert told(tmp_path, text)[0].startswith("a.yaml:4:1: tube_radius 2 must be below radius 1")


FILM = "title: Two\nshots: [A, B]\nrate: 24\n"


def test_a_film_is_its_shots_in_order(tmp_path: Path) -> None:
    for name in ("A", "B"):
        written(tmp_path, GOOD.replace("Cube", name), f"{name}.yaml")
    film = read_film(written(tmp_path, FILM.replace("[A, B]", "[B, A]"), "film.yaml"))
    assert [shot.title for shot in film.shots] == ["B", "A"]
    assert (film.title, str(film.rate), film.title_seconds) == ("Two", "24", 3.0)


def test_a_film_tells_what_is_wrong_in_all_its_files(tmp_path: Path) -> None:
    written(tmp_path, GOOD.replace("rate: 24", "rate: 30").replace('"2s"', "49"), "A.yaml")
    written(tmp_path, GOOD.replace("speed", "sped"), "B.yaml")
    with pytest.raises(ShotError) as error:
        read_film(written(tmp_path, FILM + "subtitel: x\n", "film.yaml"))
    text = str(error.value).replace(f"{tmp_path}/", "")
    assert "film.yaml:2:9: A plays at 30 frames per second and the film at 24" in text
    assert "film.yaml:4:1: subtitel is not known. Did you mean 'subtitle'?" in text
    assert "B.yaml:9:20: sped is not known" in text


def test_a_card_stands_for_a_minute_at_most(tmp_path: Path) -> None:
    for name in ("A", "B"):
        written(tmp_path, GOOD, f"{name}.yaml")
    with pytest.raises(
        ShotError, match=r"film\.yaml:4:1: title_seconds is 1000000000.*; it must be at most 60$"
    ):
        read_film(written(tmp_path, FILM + "title_seconds: 1e9\n", "film.yaml"))


@pytest.mark.parametrize("solid", ["box", "icosphere", "rod", "sheet", "torus"])
def test_the_largest_of_numbers_makes_data_that_json_can_hold(tmp_path: Path, solid: str) -> None:
    text = (
        GOOD.replace("solid: box", f"solid: {solid}")
        .replace("25: 4", "25: -1e12, 49: 1e12")
        .replace("radius: 0.8", "radius: 1e-9")
    )
    json.dumps(data_of(read_shot(written(tmp_path, text)).motion), allow_nan=False)


def test_a_shot_that_is_not_there_is_a_missing_input(tmp_path: Path) -> None:
    written(tmp_path, GOOD, "A.yaml")
    with pytest.raises(
        MissingInputError, match=r"film\.yaml:2:12: there is no shot .*B\.yaml\. There are: A\."
    ):
        read_film(written(tmp_path, FILM, "film.yaml"))


def test_the_films_own_shots_are_good() -> None:
    film = read_film(Path(__file__).parents[2] / "shots" / "film.yaml")
    assert len(film.shots) == 3
    assert all(2 <= shot.rate.seconds(len(shot.frames)) <= 8 for shot in film.shots)


def test_the_documented_shot_is_good(tmp_path: Path) -> None:
    page = Path(__file__).parents[2] / "docs" / "shot-files.md"
    example = page.read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
    assert read_shot(written(tmp_path, example)).motion.resampling is not None


STRAYS = [
    "",
    "null",
    "[]",
    "{}",
    "[1, 2, 3]",
    "{keys: {}}",
    "{keys: [1]}",
    "{? [1] : 2}",
    "-1",
    "true",
    ".nan",
    "9" * 400,
    "1e-320",
    "-1e308",
    "'x'",
]


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(line=st.integers(0, 10), stray=st.sampled_from(STRAYS), colon=st.integers(0, 5))
def test_no_stray_value_anywhere_raises_anything_else(
    tmp_path: Path, line: int, stray: str, colon: int
) -> None:
    lines = GOOD.splitlines()
    parts = lines[line].split(": ")
    kept = parts[: min(colon, len(parts) - 1) + 1]
    open_brackets = sum(": ".join(kept).count(mark) for mark in "{") - ": ".join(kept).count("}")
    lines[line] = ": ".join([*kept, stray]) + "}" * max(0, open_brackets)
    with contextlib.suppress(ShotError, MissingInputError):
        read_shot(written(tmp_path, "\n".join(lines)))


@pytest.mark.parametrize("text", ["[1, 2]", "just words", "null", "3", "title: {}", "? [a, b]\n: 1\n"])
def test_what_is_no_shot_at_all_is_told(tmp_path: Path, text: str) -> None:
    assert all(line.startswith("a.yaml:") for line in told(tmp_path, text))
