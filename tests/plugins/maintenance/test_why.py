"""A frame tells why it would be made again: which part of its key differs, and what was edited."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.mesh import box
from flowsculpt.pipeline.plugins.maintenance.why import Explanation, differences, explain, option_differences
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.pipeline.production.stages import FINISH, FRAME_CAMERA, RENDER
from flowsculpt.render.post.image import read_exr, write_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from tests.conftest import QUALITY, commanded
from tests.mesh_files import write_ply

NAME = "T010_tiny"

plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=2), inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=40)
@given(plain, plain)
def test_data_differ_where_they_are_not_the_same(one: Any, other: Any) -> None:
    assert not list(differences(one, one))
    assert bool(list(differences(one, other))) == (one != other)


def test_a_difference_is_told_as_a_path() -> None:
    was, now = {"look": {"roughness": 0.1}, "a": [1, 2]}, {"look": {"roughness": 0.3}, "a": [1, 3], "b": 1}
    told = [str(each) for each in differences(was, now)]
    assert told == ["look.roughness: 0.1 → 0.3", "a.1: 2 → 3", "b: nothing → 1"]


def ask(project: Any, frame: int, settings: tuple[str, ...] = ()) -> Explanation:
    there = Project(project.path, 2, settings=settings)
    return explain(there, there.request(Show().find_shot(NAME), QUALITY, FrameRange([frame])), frame)


@dataclass(frozen=True)
class Case:
    """A change since a frame was made, and what `why` says about the frame.

    replace   texts of the shot file, and what stands in their place; an empty text is its end
    files     files beside the shot, as they are written anew
    settings  options --set that are given now
    frame     the frame
    state     of the frame; by default done if nothing is said of it, else stale
    """

    id: str
    says: tuple[str, ...]
    replace: tuple[str, str] = ("", "")
    files: tuple[tuple[str, str], ...] = ()
    settings: tuple[str, ...] = ()
    frame: int = 3
    state: str = ""


SHOT = "shots/T010_tiny.yaml"
LATE = ("its mesh differs, as all meshes do from frame 5 on",)

CASES = [
    Case("a comment", (), ("title:", "# a comment\ntitle:")),
    Case("the title", (), ("A box, twisted", "A box")),
    Case("the exposure, which is in the view", (), ("", "lights: {rig: studio, exposure: 1}\n")),
    Case(
        "a key after the frame",
        (
            "its camera is framed again, for meshes differ from frame 5 on; if that turns out the same, the "
            "frame is "
            "reused",
            f"{SHOT}:6: flows.0.twist.amount.keys.6: 60 → 90",
        ),
        ("6: 60", "6: 90"),
        frame=1,
        state="unframed",
    ),
    Case(
        "the camera",
        ("its camera differs", f"{SHOT}:7: camera.azimuth: -30 → 20"),
        ("azimuth: -30", "azimuth: 20"),
    ),
    Case(
        "the lens",
        ("its camera differs", f"{SHOT}:7: camera.focal_length: nothing → 85"),
        ("elevation: 14", "elevation: 14, focal_length: 85"),
    ),
    Case("the look", ("its look differs", f"{SHOT}:8: look: nothing → ceramic"), ("", "look: ceramic\n")),
    Case(
        "a colour",
        ("its look differs", f'{SHOT}:8: look: nothing → {{material: clay, colour: "#c04020"}}'),
        ("", "look: {material: clay, colour: '#c04020'}\n"),
    ),
    Case(
        "a light",
        ("its lights differ", f"{SHOT}:8: lights: nothing → {{rig: studio, intensity: {{key: 2}}}}"),
        ("", "lights: {rig: studio, intensity: {key: 2}}\n"),
    ),
    Case("the stage", ("its stage differs", f"{SHOT}:8: stage: nothing → ground"), ("", "stage: ground\n")),
    Case(
        "a flow",
        (
            "its mesh differs, as all meshes do from frame 2 on",
            f"{SHOT}:7: flows.1: nothing → {{rotation: {{speed: 9}}}}",
        ),
        ("camera:", "  - rotation: {speed: 9}\ncamera:"),
    ),
    Case("a key", (*LATE, f"{SHOT}:6: flows.0.twist.amount.keys.6: 60 → 90"), ("6: 60", "6: 90"), frame=6),
    Case(
        "a key and the camera",
        (
            *LATE,
            "its camera differs",
            f"{SHOT}:6: flows.0.twist.amount.keys.6: 60 → 90",
            f"{SHOT}:7: camera.azimuth: -30 → 20",
        ),
        ("6: 60}}}\ncamera: {azimuth: -30", "6: 90}}}\ncamera: {azimuth: 20"),
        frame=6,
    ),
    Case(
        "a threshold",
        (
            "its mesh differs, as all meshes do from frame 1 on",
            f"{SHOT}:4: resample.max_edge_length: 0.5 → 0.4",
        ),
        ("length: 0.5", "length: 0.4"),
    ),
    Case(
        "the subject",
        ("its mesh differs, as all meshes do from frame 1 on", f"{SHOT}:3: subject.size.1: 2 → 3"),
        ("[2, 2, 2]", "[2, 3, 2]"),
    ),
    Case(
        "the tessellation",
        (
            "its normals differ: by the hard angle or the tessellation",
            f"{SHOT}:8: smooth: nothing → {{tessellate: 2}}",
        ),
        ("", "smooth: {tessellate: 2}\n"),
    ),
    Case(
        "the dicing",
        ("its dicing differs", f'{SHOT}:8: smooth: nothing → {{dicing: "2px"}}'),
        ("", "smooth: {dicing: 2px}\n"),
    ),
    Case(
        "a setting of the quality",
        ("the settings of its quality differ", f"{SHOT}:8: quality: nothing → {{draft: {{samples: 8}}}}"),
        ("", "quality: {draft: {samples: 8}}\n"),
    ),
    Case(
        "the shutter",
        ("its shutter differs", f"{SHOT}:8: shutter: nothing → {{angle: 180}}"),
        ("", "shutter: {angle: 180}\n"),
    ),
    Case("an AOV", ("its AOVs differ", f"{SHOT}:8: aovs: nothing → [velocity]"), ("", "aovs: [velocity]\n")),
    Case(
        "the defaults",
        ("its look differs", "shots/defaults.yaml:1: look: nothing → ceramic"),
        files=(("defaults.yaml", "look: ceramic\n"),),
    ),
    Case(
        "a shot that it extends",
        (
            "its look differs",
            "shots/base.yaml:1: look: nothing → ceramic",
            f"{SHOT}:8: extends: nothing → base",
        ),
        ("", "extends: base\n"),
        files=(("base.yaml", "look: ceramic\n"),),
    ),
    Case(
        "an option",
        ("its camera differs", "--set camera.azimuth=20 is given now, and was not when it was made"),
        settings=("camera.azimuth=20",),
    ),
    Case(
        "an option beside an edit",
        (
            "its look differs",
            "its camera differs",
            f"{SHOT}:8: look: nothing → ceramic",
            "--set camera.azimuth=20 is given now, and was not when it was made",
        ),
        ("", "look: ceramic\n"),
        settings=("camera.azimuth=20",),
    ),
]


@pytest.fixture(scope="module")
def made(finished_project: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A finished project for all cases, each of which leaves it as it was."""
    return finished_project.copy(tmp_path_factory.mktemp("why") / "studio")


