"""`validate` looks at the scene that a shot describes, and what it advises works."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import FrameError
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.plugins.authoring.first_frame import FirstFrame, FirstFrames
from flowsculpt.pipeline.plugins.authoring.growth_forecast import estimated_vertices
from flowsculpt.pipeline.plugins.authoring.scene_rules import Finding, findings, is_inside, rounded_up
from flowsculpt.pipeline.plugins.authoring.shot_templates import model_template
from flowsculpt.pipeline.resample import Thresholds, resample
from flowsculpt.pipeline.shot import read_shot
from tests.conftest import QUALITY, ProjectFolder, commanded
from tests.needed_plugins import needs_plugins

pytestmark = pytest.mark.quick

TWIST = "twist: {axis: y, amount: {keys: {1: 0, 24: 60}}}"


def write_ball(path: Path, size: float = 2.0, middle: tuple[float, float, float] = (0, 0, 0)) -> None:
    """Write an OBJ of a ball with 642 vertices; `size` is its diameter."""
    ball = icosphere(8)
    vertices = 0.5 * size * ball.vertices + np.array(middle)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    path.write_text("\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in (ball.faces + 1).tolist())]))


def found(folder: Path, text: str) -> list[Finding]:
    path = folder / "shot.yaml"
    path.write_text(f"title: A ball\nframes: 1-24\n{text}\nlook: clay\n")
    shot = read_shot(path)
    return findings(shot, FirstFrames().of(shot.motion))


def ball_shot(
    edge: float = 0.15, more: str = "", flow: str = TWIST, fit: str = "", resample: str = ""
) -> str:
    subject = f"subject: {{model: ball.obj{fit}}}"
    return f"{subject}\nresample: {{max_edge_length: {edge}{resample}}}\nflows: [{{{flow}}}]\n{more}"


def the_only(many: list[Finding]) -> Finding:
    assert len(many) == 1, many
    return many[0]


@needs_plugins("interchange")
def test_a_model_of_the_usual_size_with_fine_edges_has_no_findings(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj")
    assert found(tmp_path, ball_shot()) == []


@needs_plugins("interchange")
def test_edges_over_a_twelfth_of_the_subject_are_coarse_and_the_advised_length_is_not(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj")
    finding = the_only(found(tmp_path, ball_shot(edge=0.17)))
    assert finding.where == ("resample", "max_edge_length") and not finding.is_error
    advised = re.search(r"Write max_edge_length: ([\d.]+)\.", finding.text)
    assert advised
    assert found(tmp_path, ball_shot(edge=float(advised[1]))) == []
    assert found(tmp_path, ball_shot(edge=0.166)) == []


@needs_plugins("interchange")
def test_a_small_bunny_with_edges_of_half_its_size_is_no_good(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj", 0.15)
    finding = the_only(found(tmp_path, ball_shot(edge=0.08)))
    assert "Write subject.fit: 2, or choose" in finding.text
    assert found(tmp_path, ball_shot(edge=0.08, fit=", fit: 2")) == []


@needs_plugins("interchange")
@pytest.mark.parametrize("edge", [0.03, 0.04, 0.05])
def test_a_first_frame_over_the_budget_is_an_error_and_both_remedies_fit(tmp_path: Path, edge: float) -> None:
    write_ball(tmp_path / "ball.obj")
    budget = ", max_vertices: 10000"
    errors = found(tmp_path, ball_shot(edge, resample=budget))
    if not errors:
        assert edge > 0.04
        return
    error = the_only(errors)
    assert error.is_error and error.where == ("resample", "max_edge_length")
    remedies = re.search(r"Write max_edge_length: ([\d.]+), or max_vertices: (\d+)\.", error.text)
    assert remedies
    assert found(tmp_path, ball_shot(float(remedies[1]), resample=budget)) == []
    assert found(tmp_path, ball_shot(edge, resample=f", max_vertices: {remedies[2]}")) == []


@settings(max_examples=8, deadline=None)
@given(st.floats(0.05, 0.4))
def test_vertices_are_estimated_within_a_factor_of_about_two(edge: float) -> None:
    ball = icosphere(3)
    after, _ = resample(ball, Thresholds(max_edge_length=edge))
    assert 0.4 < estimated_vertices(ball, edge) / len(after.vertices) < 2.0


def write_scan(path: Path, away: float) -> None:
    """Write an OBJ of a ball of diameter 2 and two triangles of debris, `away` from its middle."""
    write_ball(path)
    bits = [f"v {away} {0.01 * k} {0.01 * (k % 2)}" for k in range(6)]
    path.write_text("\n".join([path.read_text(), *bits, "f -6 -5 -4", "f -3 -2 -1"]))


@needs_plugins("interchange")
@pytest.mark.parametrize(("away", "is_told"), [(5.0, True), (1.5, True), (1.05, False)])
def test_small_parts_that_make_a_model_larger_are_told_by_validate_and_for_new_shots(
    tmp_path: Path, away: float, is_told: bool
) -> None:
    write_scan(tmp_path / "ball.obj", away)
    told = [finding.text for finding in found(tmp_path, ball_shot(fit=", fit: 2"))]
    assert [text for text in told if text.startswith("ball.obj has 3 parts; the largest has 99.8%")] == told
    assert bool(told) == is_told
    notes = model_template(tmp_path / "ball.obj", "ball.obj").notes
    assert [note for note in notes if not note.startswith("model repaired")] == told
    if is_told:
        factor = (away + 1) / 2
        assert f"make the model {factor:.3g} times as large; the farthest reaches ({away:g}," in told[0]


@needs_plugins("interchange")
def test_two_parts_of_one_size_are_no_finding(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj")
    text = (tmp_path / "ball.obj").read_text()
    ball = icosphere(8)
    more = [f"v {x + 4!r} {y!r} {z!r}" for x, y, z in ball.vertices.tolist()]
    more += [f"f {a} {b} {c}" for a, b, c in (ball.faces + 1 + len(ball.vertices)).tolist()]
    (tmp_path / "ball.obj").write_text("\n".join([text, *more]))
    assert found(tmp_path, ball_shot(fit=", fit: 2")) == []


@needs_plugins("interchange")
@pytest.mark.parametrize(
    ("look", "is_told"),
    [("glass", True), ("smoke", True), ("{material: honey}", True), ("clay", False), ("glaze", False)],
)
def test_glass_and_smoke_on_an_open_surface_are_told(tmp_path: Path, look: str, is_told: bool) -> None:
    write_ball(tmp_path / "ball.obj")
    path, text = tmp_path / "shot.yaml", (tmp_path / "ball.obj").read_text()
    path.write_text(f"title: A ball\nframes: 1-24\n{ball_shot()}\nlook: {look}\n")
    for whole in (True, False):
        (tmp_path / "ball.obj").write_text(text if whole else text.rpartition("\n")[0])
        shot = read_shot(path)
        told = findings(shot, FirstFrames().of(shot.motion))
        assert [finding.where for finding in told] == ([("look",)] if is_told and not whole else [])
        assert all("the surface is open: it has 3 boundary edges on frame 1" in each.text for each in told)


@needs_plugins("interchange")
def test_a_camera_inside_the_subject_is_told_with_its_setting(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj")
    for camera, setting in (
        ("{position: [0.2, 0, 0]}", "position"),
        ("{distance: 0.5}", "distance"),
        ("{dolly: 0.05}", "dolly"),
        ("{position: {keys: {1: [5, 0, 0], 24: [0, 0, 0]}}}", "position"),
    ):
        finding = the_only(found(tmp_path, ball_shot(more=f"camera: {camera}")))
        assert finding.where == ("camera", setting) and "inside the subject" in finding.text
    assert found(tmp_path, ball_shot(more="camera: {position: [0, 0, 3]}")) == []


@needs_plugins("interchange")
def test_a_camera_below_the_floor_is_told_with_a_remedy_that_works(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj")
    finding = the_only(found(tmp_path, ball_shot(more="camera: {elevation: {keys: {1: 10, 24: -35}}}")))
    assert finding.where == ("camera", "elevation") and "below the floor" in finding.text
    advised = re.search(r"Write elevation: (-?\d+) or more", finding.text)
    assert advised
    assert found(tmp_path, ball_shot(more=f"camera: {{elevation: {advised[1]}}}")) == []
    placed = "camera: {position: [0, -1.6, 5]}"
    finding = the_only(found(tmp_path, ball_shot(more=placed)))
    assert finding.where == ("camera", "position") and "at the height -1.6" in finding.text
    assert found(tmp_path, ball_shot(more=f"{placed}\nstage: none")) == []
    assert found(tmp_path, ball_shot(more="camera: {position: [0, -0.8, 5]}")) == []


def test_a_camera_lower_than_one_subject_stands_on_the_floor_of_another(tmp_path: Path) -> None:
    box = "{solid: box, size: [1, 1, 1], place: [0, %d, 0]}"
    text = f"title: A\nframes: 1-4\nsubjects:\n  high: {box % 3}\n  low: {box % 0}\nflows: []\nlook: clay\n"
    shot = read_shot(
        tmp_path / "a.yaml", text + "camera: {position: [0, 0.4, 9]}\nresample: {max_edge_length: 0.08}\n"
    )
    assert [findings(part, FirstFrames().of(part.motion)) for part in shot.subjects] == [[], []]


def test_validate_tells_of_a_camera_below_the_floor_of_all_subjects(project: ProjectFolder) -> None:
    box = "{solid: box, size: [1, 1, 1], place: [0, %d, 0]}"
    text = f"title: A\nframes: 1-4\nsubjects:\n  high: {box % 3}\n  low: {box % 0}\nflows: []\nlook: clay\n"
    camera = "resample: {max_edge_length: 0.08}\ncamera: {position: [0, %s, 9]}\n"

    def warnings(height: float) -> list[str]:
        project.shot.write_text(text + camera % height)
        (checked,) = json.loads(project.call("--json", "validate", project.shot.stem).out)
        return list(checked["warnings"])

    assert warnings(0.4) == []
    told = the_only(warnings(-0.7))
    assert "below the floor, at the height -0.7" in told and "under the lowest point of all subjects" in told


@needs_plugins("contact")
@pytest.mark.parametrize("several", [False, True])
def test_a_floor_above_the_subject_is_an_error_at_the_entry_of_contact(
    project: ProjectFolder, several: bool
) -> None:
    subject = "subject: {solid: box, size: [1, 3, 1]}"
    if several:
        subject = "subjects:\n  one: {solid: box, size: [1, 3, 1]}"
    flows = "flows:\n  - rotation: {speed: 3}\n  - contact: {floor: 0}\n"
    text = f"title: A\nframes: 1-4\nresample: {{max_edge_length: 0.4}}\n{subject}\n{flows}look: clay\n"
    project.shot.write_text(text)
    (checked,) = json.loads(project.call("--json", "validate", project.shot.stem).out)
    place = text[: text.index("- contact")].count("\n") + 1
    assert f"{project.shot.name}:{place}:" in the_only(checked["errors"])


@needs_plugins("interchange")
def test_a_sun_behind_the_wall_of_the_stage_is_told_and_the_remedy_serves(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj")
    finding = the_only(found(tmp_path, ball_shot(more="lights: monument")))
    assert finding.where == ("lights",) and "the sun stands 17° high" in finding.text
    assert found(tmp_path, ball_shot(more="lights: monument\nstage: ground")) == []
    assert found(tmp_path, ball_shot(more="lights: {sun: {elevation: 20}}")) == []


@settings(max_examples=40, deadline=None)
@given(st.tuples(*[st.floats(-1.2, 1.2)] * 3))
def test_points_within_a_ball_are_inside(point: tuple[float, float, float]) -> None:
    ball = icosphere(6)
    first = FirstFrame(len(ball.vertices), ball.vertices, ball.faces, 0, None)
    distance = float(np.linalg.norm(point))
    if abs(distance - 0.98) > 0.02:  # the faces lie below the sphere
        assert is_inside(np.array(point), first) == (distance < 0.98)


@needs_plugins("interchange")
def test_a_lens_that_shows_nothing_sharp_is_told_and_the_remedy_serves(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj")

    def lens(more: str) -> list[Finding]:
        return found(tmp_path, ball_shot(more=f"camera: {{focal_length: 85, {more}}}"))

    told = the_only(lens("aperture: 2, focus: [0, 0, 0]"))
    assert told.where == ("camera", "aperture") and "at f/2 7% of the side" in told.text
    stop = re.search(r"aperture: (.+)\.$", told.text)
    assert stop and lens(f"aperture: {stop[1]}, focus: [0, 0, 0]") == lens("aperture: 8, focus: front") == []
    assert "nothing of the side" in the_only(lens("aperture: 4, focus: [0, 0, -2]")).text
    assert "Write focus: front." in the_only(lens("aperture: 4, focus: [0, 0, -60]")).text


@needs_plugins("interchange")
def test_flows_that_act_far_from_the_subject_are_told_and_both_remedies_serve(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj", 2.0, (300.0, 0.0, 0.0))
    finding = the_only(found(tmp_path, ball_shot()))
    assert finding.where == ("flows", 0) and finding.text.startswith("twist acts about a place 150 times")
    assert found(tmp_path, ball_shot(fit=", fit: 2")) == []
    centre = re.search(r"centre: (\[.*?\])", finding.text)
    assert centre
    assert found(tmp_path, ball_shot(flow=TWIST.replace("axis: y", f"axis: y, centre: {centre[1]}"))) == []


@needs_plugins("interchange")
def test_a_vortex_acts_all_along_its_axis(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj", 2.0, (0.0, 0.0, 300.0))
    assert found(tmp_path, ball_shot(flow="vortex: {axis: z, strength: 3}")) == []
    assert "vortex" in the_only(found(tmp_path, ball_shot(flow="vortex: {axis: x, strength: 3}"))).text


@pytest.mark.slow
def test_a_place_that_pictures_cannot_resolve_is_told(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj", 2.0, (1e5, 0.0, 0.0))
    flow = "translation: {rate: [1, 0, 0]}"
    finding = the_only(found(tmp_path, ball_shot(flow=flow)))
    assert finding.where == ("subject",) and "subject.fit: 2" in finding.text
    assert found(tmp_path, ball_shot(flow=flow, fit=", fit: 2")) == []


@needs_plugins("interchange")
def test_a_flow_that_tears_the_surface_is_told_and_fitting_the_model_serves(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj", 494.0)
    told = [f for f in found(tmp_path, ball_shot(edge=20.0)) if "times as long" in f.text]
    assert the_only(told).where == ("flows", 0) and "twist makes edges" in told[0].text
    assert found(tmp_path, ball_shot(edge=0.08, fit=", fit: 2")) == []


@needs_plugins("interchange")
def test_a_large_model_that_a_twist_shears_to_pieces_is_told_to_be_fitted(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj", 200.0)
    twist = "twist: {axis: y, amount: {keys: {1: 0, 24: 30}}}"
    told = found(tmp_path, ball_shot(edge=4.0, flow=twist))
    assert {finding.where for finding in told} == {("subject", "model"), ("flows", 0)}
    assert all("Write subject.fit: 2 and max_edge_length: 0.04" in finding.text for finding in told)
    assert found(tmp_path, ball_shot(edge=0.08, flow=twist, fit=", fit: 2")) == []


@needs_plugins("interchange")
@pytest.mark.parametrize(("scale", "edge"), [(1000.0, 0.08), (100.0, 4.0), (1e5, 1.0), (0.001, 0.002)])
def test_a_model_of_another_size_is_fitted_whatever_else_is_wrong_and_that_serves(
    tmp_path: Path, scale: float, edge: float
) -> None:
    write_ball(tmp_path / "ball.obj")
    told = found(tmp_path, ball_shot(edge, fit=f", scale: {scale}"))
    fits = [
        re.search(r"Write subject\.fit: 2 in place of scale(?:, and max_edge_length: (\d[.\d]*\d))?", f.text)
        for f in told
    ]
    assert told and fits[0] and fits[0][0] in told[0].text
    mended = float(fits[0][1]) if fits[0][1] else edge
    assert found(tmp_path, ball_shot(mended, fit=", fit: 2")) == []


@needs_plugins("interchange")
def test_a_frame_over_the_budget_says_so_at_once_and_names_the_fit(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj")
    path = tmp_path / "shot.yaml"
    path.write_text(f"title: A ball\nframes: 1-24\n{ball_shot(0.08, fit=', scale: 1000')}\nlook: clay\n")
    with pytest.raises(
        FrameError, match=r"frame 1: .*at least \d.*write subject\.fit: 2 in place of scale, or"
    ):
        next(animate(read_shot(path)))
    path.write_text(f"title: A ball\nframes: 1-24\n{ball_shot(0.002)}\nlook: clay\n")
    with pytest.raises(FrameError, match=r"exceeds the budget of 2000000; raise max_vertices or max_edge"):
        next(animate(read_shot(path)))


@needs_plugins("interchange", "fields")
def test_too_many_sub_steps_are_an_error_before_they_are_taken(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj")
    error = the_only(found(tmp_path, ball_shot(flow="curl_noise: {strength: 40000}")))
    assert error.is_error and "sub-steps a frame; 10000 are the most" in error.text


@pytest.mark.slow
def test_a_frame_that_takes_minutes_is_told_with_its_flow(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj")
    finding = the_only(found(tmp_path, ball_shot(edge=0.02, flow="curl_noise: {strength: 600, octaves: 1}")))
    assert finding.where == ("flows", 0) and not finding.is_error
    assert re.search(r"frame \d+ takes about \d+ s: flows.0 curl_noise takes .* sub-steps", finding.text)


@needs_plugins("interchange")
def test_shots_that_begin_alike_share_their_first_frame(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball.obj")
    found(tmp_path, ball_shot())
    first_frames, path = FirstFrames(), tmp_path / "shot.yaml"
    one = first_frames.of(read_shot(path).motion)
    other = first_frames.of(read_shot(path, settings=["flows.0.twist.axis=x"]).motion)
    assert one is other
    frame = next(animate(read_shot(path)))
    assert (one.vertices, one.memory) == (
        len(frame.mesh.vertices),
        sum(values.nbytes for values in frame.to_arrays().values()),
    )
    assert one.subject == "ball.obj (OBJ, 642 vertices, 1,280 faces)" and one.extent == pytest.approx(
        2.0, 0.01
    )


@given(st.floats(1e-9, 1e9))
def test_rounding_up_keeps_two_digits_and_is_never_less(value: float) -> None:
    up = rounded_up(value)
    assert value <= up * (1 + 1e-12) and up <= 1.11 * value and up == float(f"{up:.2g}")


def test_validate_reports_scenes_by_line_and_as_data(project: ProjectFolder) -> None:
    shots = project.path / "shots"
    write_ball(shots / "ball.obj")
    (shots / "broken.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    text = "title: A ball\nframes: 1-24\nsubject: {model: %s.obj}\nresample: {max_edge_length: %s}\nflows: []"
    (shots / "coarse.yaml").write_text(text % ("ball", 0.5))
    (shots / "fine.yaml").write_text(text % ("ball", 0.1))
    (shots / "broken.yaml").write_text(text % ("broken", 0.1))
    done = project.call("validate", "coarse", "fine")
    assert done.code == 0
    assert "Good: fine\nWith warnings: coarse\n" in done.out
    assert "shots/coarse.yaml:4:12: max_edge_length 0.5 is coarse" in done.err
    assert "ball.obj" in done.out
    done = project.call("--json", "validate", "coarse", "broken")
    coarse, broken = json.loads(done.out)
    assert done.code == 2
    assert coarse["errors"] == [] and len(coarse["warnings"]) == 1
    assert coarse["first_frame"]["vertices"] > 12 and coarse["first_frame"]["memory"] > 1000
    assert broken["errors"][0].startswith("shots/broken.yaml:3:11: ")


def test_validate_warns_of_keys_outside_of_a_shot_in_one_line(project: ProjectFolder) -> None:
    (project.path / "shots" / "late.yaml").write_text(
        "title: A box\nframes: 30-40\nsubject: {solid: box}\nresample: {max_edge_length: 0.08}\n"
        "flows: [{twist: {amount: {keys: {1: 0, 58: 40}}}}]\n"
        "camera: {azimuth: {keys: {1: 0, 20: 40}}, elevation: {keys: {41: 40, 50: 49}, before: continue}}\n"
    )
    (checked,) = json.loads(project.call("--json", "validate", "late").out)
    (warning,) = checked["warnings"]
    assert warning.startswith("shots/late.yaml:5:34: 6 keys are outside of the shot, which has frames 30-40;")
    assert "Nothing moves in camera.azimuth, whose keys are all outside." in warning
    assert "write {shot: late, frames: …} in the edit" in warning
    assert not [note for note in checked["notes"] if "outside" in note]


@needs_plugins("sheets")
def test_validate_and_sheets_tell_frames_without_highlights_or_light(
    finished: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(finished.path)
    for stops, note in ((-2.5, "no highlight"), (-9, "are nearly black"), (3, "")):
        dimmed = "--set", f"lights={{exposure: {stops}}}"
        for words in (("validate", "T010_tiny"), ("sheet", "T010_tiny", "-f", "1-2", "-q", QUALITY)):
            code, said = commanded(finished.path, *words, *dimmed)
            assert code == 0, said
            assert note in said if note else "highlight" not in said and "black" not in said


@needs_plugins("preview")
def test_an_empty_folder_is_told_how_to_make_a_shot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for words in (("validate",), ("preview", "A010"), ("render", "A010"), ("film",)):
        code, said = commanded(tmp_path, *words)
        assert code == 2 and "flowsculpt new A010_first" in said, words


@needs_plugins("interchange")
@pytest.mark.parametrize(
    ("flow", "right"),
    [
        ("twist: {amount: 60}", "{keys: {1: 0, 24: 60}}"),
        ("stretch: {amount: 2}", "{keys: {1: 1, 24: 2}}"),
        ("within: {region: {sphere: {radius: 1}}, flows: [{bend: {amount: 40}}]}", "{keys: {1: 0, 24: 40}}"),
    ],
)
def test_a_deformation_whose_amount_never_changes_moves_nothing(
    tmp_path: Path, flow: str, right: str
) -> None:
    write_ball(tmp_path / "ball.obj")
    finding = the_only(found(tmp_path, ball_shot(flow=flow)))
    name = re.findall(r"(\w+): {amount", flow)[0]
    assert finding.text == (
        f"{name} moves nothing, for its amount is the same in every frame. Write amount: {right}."
    )
    mended = re.sub(r"amount: \d+", f"amount: {right}", flow)
    assert found(tmp_path, ball_shot(flow=mended)) == []
