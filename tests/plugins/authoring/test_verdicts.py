"""`validate` says again what it found, and checks again whatever may have changed it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.plugins.authoring import shot_checks
from flowsculpt.pipeline.production.request import shot_source
from tests.conftest import ProjectFolder
from tests.needed_plugins import needs_plugins

SHOT = """\
title: A wedge
frames: 1-5
subject: {model: models/wedge.obj, paint: on}
look: model
resample: {max_edge_length: 0.5}
flows:
  - twist: {axis: y, amount: {keys: {1: 0, 5: 60}}}
"""
WEDGE = (
    "mtllib looks/a.mtl looks/b.mtl\nv 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 1\nusemtl red\n"
    "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
)


@pytest.fixture
def show(project: ProjectFolder) -> ProjectFolder:
    """A folder where a run has begun, so that it has a planning cache of its own."""
    (project.path / ".flowsculpt").mkdir()
    return project


@pytest.fixture
def wedge(show: ProjectFolder) -> ProjectFolder:
    """The same with a shot of a model, one of whose two files of materials is missing."""
    (show.path / "shots/models/looks").mkdir(parents=True)
    (show.path / "shots/A010_wedge.yaml").write_text(SHOT)
    (show.path / "shots/models/wedge.obj").write_text(WEDGE)
    (show.path / "shots/models/looks/a.mtl").write_text("newmtl red\nKd 1 0 0\n")
    return show


@pytest.fixture
def checked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the shots that were checked."""
    names = list[str]()
    check = shot_checks.check_shot

    def noted(verdict: Any, *given: Any) -> Any:
        names.append(verdict.name)
        return check(verdict, *given)

    monkeypatch.setattr(shot_checks, "check_shot", noted)
    return names


@needs_plugins("interchange")
def test_what_was_found_is_said_again_word_for_word(wedge: ProjectFolder, checked: list[str]) -> None:
    first = wedge.call("validate")
    assert first.code == 0 and "Note: A010_wedge: model wedge.obj: it names its materials" in first.out
    assert "is coarse for a subject" in first.err
    assert wedge.call("validate") == first
    facts = wedge.call("--json", "validate")
    assert json.loads(facts.out)[0]["first_frame"]["subject"].startswith("wedge.obj (OBJ, 4 vertices")
    assert checked == ["A010_wedge", "T010_tiny"]
    fresh = wedge.call("--json", "validate", "--fresh")
    assert fresh == facts and len(checked) == 4


