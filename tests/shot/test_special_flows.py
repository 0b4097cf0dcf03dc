"""Fields in shot files: what can be said, and how what is wrong is told, with line and column."""

from __future__ import annotations

from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.flow import Sequence, Streamlines
from flowsculpt.pipeline.plugins.fields.attraction import Attraction, Wind
from flowsculpt.pipeline.plugins.fields.curl_noise import CurlNoise
from flowsculpt.pipeline.plugins.fields.formula_field import FormulaField
from flowsculpt.pipeline.plugins.python.python_flow import PythonFlow
from flowsculpt.pipeline.shot import Shot, read_shot
from tests.needed_plugins import needs_plugins, shot_rows

HEAD = "title: T\nframes: 1-24\nsubject: {solid: icosphere}\nresample: off\nflows:\n"
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def shot_of(folder: Path, *flows: str) -> Shot:
    return read_shot(folder / "a.yaml", HEAD + "".join(f"  - {flow}\n" for flow in flows))


def fields_of(shot: Shot) -> list[object]:
    assert isinstance(shot.motion.flow, Sequence)
    return [flow.field if isinstance(flow, Streamlines) else flow for flow in shot.motion.flow.flows]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "t.obj").write_text(TRIANGLE)
    (tmp_path / "swirl.py").write_text("def swirl(points, time, dt):\n    return points\n")
    return tmp_path


@needs_plugins("interchange")
def test_every_field_can_be_written(folder: Path) -> None:
    found = fields_of(
        shot_of(
            folder,
            "formula: [-y, x, 0.3 * sin(t)]",
            "formula: {velocity: [k * y, 0, 0.5], with: {k: {keys: {1: 0, 24: 2}}}, extent: 3}",
            "curl_noise:",
            "curl_noise: {size: 0.5, octaves: 2, seed: 7}",
            "attraction: {points: [[0, 0, 0]], rate: 2}",
            "attraction: {curve: [[0, 0, 0], [1, 0, 0]], closed: true}",
            "attraction: {mesh: t.obj, rate: -1, radius: 2}",
            "wind: {through: [[0, 0, 0], [1, 0, 0], [1, 1, 0]], speed: 2}",
            "python: {file: swirl.py, function: swirl}",
        )
    )
    kinds = [
        FormulaField,
        FormulaField,
        CurlNoise,
        CurlNoise,
        *[Attraction] * 3,
        Wind,
        PythonFlow,
    ]
    assert [type(field) for field in found] == kinds
    keyed = found[1]
    assert isinstance(keyed, FormulaField) and keyed.numbers(23 / 24) == (2.0,)


def test_fields_are_added_up_like_others(folder: Path) -> None:
    shot = shot_of(folder, "sum: [vortex: {}, formula: [x, y, z], wind: {through: [[0, 0, 0], [1, 0, 0]]}]")
    (total,) = fields_of(shot)
    assert len(total.fields) == 3  # type: ignore[attr-defined]


