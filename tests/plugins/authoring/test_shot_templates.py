"""New shots: of every flow one that works at once."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.authoring.shot_schemas import facts
from flowsculpt.pipeline.plugins.authoring.shot_templates import (
    FLOW_FILES,
    FRAMES,
    preset_of,
    presets,
    shot_of_flow,
    shot_of_shot,
)
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.documents.flow_documents import FLOW_DOCUMENTS
from tests.conftest import ProjectFolder
from tests.needed_plugins import SHIPPED, needs_plugins

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"

each = pytest.mark.parametrize("flow", FLOW_DOCUMENTS)
SLOW = pytest.mark.soak
"""A fit of `become` takes 20 seconds."""


def begun(flow: str, folder: Path, coarser: float = 1.0) -> tuple[str, Path]:
    """The text of a shot of a flow, and where it stands with the file that it reads."""
    if flow in FLOW_FILES:
        ending, write = FLOW_FILES[flow]
        write(folder / f"N1{ending}")
    text = shot_of_flow(flow, "N1")
    preset = preset_of(flow)
    length = f"{coarser * preset.max_edge_length:g}" if coarser > 1.0 else preset.edge_length
    (folder / "N1.yaml").write_text(text.replace(preset.edge_length, length))
    return text, folder / "N1.yaml"


@pytest.mark.parametrize(
    "flow", [pytest.param(flow, marks=SLOW if flow == "become" else ()) for flow in FLOW_DOCUMENTS]
)
def test_a_shot_of_each_flow_moves_what_it_shows(flow: str, tmp_path: Path) -> None:
    """Some frames on from where it is strongest, with a coarse surface."""
    _, path = begun(flow, tmp_path, coarser=4.0)
    shot = read_shot(path, allow_code=True)
    assert shot.title == "N1" and len(shot.frames) == FRAMES
    frames = animate(shot)
    first = next(frames)
    points, clock = first.mesh.vertices, shot.motion.clock
    assert len(next(frames).mesh.faces) > 20
    for number in range(2 if flow == "contact" else 30, 34):  # contact undoes what it did before
        points = shot.motion.flow.displace(points, *clock.step(number))
    assert np.isfinite(points).all()
    moved = np.linalg.norm(points - first.mesh.vertices, axis=1).max()
    assert 0.01 < moved < 1.0, "it is seen to move, and does not fly away"


@each
def test_a_new_shot_says_what_may_be_changed(flow: str) -> None:
    text = shot_of_flow(flow, "N1")
    assert facts(flow)["description"] in text
    assert max(map(len, text.splitlines())) <= 180
    for parameter in facts(flow)["parameters"]:
        if not (parameter["default"] in (None, {}) and parameter["name"] not in preset_of(flow).values):
            assert f"{parameter['name']}: " in text and parameter["description"] in text


@pytest.mark.soak
@each
def test_a_shot_of_each_flow_comes_to_its_end(flow: str, tmp_path: Path) -> None:
    _, path = begun(flow, tmp_path, coarser=2.5)
    last = list(animate(read_shot(path, allow_code=True)))[-1].mesh
    assert np.ptp(last.vertices, axis=0).max() < 8.0


def _needs_a_preset(flow: str) -> bool:
    """Tell whether only a preset can choose a flow's file, formulas or curve."""
    return flow in ("attraction", "become") or any(
        p["required"] and not p["keyed"] for p in facts(flow)["parameters"]
    )


@pytest.mark.parametrize("flow", [flow for flow in FLOW_DOCUMENTS if not _needs_a_preset(flow)])
def test_flows_without_a_preset_are_set_up_by_their_parameters(
    flow: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flowsculpt.pipeline.plugins.authoring.shot_templates.presets", dict)
    read_shot(tmp_path / "a.yaml", shot_of_flow(flow, "a"))


@needs_plugins(*SHIPPED)
def test_the_table_holds_flows_and_their_parameters() -> None:
    assert set(presets()) <= set(FLOW_DOCUMENTS)
    for flow, preset in presets().items():
        assert set(preset.values) <= {parameter["name"] for parameter in facts(flow)["parameters"]}
    with pytest.raises(UsageError, match="Did you mean 'vortex'"):
        shot_of_flow("vortx", "a")


@pytest.mark.parametrize("name", ["007", "1e3", "true", "off", "A-b_c"])
def test_a_title_is_text_whatever_it_looks_like(name: str, tmp_path: Path) -> None:
    assert read_shot(tmp_path / "a.yaml", shot_of_flow("vortex", name)).title == name.replace(
        "-", " "
    ).replace("_", " ")


def test_a_copy_keeps_everything_but_the_title() -> None:
    text = "# yaml-language-server: $schema=x.json\n# A cube\ntitle: Cube  # old\nframes: 1-9\n"
    assert shot_of_shot(text, "A2_new") == "# A cube\ntitle: A2 new\nframes: 1-9\n"
    assert shot_of_shot("extends: A\n", "B") == "title: B\nextends: A\n"


@pytest.mark.parametrize(
    "name", ["part [red] v2", "-j", "M" * 200, "dot. ", "ünï {x} $HOME %d `e` 'q' \"d\", ~ #a: b"]
)
def test_a_shot_of_a_model_names_it_as_it_is_called(name: str, project: ProjectFolder) -> None:
    model = project.path / f"{name}.obj"
    model.write_text(OBJ)
    done = project.call("new", "M010_odd", "--model", f"./{name}.obj")
    assert done.code == 0, done.err
    assert name in (project.path / "shots/M010_odd.yaml").read_text()
    checked = project.call("validate", "M010_odd")
    assert checked.code == 0, checked.err


@pytest.mark.parametrize(
    ("name", "says"),
    [
        (b"caf\xe9", "caf\\xe9.obj: this name is not UTF-8"),
        (b"two\nlines", "'two\\nlines.obj': a line break or control character"),
    ],
)
def test_a_name_that_no_shot_file_can_hold_is_refused_in_one_line(
    name: bytes, says: str, project: ProjectFolder, capfd: pytest.CaptureFixture[str]
) -> None:
    model = os.fsdecode(name + b".obj")
    (project.path / model).write_text(OBJ)
    done = project.call("new", "M010_odd", "--model", model)
    said = done.err + capfd.readouterr().err
    assert done.code == 2 and says in said and said.count("\n") == 1
    assert not (project.path / "shots/M010_odd.yaml").exists()
