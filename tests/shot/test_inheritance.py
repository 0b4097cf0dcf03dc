"""Shots that extend others, defaults for all of a folder, and values set from outside."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import FlowsculptError, MissingInputError, ShotError
from flowsculpt.pipeline.flow.parameters import number_at
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.shot import Shot, read_film, read_shot
from flowsculpt.pipeline.shot.yaml.inheritance import inherited_files
from flowsculpt.render.base.serialise import from_plain, to_plain
from flowsculpt.render.scene.materials import LOOKS

FILES = {
    "A": """\
title: A
frames: 1-49
subject: {solid: box, size: [1, 1, 1]}
resample: {max_edge_length: {curvature: {tolerance: 0.01, finest: 0.1, coarsest: 0.2}}}
flows:
  - vortex: {strength: {keys: {1: 0, 25: 2, 49: 0}}}
  - twist: {amount: 2}
camera: {azimuth: {keys: {1: 0, 49: 40}}, elevation: 10}
""",
    "B": """\
extends: A
title: B
subject: {solid: icosphere}
resample: {max_edge_length: {formula: "0.3"}}
camera: {azimuth: {keys: {1: 5}}}
""",
    "C": "extends: B\ntitle: C\nflows:\n  - twist: {amount: 3}\n",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / f"{name}.yaml").write_text(text)
    return tmp_path


def read(folder: Path, name: str, *settings: str) -> Shot:
    return read_shot(folder / f"{name}.yaml", settings=settings)


def told(folder: Path, name: str, *settings: str) -> list[str]:
    with pytest.raises(FlowsculptError) as error:
        read(folder, name, *settings)
    return str(error.value).replace(f"{folder}/", "").split("\n")


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ("fps: 25", "fps: unknown name. Did you mean 'rate'? It is there already."),
        (
            "samples: 64",
            "samples: unknown name. Did you mean 'quality.final.samples'?",
        ),
        (
            "quality: {samples: 64}",
            "quality.samples: unknown name. Did you mean 'quality.draft.samples'?",
        ),
        (
            "quality: {preview: {samples: 0}}",
            "quality.preview: unknown name. Did you mean 'draft'?",
        ),
    ],
)
def test_a_message_names_what_the_same_file_has(folder: Path, entry: str, says: str) -> None:
    (folder / "defaults.yaml").write_text("rate: 24\nquality: {draft: {samples: 4}}\n")
    (folder / "D.yaml").write_text(FILES["A"] + entry + "\n")
    assert [line.partition(": ")[2] for line in told(folder, "D")] == [says]


def test_a_shot_that_extends_one_where_there_is_no_other_is_told_to_stand_alone(tmp_path: Path) -> None:
    (tmp_path / "B.yaml").write_text(FILES["B"])
    says = "B.yaml:1:1: extends: A is not next to this file. No other shot is there; remove extends."
    assert told(tmp_path, "B") == [says]


def test_mappings_merge_and_lists_replace(folder: Path) -> None:
    a, b, c = (read(folder, name) for name in "ABC")
    assert (b.title, b.frames) == ("B", a.frames)
    assert b.motion.flow == a.motion.flow != c.motion.flow
    assert b.picture.camera.elevation == a.picture.camera.elevation
    assert len(c.motion.flow.flows) == 1  # type: ignore[attr-defined]


def test_another_kind_of_thing_replaces_the_whole(folder: Path) -> None:
    """Keys are not mixed with other keys, a formula not with curvature, a ball not with sides."""
    b = read(folder, "B")
    assert number_at(b.picture.camera.azimuth, 2.0) == pytest.approx(math.radians(5))
    assert b.motion.subject == read(folder, "A", "subject={solid: icosphere}").motion.subject
    assert b.motion.resampling is not None


def test_defaults_hold_for_all_shots_of_a_folder_unless_they_say_otherwise(folder: Path) -> None:
    (folder / "defaults.yaml").write_text("look: glaze\ncamera: {margin: 0.2, elevation: 3}\nrate: 25\n")
    a = read(folder, "A")
    assert a.picture.look == LOOKS["glaze"] and str(a.rate) == "25"
    assert (a.picture.camera.margin, a.picture.camera.elevation) == (0.2, math.radians(10))
    assert read(folder, "C").picture.look == LOOKS["glaze"]


def test_an_error_stands_in_the_file_that_holds_the_value(folder: Path) -> None:
    (folder / "A.yaml").write_text(FILES["A"].replace("25: 2", "soon: 2"))
    (folder / "F.yaml").write_text("extends: B\nframes: 1-24\ntitlle: F\n")
    assert told(folder, "F") == [
        "F.yaml:3:1: titlle: unknown name. Did you mean 'title'?",
        "A.yaml:6:38: key 'soon' is not a time; write a frame, such as 12, or seconds, such as 0.5s",
    ]
    (folder / "G.yaml").write_text("extends: H\ntitle: G\n")
    (folder / "H.yaml").write_text(FILES["A"].replace("2, 49", "2, 25").replace("0.1,", "0.x,"))
    (folder / "defaults.yaml").write_text("look: glas\n")
    assert [line.split(": ")[0] for line in told(folder, "G")] == [
        "H.yaml:4:59",
        "H.yaml:6:45",
        "defaults.yaml:1:1",
    ]


def test_a_formula_of_another_file_is_told_with_its_column(folder: Path) -> None:
    (folder / "G.yaml").write_text(FILES["B"].replace('"0.3"', '"0.3 + sinn(x)"'))
    (folder / "H.yaml").write_text("extends: G\ntitle: H\n")
    (line,) = told(folder, "H")
    assert line.startswith("G.yaml:4:46: sinn is not a function here. Did you mean 'sin'?")


def test_circles_and_missing_parents_are_told(folder: Path) -> None:
    (folder / "D.yaml").write_text("title: D\nextends: E\n")
    (folder / "E.yaml").write_text("extends: D\n")
    assert told(folder, "D") == ["E.yaml:1:1: D extends E extends D; a shot cannot extend itself. "
                                 "Take one of them out."]  # fmt: skip
    (folder / "D.yaml").write_text("extends: D\n")
    assert told(folder, "D")[0].startswith("D.yaml:1:1: D extends D; a shot cannot extend itself.")
    for parent in ("AA", "../A"):
        (folder / "D.yaml").write_text(f"extends: {parent}\n")
        with pytest.raises(MissingInputError, match=r"D\.yaml:1:1: extends: .* is not next to this file\. "):
            read(folder, "D")
    (folder / "D.yaml").write_text("extends: [A]\n")
    assert any("extends: a list is not text" in line for line in told(folder, "D"))
    (folder / "E.yaml").write_text("- 1\n")
    (folder / "D.yaml").write_text("extends: E\n")
    assert told(folder, "D")[0].startswith("E.yaml:1:1: this is not a mapping")


@pytest.mark.parametrize("parent", ['"a\\0b"', "n" * 5000], ids=["a zero byte", "too long"])
def test_a_parent_that_no_file_can_be_called_is_told_with_its_place(parent: str, folder: Path) -> None:
    (folder / "D.yaml").write_text(f"title: D\nextends: {parent}\n")
    (line,) = told(folder, "D")
    assert line.startswith("D.yaml:2:1: extends: ") and len(line) < 400 and line.isprintable()


def test_values_are_set_from_outside(folder: Path) -> None:
    keys = "flows.0.twist.amount={keys: {1: 0, 49: 90}}"
    others = ("camera.margin=0.3", "lights.exposure=1.5", "camera.margin=0.25", "look=glaze")
    shot = read(folder, "C", keys, *others)
    assert number_at(shot.motion.flow.flows[0].amount, 2.0) == math.radians(90)  # type: ignore[attr-defined]
    assert (shot.picture.camera.margin, shot.picture.lights.exposure) == (0.25, 1.5)
    assert shot.picture.look == LOOKS["glaze"]
    assert read(folder, "A", "flows.0.vortex.strength.keys.25=5").motion != read(folder, "A").motion


KEYS = "flows.0.vortex.strength.keys"
TURNED = "flows.1.twist.amount={keys: {1: 0, '0.5s': {value: 20, ease: linear}, 48.5: 90}}"


@pytest.mark.parametrize(
    ("settings", "at", "value"),
    [
        ((TURNED, "flows.1.twist.amount.keys.0.5s=30"), 13, 30),
        ((TURNED, "flows.1.twist.amount.keys.0.5s.value=40"), 13, 40),
        ((TURNED, "flows.1.twist.amount.keys.48.5=50"), 49, 50),
        ((TURNED, "flows.1.twist.amount.keys.1.25s=60"), 31, 60),
        ((TURNED, "flows.1.twist.amount.keys.30=70"), 30, 70),
    ],
    ids=lambda each: each[-1][28:] if isinstance(each, tuple) else None,
)
def test_a_key_is_set_by_its_time_and_a_new_one_finds_its_place(
    folder: Path, settings: tuple[str, ...], at: int, value: float
) -> None:
    shot = read(folder, "A", *settings)
    amount = shot.motion.flow.flows[1].amount  # type: ignore[attr-defined]
    assert amount.at(shot.motion.clock.time(at))[0] == pytest.approx(math.radians(value))


def test_a_step_after_a_key_may_be_one_of_its_numbers(folder: Path) -> None:
    rate = "flows.1={translation: {rate: {keys: {1: [0, 0, 0], 17: [1, 1, 1]}}}}"
    shot = read(folder, "A", rate, "flows.1.translation.rate.keys.17.1=5")
    assert shot.motion.flow.flows[1].field.rate.values[1] == (1.0, 5.0, 1.0)  # type: ignore[attr-defined]
    later = read(folder, "A", rate, "flows.1.translation.rate.keys.33.1=[0, 0, 0]")
    assert later.motion.flow.flows[1].field.rate.times[2] == pytest.approx(32.1 / 24)  # type: ignore[attr-defined]


def test_what_is_set_for_a_film_is_set_in_each_of_its_shots(folder: Path) -> None:
    (folder / "film.yaml").write_text("title: F\nshots: [A, C]\n")
    film = read_film(folder / "film.yaml", ("look=glaze", "rate=24"))
    assert [shot.picture.look for shot in film.shots] == [LOOKS["glaze"]] * 2
    with pytest.raises(ShotError) as error:
        read_film(folder / "film.yaml", ("look=glaz",))
    assert error.value.messages == ("--set look=glaz: look: 'glaz' is not a look. Did you mean 'glaze'?",)


SET = [
    ("flows.0.vortx.strength=3", "flows.0 has no vortx. Did you mean 'vortex'?"),
    ("flows.0.vortex.strongth=3", "flows.0.vortex.strongth: unknown name. Did you mean 'strength'?"),
    ("flows.2.vortex=3", "flows has no item 2. There are: 0 (vortex), 1 (twist)."),
    ("flows.x=3", "flows has no item x. There are: 0 (vortex), 1 (twist)."),
    ("nonsense", "not a setting; it must be name=value, such as flows.0.twist.amount=90"),
    ("title.first=3", "title is A, not a mapping with first. Set title={first: …} in its place."),
    ("lights.exposure=big",
     "lights.exposure: 'big' is not a number"),
    (f"{KEYS}.1.5s=x",
     f"{KEYS}.1.5s: 'x' is not a number"),
    (f"{KEYS}.soon=1",
     "key 'soon' is not a time; write a frame, such as 12, or seconds, such as 0.5s"),
    (f"{KEYS}.1s.value=1", f"{KEYS} has no 1s. There are: 1, 25, 49. Set a new key as a whole."),
    (f"{KEYS}.25.5s.ease=linear", f"{KEYS} has no 25.5s. There are: 1, 25, 49. Set a new key as a whole."),
    ("flows.1.twist.amount.keys.0.5s=1",
     "flows.1.twist.amount is 2, not a mapping with keys. Set flows.1.twist.amount={keys: …} in its "
     "place."),
    ("subject.solid.size=3", "subject.solid is box, not a mapping with size. Set subject.solid={size: …} in "
                             "its place, or subject.size next to it."),
    ("name=B", "name: unknown name. Did you mean 'title'?"),
    ("lights.key=0", "lights.key: unknown name. Did you mean 'lights.intensity.key'?"),
    ("title=[", "'[' is not YAML. Quote it for the shell, and look at its brackets."),
    ("camra.azimuth=2", "camra: unknown name. Did you mean 'camera'?"),
    ("extends=B", "only a file can say what its shot extends; settings come on top of both. Write "
                  "extends there, or set the values themselves."),
]  # fmt: skip


@pytest.mark.parametrize(("setting", "message"), SET, ids=[setting for setting, _ in SET])
def test_a_setting_that_cannot_be_is_told_in_its_own_words(folder: Path, setting: str, message: str) -> None:
    assert told(folder, "A", setting) == [f"--set {setting}: {message}".replace("2.042", "2")]


@pytest.mark.parametrize(
    ("text", "setting", "as_written"),
    [
        ("lights: lacquer", "lights.exposure=0.5", "lights: {rig: lacquer, exposure: 0.5}"),
        ("lights: duotone", "lights.intensity.red=2", "lights: {rig: duotone, intensity: {red: 2}}"),
        ("lights: duotone", "lights.sun.elevation=20", "lights: {rig: duotone, sun: {elevation: 20}}"),
        ("look: chrome", "look.roughness=0.3", "look: {material: chrome, roughness: 0.3}"),
        ("look: chrome", "look.material=clay", "look: clay"),
        ("look: ink", "look.roughness=0.3", "look: {material: ink, roughness: 0.3}"),
        ("look: ink", "looks.ink.roughness=0.3", "look: {material: ink, roughness: 0.3}"),
        ("stage: plinth", "stage.width=3", "stage: {kind: plinth, width: 3}"),
        ("overrides: [{frames: 4-9, look: chrome}]", "overrides.0.look.roughness=0.3",
         "overrides: [{frames: 4-9, look: {material: chrome, roughness: 0.3}}]"),
    ],
)  # fmt: skip
def test_a_setting_below_a_name_keeps_what_the_name_stands_for(
    folder: Path, text: str, setting: str, as_written: str
) -> None:
    (folder / "defaults.yaml").write_text("looks: {ink: glaze}\n")
    for name, entry in (("D", text), ("E", as_written)):
        (folder / f"{name}.yaml").write_text(f"extends: A\n{entry}\n")
    assert read(folder, "D", setting).picture == read(folder, "E").picture != read(folder, "D").picture


def test_a_plan_goes_by_the_files_as_they_were(folder: Path) -> None:
    """Whatever becomes of the files that a shot rests on, and with its settings, through JSON."""
    (folder / "defaults.yaml").write_text("look: glaze\n")
    project = Project(folder, 1, settings=("camera.margin=0.3",))
    request = project.request(folder / "C.yaml", "draft", variant="none")
    expected = request.shot
    assert expected.picture.look == LOOKS["glaze"] and expected.picture.camera.margin == 0.3
    assert set(inherited_files(folder / "C.yaml", FILES["C"])) == {"defaults.yaml", "B.yaml", "A.yaml"}
    for file in folder.glob("*.yaml"):
        file.unlink()
    assert from_plain(RenderRequest, json.loads(json.dumps(to_plain(request)))).shot == expected


def test_another_setting_is_another_mesh_and_the_same_is_none(folder: Path) -> None:
    def keys(*settings: str) -> list[str]:
        request = Project(folder, 1, settings=settings).request(folder / "A.yaml", "draft", variant="none")
        return [request.keys.mesh(number) for number in request.shot.frames]

    plain, strong, late = keys(), keys("flows.0.vortex.strength=2"), keys("flows.0.vortex.strength.keys.49=1")
    assert plain == keys("camera.margin=0.3") and plain[1] != strong[1]
    assert [a == b for a, b in zip(plain, late, strict=True)] == [number <= 25 for number in range(1, 50)]
    with pytest.raises(ShotError):
        keys("flows.0.vortex.strength=x")


SHOW = """\
looks:
  ink: {material: glaze, colour: [0.01, 0.02, 0.2]}
  wet_ink: {material: ink, roughness: 0.03}
  mirror: chrome