WRONG = [
    ("formula: [-y, x, sinn(t)]", "6:22: sinn is not a function here. Did you mean 'sin'?"),
    ("formula: [x, y, 1e400]", "6:21: this number is too large; 1e100 is the largest"),
    ("formula: [x, y, 3 + 1 / 0]", "6:25: 1 / 0 is inf; a formula must be finite. Write another."),
    ("formula: [x, y, x / (2 - 2) + log(0)]", "6:35: log(0) is -inf; a formula must be finite."),
    (
        "python: {file: broken.py, function: f}",
        "broken.py: this is not Python (line 2): expected ':'. Correct it there.",
    ),
    (
        "within: {region: {mesh: t.obj}, flows: [{vortex: }]}",
        "6:23: {folder}/t.obj: 3 edges have a face on one side only; a closed surface is needed: fill",
    ),
    ("within: {region: {mesh: {file: t.obj, scal: 2}}, flows: [{vortex: }]}", "Did you mean 'scale'?"),
    ("within: {region: {mesh: gone.obj}, flows: [{vortex: }]}", "6:23: file gone.obj is not there"),
    ("formula: [x, .nan, y]", "6:18: this is not a number; write one plainly, such as 0.05"),
    ("formula: [x, -1e400, y]", "6:18: this number is too large; 1e100 is the largest"),
    ("formula: [x, y * 1e400, 0]", "6:22: this number is too large; 1e100 is the largest"),
    ("formula: [x, y, seconds]", "6:21: seconds is not known here. Write t."),
    ("formula: {velocity: [x, y, z], with: {time: 1}}", "'time' cannot name a number"),
    (
        f"formula: {{velocity: [frame, y, z], with: {{{', '.join(f'k{i}: 1' for i in range(10))}}}}}",
        "a formula has 10 numbers of its own beside frame; 9 are the most",
    ),
    ('formula: ["-y", "x + os", "0"]', "6:26: os is not known here. Did you mean 'cos'?"),
    ("formula: {velocity: [y, 'k * open(1)', 0], with: {k: 1}}", "6:34: open is not a function here"),
    ("formula: -y, x, 0", "formula: '-y, x, 0' is not a list of three, such as [-y, x, 0]"),
    ("formula: [x, y]", "formula: 2 items; it must have at least 3"),
    ("formula: {velocity: [x, y, z], with: {sin: 1}}", "'sin' cannot name a number"),
    (
        "formula: {velocity: [x, y, z], extend: 3}",
        "flows.0.formula.extend: unknown name. Did you mean 'extent'?",
    ),
    (
        "curl_noise: {octaves: 0}",
        "6:18: flows.0.curl_noise.octaves: 0 is out of range; it must be at least 1",
    ),
    ("curl_noise: {sede: 1}", "Did you mean 'seed'?"),
    (
        "attraction: {rate: 2}",
        "attraction is one of points, curve, mesh, and this has none",
    ),
    ("attraction: {mesh: }", "flows.0.attraction: mesh is empty. Write its value."),
    ("attraction: {points: [[0, 0, 0]], mesh: t.obj}", "and this has points and mesh. Write one."),
    ("attraction: {mesh: gone.obj}", "file gone.obj is not there; it is looked for beside the shot file"),
    ("attraction: {mesh: swirl.py}", ".py is not a mesh format"),
    ("wind: {through: [[0, 0, 0]]}", "1 item; it must have at least 2"),
    ("wind: {through: [[0, 0, 0], [0, 0, 0]]}", "twice in a row"),
    (
        "sum: [vortex: {}, twist: {amount: 3}]",
        "6:23: twist is not a velocity field, and only those add up. Make it an entry of flows.",
    ),
    ("python: {file: gone.py, function: f}", "file gone.py is not there"),
    ("python: {file: /dev/zero, function: f}", "file /dev/zero is a device; it must be a regular file"),
    ("attraction: {mesh: /dev/zero}", "file /dev/zero is a device; it must be a regular file"),
    (f"python: {{file: {'n' * 5000}, function: f}}", "is not there; it is looked for beside the shot file"),
    ('attraction: {mesh: "a\\0b.obj"}', "file 'a\\x00b.obj' is not there"),
    ("python: {file: swirl.py}", "function: missing"),
    ("python: {file: swirl.py, function: swirl()}", "'swirl()' names no function"),
]


@pytest.mark.parametrize(("flow", "says"), shot_rows(WRONG), ids=[flow[:60] for flow, _ in WRONG])
def test_what_is_wrong_is_told_in_one_line_with_its_place(flow: str, says: str, folder: Path) -> None:
    (folder / "broken.py").write_text("x = 1\ndef f(points)\n    return points\n")
    with pytest.raises(ShotError) as told:
        shot_of(folder, flow)
    (message,) = told.value.messages
    assert says.replace("{folder}", str(folder)) in message, message
    assert message.startswith(f"{folder / 'a.yaml'}:6:") and message.isprintable() and len(message) < 700


@needs_plugins("interchange")
def test_contents_of_files_decide_and_not_their_names(folder: Path) -> None:
    shot = shot_of(
        folder,
        "attraction: {mesh: t.obj}",
        "python: {file: swirl.py, function: swirl}",
    )
    before = shot.motion.step_data(5)
    for old, new in (("t.obj", "u.obj"), ("swirl.py", "whirl.py")):
        (folder / new).write_bytes((folder / old).read_bytes())
    moved = shot_of(
        folder,
        "attraction: {mesh: u.obj}",
        "python: {file: whirl.py, function: swirl}",
    )
    assert moved.motion.step_data(5) == before
    (folder / "whirl.py").write_text("def swirl(points, time, dt):\n    return 2 * points\n")
    (folder / "u.obj").write_text(TRIANGLE.replace("1 0 0", "2 0 0"))
    again = shot_of(
        folder,
        "attraction: {mesh: u.obj}",
        "python: {file: whirl.py, function: swirl}",
    )
    same = [a == b for a, b in zip(again.motion.step_data(5), before, strict=True)]
    assert same == [False, False]