def replaced(path: str, old: str, new: str) -> Any:
    def change(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        text = (root / path).read_text()
        (root / path).write_text(text.replace(old, new))
        assert (root / path).read_text() != text

    return change


def written(path: str, text: str) -> Any:
    return lambda root, monkeypatch: (root / path).write_text(text)


def installed(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from flowsculpt.pipeline.plugin import plugins

    monkeypatch.setitem(vars(plugins()), "packages", (*plugins().packages, "pip-99.dist-info"))


CHANGES = {
    "the shot": replaced("shots/A010_wedge.yaml", "60", "70"),
    "the model": replaced("shots/models/wedge.obj", "v 2 0 0", "v 3 0 0"),
    "materials of the model": replaced("shots/models/looks/a.mtl", "1 0 0", "0 1 0"),
    "a file that was missing": written("shots/models/looks/b.mtl", "newmtl blue\nKd 0 0 1\n"),
    "defaults of the folder": written("shots/defaults.yaml", "lights: overcast\n"),
    "the code": lambda root, patch: patch.setattr(shot_source, "_code", lambda: ["other"]),
    "a package": installed,
    "the machine": lambda root, patch: patch.setattr("platform.node", lambda: "elsewhere"),
    "the environment": lambda root, patch: patch.setenv("NUMBA_NUM_THREADS", "1"),
}


@needs_plugins("interchange")
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_what_may_change_a_verdict_has_the_shot_checked_again(
    wedge: ProjectFolder, checked: list[str], monkeypatch: pytest.MonkeyPatch, change: Any
) -> None:
    wedge.call("validate", "A010_wedge")
    wedge.call("validate", "A010_wedge")
    change(wedge.path, monkeypatch)
    kept = wedge.call("validate", "A010_wedge")
    assert len(checked) == 2
    assert wedge.call("validate", "A010_wedge", "--fresh") == kept


def test_settings_have_verdicts_of_their_own(show: ProjectFolder, checked: list[str]) -> None:
    finer = "validate", "T010_tiny", "--set", "resample.max_edge_length=0.25"
    first, other = show.call("validate", "T010_tiny"), show.call(*finer)
    assert first.out != other.out
    assert (show.call("validate", "T010_tiny"), show.call(*finer)) == (first, other)
    assert len(checked) == 2


def test_a_shot_is_checked_again_after_the_one_that_it_extends(
    show: ProjectFolder, checked: list[str]
) -> None:
    (show.path / "shots/B010.yaml").write_text("extends: T010_tiny\ntitle: B\n")
    first = show.call("validate", "B010")
    assert show.call("validate", "B010") == first and len(checked) == 1
    replaced("shots/T010_tiny.yaml", "0.5", "0.3")(show.path, None)
    assert show.call("validate", "B010").out != first.out and len(checked) == 2


@needs_plugins("python")
def test_a_shot_is_checked_again_after_its_python_file(show: ProjectFolder, checked: list[str]) -> None:
    assert show.call("new", "A020", "--from", "python").code == 0
    first = show.call("validate", "A020")
    assert show.call("validate", "A020") == first and len(checked) == 1
    (show.path / "shots/A020.py").write_text("def swirl(points, time, dt):\n    return points\n")
    assert show.call("validate", "A020").code == first.code and len(checked) == 2


def test_mistakes_are_looked_for_each_time(show: ProjectFolder, checked: list[str]) -> None:
    good = show.shot.read_text()
    show.shot.write_text(good.replace("max_edge_length", "max_edge_lenght"))
    wrong = [show.call("validate", "T010_tiny") for _ in range(2)]
    assert wrong[0] == wrong[1] and wrong[0].code == 2 and len(checked) == 2
    show.shot.write_text(good)
    assert show.call("validate", "T010_tiny").code == 0


def test_a_file_that_changes_during_the_check_leaves_no_verdict(
    show: ProjectFolder, monkeypatch: pytest.MonkeyPatch, checked: list[str]
) -> None:
    check, text = shot_checks.check_shot, show.shot.read_text()

    def saved_meanwhile(*given: Any) -> Any:
        shot = check(*given)
        show.shot.write_text(text.replace("0.5", "0.3"))
        return shot

    with monkeypatch.context() as patch:
        patch.setattr(shot_checks, "check_shot", saved_meanwhile)
        before = show.call("validate", "T010_tiny")
    assert show.call("validate", "T010_tiny").out != before.out and len(checked) == 2


@pytest.mark.parametrize("damage", [b"", b"\xff\xfe", b"{}", b'0\n{"data": 1}'])
def test_a_damaged_verdict_counts_as_none(show: ProjectFolder, checked: list[str], damage: bytes) -> None:
    first = show.call("validate", "T010_tiny")
    (kept,) = (show.path / ".flowsculpt/planning").glob("*.json")
    kept.write_bytes(damage)
    assert show.call("validate", "T010_tiny") == first and len(checked) == 2
    assert show.call("validate", "T010_tiny") == first and len(checked) == 2


def test_nothing_is_kept_of_a_shot_that_reads_more_than_it_names(
    show: ProjectFolder, checked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = show.path / "fonts"
    elsewhere.mkdir()
    (elsewhere / "Fine-Bold.ttf").write_text("a font that the system found")
    check = shot_checks.check_shot

    def reading_a_font(verdict: Any, *given: Any) -> Any:
        from dataclasses import replace

        return replace(check(verdict, *given), files=((elsewhere / "Fine-Bold.ttf", "0"),))

    monkeypatch.setattr(shot_checks, "check_shot", reading_a_font)
    for _ in range(2):
        show.call("validate", "T010_tiny")
    assert len(checked) == 2


def test_an_edit_is_read_again_after_its_shots_alone(
    show: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flowsculpt.pipeline.shot import film_reader

    read, films = film_reader.read_film, list[Path]()
    monkeypatch.setattr(
        "flowsculpt.pipeline.shot.read_film", lambda path, *given: films.append(path) or read(path, *given)
    )
    first = show.call("validate", "film")
    assert show.call("validate", "film") == first and first.code == 0 and len(films) == 1
    replaced("shots/T010_tiny.yaml", "1-6", "1-5")(show.path, None)
    show.call("validate", "film")
    replaced("shots/film.yaml", "[T010_tiny]", "[{shot: T010_tiny, frames: 4-6}]")(show.path, None)
    wrong = show.call("validate", "film")
    assert len(films) == 3 and wrong.code == 2 and "frames 6 are not in T010_tiny" in wrong.err


def test_the_light_of_finished_frames_is_looked_at_again_once_they_change(
    finished: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flowsculpt.pipeline.production.picture_sequences import FinishedPictures

    looked = list[list[int]]()

    def noted(pictures: Any) -> list[str]:
        looked.append([*pictures])
        return ["no highlight"]

    monkeypatch.setattr(FinishedPictures, "light_notes", staticmethod(noted))
    first = finished.call("validate", "T010_tiny")
    assert "no highlight" in first.err and finished.call("validate", "T010_tiny") == first
    assert looked == [[1, 2, 3, 4, 5, 6]]
    finished.frames()[2].unlink()
    finished.call("validate", "T010_tiny")
    assert looked[1:] == [[1, 2, 4, 5, 6]]