rigs:
  duotone: {softboxes: [{position: [-4, 2, 2], radiance: 8, name: red}], sky: {zenith: 0.05}, exposure: 0.5}
"""
PLAIN = "title: A\nframes: 1-4\nsubject: {solid: box}\nresample: {max_edge_length: 0.1}\n"


def shot_in_show(folder: Path, text: str, *settings: str, show: str = SHOW) -> Shot:
    (folder / "defaults.yaml").write_text(show)
    (folder / "A010.yaml").write_text(PLAIN + text)
    return read_shot(folder / "A010.yaml", settings=settings)


def test_looks_and_rigs_that_a_show_names_stand_for_their_settings(tmp_path):
    ink = LOOKS["glaze"].with_values(colour=(0.01, 0.02, 0.2))
    shot = shot_in_show(
        tmp_path, "look: wet_ink\nlights: duotone\noverrides: [{frames: 2-3, look: mirror}]\n"
    )
    assert shot.picture.look == ink.with_values(roughness=0.03)
    assert shot.picture.overrides[0].look == LOOKS["chrome"]
    assert [box.name for box in shot.picture.lights.softboxes] == [
        "red"
    ] and shot.picture.lights.exposure == 0.5
    assert shot_in_show(tmp_path, "look: clay\n", "look=ink").picture.look == ink
    assert shot_in_show(tmp_path, "look: clay\n", show="looks: {clay: {material: clay, roughness: 0.4}}\n")


def test_what_stands_beside_a_name_replaces_its_settings_and_adds_softboxes(tmp_path):
    text = """\