def said(explanation: Explanation) -> tuple[str, ...]:
    return tuple(str(part) for part in (*explanation.reasons, *explanation.edits, *explanation.options))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_why_names_what_was_changed_and_nothing_else(
    made: Any, monkeypatch: pytest.MonkeyPatch, case: Case
) -> None:
    monkeypatch.chdir(made.path)
    before, (old, new) = made.shot.read_text(), case.replace
    assert old in before
    try:
        made.shot.write_text(before.replace(old, new, 1) if old else before + new)
        for name, text in case.files:
            (made.shot.parent / name).write_text(text)
        explanation = ask(made, case.frame, case.settings)
    finally:
        made.shot.write_text(before)
        for name, _ in case.files:
            (made.shot.parent / name).unlink()
    assert said(explanation) == case.says
    assert explanation.state == (case.state or ("stale" if case.says else "done"))


def test_why_names_an_option_that_made_a_frame_and_is_not_given_any_more(
    made: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(made.path)
    project = Project(made.path, 2, settings=("look=ceramic",))
    request = project.request(Show().find_shot(NAME), QUALITY, FrameRange([3]))
    made_with = replace(request.source, settings=("look=ceramic",))
    assert list(option_differences(made_with, replace(request.source, settings=()))) == [
        "it was made with --set look=ceramic, which is not given now"
    ]


def remade(project: Any, **header: Any) -> None:
    """Write frame 3 as another version of flowsculpt, or of a package, would have."""
    file = project.frames()[2]
    layers, before = read_exr(file)
    stages = {**before["stages"], **header.pop("stages", {})}
    facts = {name: value for name, value in layers.facts.items() if name not in before}
    file.unlink()
    write_exr(
        file, RenderedFrame({"beauty": layers["beauty"]}, facts), {**before, **header, "stages": stages}
    )


@pytest.mark.parametrize(
    ("header", "says"),
    [
        (
            {"stages": {"render": {**RENDER.recipe, "version": 0}}},
            f"stage render has version {RENDER.version} now, and version 0 made it",
        ),
        (
            {"stages": {"render": {**RENDER.recipe, "mitsuba": "3.0.0"}}},
            f"mitsuba is {version('mitsuba')} now, and stage render used 3.0.0",
        ),
        (
            {"stages": {"finish": {**FINISH.recipe, "pyoidn": "0.1"}}},
            f"pyoidn is {version('pyoidn')} now, and stage finish used 0.1",
        ),
        (
            {"stages": {"frame_camera": {**FRAME_CAMERA.recipe, "version": 0}}},
            f"stage frame_camera has version {FRAME_CAMERA.version} now, and version 0 made it",
        ),
        ({"inputs": {"box.ply": "1"}}, None),
        ({"variant": "scalar_rgb"}, "it was rendered by another variant of Mitsuba"),
        (
            {"temporal_neighbours": [2, 4]},
            "it was averaged with frames [2, 4], and would be with frames [] now",
        ),
    ],
    ids=["version", "package", "denoiser", "framing", "removed file", "variant", "neighbours"],
)
def test_why_names_the_stage_that_has_another_version(
    finished: Any, monkeypatch: pytest.MonkeyPatch, header: dict[str, Any], says: str | None
) -> None:
    monkeypatch.chdir(finished.path)
    remade(finished, **header)
    explanation = ask(finished, 3)
    assert explanation.state == "stale" and (says is None or explanation.reasons[0] == says)


def test_why_names_a_file_whose_contents_changed(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shots").mkdir()
    shot, model = tmp_path / "shots" / f"{NAME}.yaml", tmp_path / "shots" / "box.ply"
    write_ply(box((2.0, 2.0, 2.0)), model)
    shot.write_text("title: A\nframes: 1-3\nsubject: {model: box.ply}\nresample: {max_edge_length: 0.9}\n")
    request = Project(tmp_path, 1).request(Show().find_shot(NAME), QUALITY, FrameRange([2]))
    file = tmp_path / request.place("frame", 2)
    file.parent.mkdir(parents=True)
    pixels = RenderedFrame({"beauty": np.zeros((2, 2, 3), np.float32)}, {})
    write_exr(file, pixels, json.loads(json.dumps(request.keys.header(2))))
    write_ply(box((2.0, 2.0, 2.2)), model)
    there = Project(tmp_path, 1)
    explanation = explain(there, there.request(Show().find_shot(NAME), QUALITY, FrameRange([2])), 2)
    assert explanation.reasons == ("file box.ply changed since it was made", "its mesh differs")


def test_why_a_frame_is_made_again(finished: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(finished.path)
    text = finished.shot.read_text()
    assert ask(finished, 2).state == "done"

    finished.shot.write_text("# a comment\n" + text)
    assert ask(finished, 2).state == "done"

    finished.shot.write_text(text.replace("subject:", "look: ceramic\nsubject:"))
    relit = ask(finished, 2)
    assert relit.state == "stale" and relit.reasons == ("its look differs",)
    assert "look.model" in {".".join(map(str, part.path)) for part in relit.parts}
    assert [str(edit) for edit in relit.edits] == ["shots/T010_tiny.yaml:3: look: nothing → ceramic"]

    finished.shot.write_text(text.replace("6: 60}", "6: 90}"))
    late = ask(finished, 6)
    assert late.state == "stale"
    assert "its mesh differs, as all meshes do from frame 5 on" in late.reasons
    assert [str(edit) for edit in late.edits] == [
        "shots/T010_tiny.yaml:6: flows.0.twist.amount.keys.6: 60 → 90"
    ]

    finished.shot.write_text(text)
    finished.frames()[3].unlink()
    never = finished.call("why", NAME, "4", "-q", "daily")
    assert "daily/frames/T010_tiny.0004.exr is missing" in never.out and "it is not rendered yet" in never.out
    gone = ask(finished, 4)
    assert gone.state == "missing" and "without rendering" in gone.reasons[0]


def test_why_is_told_at_the_command_line(finished: Any) -> None:
    finished.shot.write_text(finished.shot.read_text().replace("azimuth: -30", "azimuth: 20"))
    told = finished.call("why", NAME, "3", "-q", QUALITY)
    assert told.code == 0 and "is stale" in told.out and "camera.azimuth: -30 → 20" in told.out
    outside = finished.call("why", NAME, "60", "-q", QUALITY)
    assert outside.code == 2 and "1-6" in outside.err


def test_numbers_are_rounded_unless_that_hides_their_difference() -> None:
    was, now = {"a": 0.1 + 0.2, "b": [1.0, 2.0]}, {"a": 0.4, "b": [1.0, 2.0 + 1e-9]}
    told = [str(each) for each in differences(was, now)]
    assert told == ["a: 0.3 → 0.4", "b.1: 2 → 2.000000001"]


def test_why_without_a_frame_explains_the_first_that_is_not_up_to_date(
    made: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(made.path)
    assert f"All frames of T010_tiny at {QUALITY} are" in commanded(made.path, "why", NAME, "-q", QUALITY)[1]
    before = made.shot.read_text()
    try:
        made.shot.write_text(before.replace("6: 60}", "6: 90}"))
        code, told = commanded(made.path, "why", NAME, "-q", QUALITY)
        assert code == 0 and "T010_tiny.0001.exr is unframed" in told and "-f 1 makes it" in told
    finally:
        made.shot.write_text(before)
