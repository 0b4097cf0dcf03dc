"""Shot files' `resample`: thresholds that vary over the surface and in time, and errors."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import FrameError, ShotError
from flowsculpt.pipeline.flow import keyed
from flowsculpt.pipeline.mesh import validate
from flowsculpt.pipeline.resample import (
    Curvature,
    DistanceToCamera,
    ThresholdFormula,
    Thresholds,
    polygon_method,
    polygon_methods,
)
from flowsculpt.pipeline.shot import Motion, read_shot
from flowsculpt.pipeline.shot.documents.resampling import KeyedCamera, KeyedThreshold
from flowsculpt.pipeline.shot.motion import Resampling
from tests.needed_plugins import needs_plugins, shot_rows

SHOT = """\
title: Ball
frames: 1-25
subject: {solid: icosphere, radius: 1}
resample: {max_edge_length: %s}
"""

CURVED = "{curvature: {tolerance: 0.002, finest: 0.05, coarsest: 0.4}}"


def motion(resample: str) -> Motion:
    return read_shot("a.yaml", SHOT % resample).motion


def thresholds(resample: str) -> Thresholds:
    found = motion(resample).resampling
    assert found is not None
    return found.thresholds


def told(resample: str) -> list[str]:
    with pytest.raises(ShotError) as error:
        read_shot("a.yaml", SHOT % resample)
    return list(error.value.messages)


def test_lengths_may_be_functions() -> None:
    assert thresholds("{formula: 0.1 + 0.01*abs(y)}").max_edge_length == ThresholdFormula("0.1 + 0.01*abs(y)")
    assert thresholds(CURVED).max_edge_length == Curvature(0.002, 0.05, 0.4)
    camera = "{camera: {position: [0, 0, 5], pixels: 8, finest: 0.05, coarsest: 0.5, field_of_view: 40}}"
    expected = DistanceToCamera((0.0, 0.0, 5.0), 8.0, 0.05, 0.5, 40 * math.radians(1), 1920.0)
    assert thresholds(camera).max_edge_length == expected
    both = thresholds("0.2, min_edge_length: {formula: 0.05 + 0.01*x}, gradation: 0.5")
    assert both.min_edge_length == ThresholdFormula("0.05 + 0.01*x") and both.gradation == 0.5


def test_curvature_heeds_the_hard_angle_of_the_shot() -> None:
    assert thresholds(f"{CURVED}, hard_angle: 60").max_edge_length == Curvature(
        0.002, 0.05, 0.4, 60 * math.radians(1)
    )


def test_a_hard_angle_is_in_degrees_however_it_is_written() -> None:
    angle = thresholds("0.2, hard_angle: {formula: 40 + 10*y}")
    found = angle.fields(motion("0.2").mesh_at_rest())[:, 2]
    assert math.degrees(found.max()) == pytest.approx(50) and math.degrees(found.min()) == pytest.approx(30)
    turning = thresholds("0.2, hard_angle: {ease: linear, keys: {1: 30, 25: 60}}")
    assert turning.at(13, 0.5).hard_angle == pytest.approx(math.radians(45))


def test_thresholds_may_be_keyed() -> None:
    found = thresholds("{ease: linear, keys: {1: 0.4, 25: 0.2}}")
    assert found.max_edge_length == KeyedThreshold(keyed((0.0, 1.0), (0.4, 0.2), "linear"))
    halfway = found.at(13, 0.5)
    assert halfway.numbers[:2] == pytest.approx((0.3, 0.12))
    camera = thresholds(
        "{camera: {position: {ease: linear, keys: {1: [0, 0, 3], 25: [0, 0, 9]}}, pixels: 8, "
        "finest: 0.05, coarsest: 0.5}}"
    )
    assert isinstance(camera.max_edge_length, KeyedCamera)
    now = camera.at(13, 0.5).max_edge_length
    assert isinstance(now, DistanceToCamera) and now.position == (0.0, 0.0, 6.0)


def data_of(found: Motion) -> list[Any]:
    return [found.start_data(), *(found.step_data(frame) for frame in found.frames.numbers[1:])]


def test_a_key_changed_late_leaves_the_earlier_frames_alone() -> None:
    one, other = (data_of(motion(f"{{keys: {{1: 0.4, 12: 0.2, 25: {last}}}}}")) for last in (0.1, 0.3))
    assert one[:12] == other[:12]
    assert all(a != b for a, b in zip(one[12:], other[12:], strict=True))
    assert json.loads(json.dumps(one, allow_nan=False)) == one


def test_what_does_not_depend_on_time_is_said_once() -> None:
    still = motion(CURVED)
    assert [still.step_data(frame) for frame in (2, 25)] == [[], []]
    assert still.start_data() != motion(CURVED.replace("0.002", "0.001")).start_data()
    timed = data_of(motion("{formula: 0.2 + 0.01*time}"))
    assert len({json.dumps(step) for step in timed}) == len(timed)


def test_gradation_counts_where_lengths_are_functions() -> None:
    assert data_of(motion("0.2")) == data_of(motion("0.2, gradation: 0.9"))
    assert data_of(motion(CURVED)) != data_of(motion(f"{CURVED}, gradation: 0.9"))


@needs_plugins("polyhedra")
def test_settings_that_the_method_ignores_are_no_part_of_any_mesh() -> None:
    polyhedra = "0.2, method: polyhedra"
    assert data_of(motion(polyhedra)) == data_of(motion(f"{polyhedra}, min_roundness: 0.9, placement: chord"))
    assert data_of(motion(polyhedra)) != data_of(motion(f"{polyhedra}, cutting: recurse"))
    assert data_of(motion("0.2")) == data_of(motion("0.2, collapse: areas"))


def test_settings_stand_under_their_names() -> None:
    found = motion("0.2, placement: curved").resampling_at(1)
    assert isinstance(found, Resampling)
    settings = found.settings()
    assert settings["max_edge_length"] == 0.2 and settings["placement"] == "curved"
    assert json.loads(json.dumps(settings)) == settings
    assert "cutting" not in settings and "normals" not in settings  # which nothing came of


@needs_plugins("polyhedra")
def test_settings_of_polyhedra_stand_under_their_names() -> None:
    sliced = motion("0.2, method: polyhedra").resampling_at(1)
    assert sliced is not None
    assert set(sliced.settings()) == {
        *("max_edge_length", "min_edge_length", "hard_angle", "max_vertices", "gradation"),
        *("method", "creases", "cutting", "collapse"),
    }


WRONG = [
    ("{formula: 0.1 + sinn(y)}", ["a.yaml:4:45: sinn is not a function here. Did you mean 'sin'?"]),
    ('{formula: "0.1 + tim"}', ["a.yaml:4:46: tim is not known here. Did you mean 'time'?"]),
    ("{formula: [0.1]}",
     ["a.yaml:4:30: resample.max_edge_length.formula: a list is not text"]),
    ("{formula: 1e400}", ["a.yaml:4:39: this number is too large; 1e100 is the largest"]),
    ("{formula: seconds / 9}", ["a.yaml:4:39: seconds is not known here. Write t."]),
    ("{formla: x}", ["a.yaml:4:30: resample.max_edge_length.formla: unknown name. "
                     "Did you mean 'formula'?"]),
    ("{}", ["a.yaml:4:12: resample.max_edge_length: a length without keys is one of formula, "
            "curvature, camera, and this has none. Write one."]),
    ("{formula: x, curvature: {tolerance: 1, finest: 1, coarsest: 2}}",
     ["a.yaml:4:12: resample.max_edge_length: a length without keys is one of formula, "
      "curvature, camera, and this has formula and curvature. Write one."]),
    ("{curvature: {tolerance: 1, finest: 3, coarsest: 2}}",
     ["a.yaml:4:56: finest 3 is longer than coarsest 2; it must not be. Exchange them."]),
    ("{keys: {1: 0.2, 20: 0.1}}, min_edge_length: 0.06",
     ["a.yaml:4:45: min_edge_length 0.06 is 60% of max_edge_length 0.1; it must be below 50%, "
      "or splitting and collapsing undo each other. Try 0.04."]),
    (f"{CURVED}, min_edge_length: 0.03",
     ["a.yaml:4:60: min_edge_length 0.03 is 60% of max_edge_length 0.05; it must be below 50%, "
      "or splitting and collapsing undo each other. Try 0.02."]),
    ("0.2, hard_angle: {curvature: 3}",
     ["a.yaml:4:34: resample.hard_angle.formula: missing; it has no default",
      "a.yaml:4:47: resample.hard_angle.curvature: unknown name. There are: formula."]),
    ("0.2, hard_angle: {formula: 40 + }",
     ["a.yaml:4:60: this is not arithmetic. Look for a missing operator or bracket."]),
    ("0.2, splits: faces",
     ["a.yaml:4:34: splits: faces puts new vertices in the middle of their edges, and by default placement "
      "is exact. Write placement: chord, or leave splits out."]),
    ("0.2, placement: curved, splits: faces",
     ["a.yaml:4:53: splits: faces puts new vertices in the middle of their edges, and placement is curved. "
      "Write placement: chord, or leave splits out."]),
    ("0.2, method: polyhedron",
     ["a.yaml:4:34: resample.method: 'polyhedron' is not a method. Did you mean 'polyhedra'?"]),
]  # fmt: skip


@pytest.mark.parametrize(("resample", "messages"), shot_rows(WRONG), ids=[resample for resample, _ in WRONG])
def test_a_mistake_is_told_with_its_place(resample: str, messages: list[str]) -> None:
    assert told(resample) == messages


def test_a_formula_over_several_lines_is_told_with_its_column() -> None:
    text = SHOT.replace(
        "{max_edge_length: %s}", "\n  max_edge_length:\n    formula: >-\n      0.1\n      + q"
    )
    with pytest.raises(ShotError, match=r"a\.yaml:6:5: column 7 of the formula: q is not known here"):
        read_shot("a.yaml", text)


def test_a_solid_is_meshed_for_the_finest_edges_of_its_first_frame() -> None:
    curved = motion(CURVED).mesh_at_rest()
    plain = motion(str(math.sqrt(8 * 0.002))).mesh_at_rest()
    assert 0.8 < len(curved.vertices) / len(plain.vertices) < 1.25
    keyed_ = motion("{keys: {1: 0.4, 25: 0.2}}").mesh_at_rest()
    assert len(keyed_.vertices) == len(motion("0.4").mesh_at_rest().vertices)


def test_a_film_follows_its_keys_and_goes_on_with_the_same_bits() -> None:
    shot = motion("{ease: linear, keys: {1: 0.5, 9: 0.25}}, placement: chord")
    frames = [frame for frame, _ in zip(animate(shot), range(10), strict=False)]
    counts = [len(frame.mesh.vertices) for frame in frames]
    assert counts[8] > 2 * counts[0] and counts[9] == counts[8]
    for frame in frames:
        corners = frame.mesh.vertices[frame.mesh.faces]
        now = shot.resampling_at(frame.number)
        assert now is not None
        longest = np.linalg.norm(corners - corners[:, (1, 2, 0)], axis=2).max()
        assert longest <= now.thresholds.numbers[0] * (1 + 1e-12)
        assert validate(frame.mesh).closed
    again = [frame for frame, _ in zip(animate(shot, resume=frames[3]), range(6), strict=False)]
    for one, other in zip(frames[4:], again, strict=True):
        assert one.mesh.vertices.tobytes() == other.mesh.vertices.tobytes()


def test_a_formula_that_breaks_in_a_later_frame_stops_there() -> None:
    shot = motion("{formula: 0.3 if frame < 5 else 1/(frame - 5)}, placement: chord")
    good = []
    with pytest.raises(FrameError, match=r"frame 5: .*is inf at x .*frame 5") as error:
        for frame in animate(shot):
            good.append(frame.number)
    assert good == [1, 2, 3, 4] and error.value.exit_code == 1


def test_edges_of_a_region_stay_hard() -> None:
    shot = motion("0.3, creases: {formula: x*x + z*z < 0.3 and y > 0}, placement: chord")
    first = next(animate(shot)).mesh
    assert len(first.creases) > 5
    x, y, z = first.vertices[first.creases.ravel()].T
    assert (x * x + z * z < 0.3).all() and (y > 0).all()
    assert data_of(shot) != data_of(motion("0.3, creases: none, placement: chord"))
    assert told("0.3, creases: {formula: time > 1}") == [
        "a.yaml:4:53: time is not known here. There are: x, y, z, pi, e, and functions such as sin(x)."
    ]


def test_the_documented_lengths_are_good() -> None:
    page = Path(__file__).parents[2] / "docs" / "shot-files.md"
    block = next(
        text for text in page.read_text("utf-8").split("```yaml\n") if text.startswith("max_edge_length")
    )
    lines = block.split("```")[0].splitlines()
    kinds = [type(thresholds(line.partition(": ")[2]).max_edge_length) for line in lines]
    assert kinds == [ThresholdFormula, Curvature, DistanceToCamera]


def test_every_setting_is_documented_with_its_default() -> None:
    page = (Path(__file__).parents[2] / "docs" / "shot-files.md").read_text("utf-8")
    found = motion("0.2").resampling
    assert found is not None
    defaults = {field.name: getattr(found, field.name) for field in dataclasses.fields(Resampling)}
    del defaults["thresholds"], defaults["options"]
    for method in polygon_methods():
        defaults |= polygon_method(method).model_dump()
    for name, default in defaults.items():
        shown = f"`{default}`" if isinstance(default, str) else "–" if default is None else f"{default:g}"
        assert f"| `{name}` | {shown} |" in page, name