look: {material: ink, pigment: {marble: {colours: ['#fff', '#000']}}}
lights: {rig: duotone, sun: {}, softboxes: [{position: [4, 2, 2], radiance: 3, name: blue}]}
"""
    picture = shot_in_show(tmp_path, text).picture
    assert picture.look.pattern is not None and picture.lights.daylight is not None
    assert {box.name: box.radiance[0] for box in picture.lights.softboxes} == {"red": 8.0, "blue": 3.0}


def test_a_mistake_in_named_settings_is_reported_where_it_stands(tmp_path):
    wrong = SHOW.replace("colour", "color").replace("name:", "nick:")
    with pytest.raises(ShotError) as told:
        shot_in_show(tmp_path, "look: wet_ink\nlights: duotone\n", show=wrong)
    colour, box = told.value.messages
    assert colour == f"{tmp_path}/defaults.yaml:2:26: look.color: unknown name. Did you mean 'colour'?"
    assert box.startswith(f"{tmp_path}/defaults.yaml:6:61: lights.softboxes.0.nick: unknown name.")
    with pytest.raises(
        ShotError, match=r"A010.yaml:5:8: look.material: 'inc' is not among `looks`. Did you mean 'ink'"
    ):
        shot_in_show(tmp_path, "look: {material: inc}\n")
