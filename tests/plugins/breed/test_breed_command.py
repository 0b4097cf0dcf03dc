"""The command: a folder of children, the next generation, interruption, and one line for each mistake."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flowsculpt.pipeline.plugins.breed import generation
from flowsculpt.pipeline.plugins.breed.family_tree import rows_of
from flowsculpt.pipeline.plugins.breed.selection import STILL, Candidate, chosen, judged
from flowsculpt.pipeline.plugins.breed.trials import SHOWN, Trial, tried
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.post.image import read_png
from tests.conftest import commanded

NAME, FEW = "T010_tiny", ("--candidates", "4")
SHOT = """\
title: A box, twisted
frames: 1-8
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.5}
flows:
  - twist: {axis: y, amount: {keys: {1: 0, 8: 90}}}
  - sum:
      - vortex: {axis: z, strength: {keys: {1: 0, 3: 9, 6: 9, 8: 0}}}
"""


def show(root: Path) -> Path:
    (root / "shots").mkdir()
    (root / "shots" / f"{NAME}.yaml").write_text(SHOT)
    (root / "shots" / "film.yaml").write_text(f"title: A film\nshots: [{NAME}]\n")
    return root


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return show(tmp_path)


@pytest.fixture(scope="module")
def family(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A show with a first generation, and what the command told of it; tests add to it at most."""
    root = show(tmp_path_factory.mktemp("family"))
    with chdir(root):
        return root, bred(root, NAME)


def bred(root: Path, *words: str) -> dict[str, Any]:
    code, said = commanded(root, "--json", "breed", *words, *FEW)
    assert code == 0, said
    found: dict[str, Any] = json.loads(said[said.index("{\n") :])  # warnings may stand above
    return found


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_children_are_shots_with_a_sheet_a_page_and_a_record(family: tuple[Path, dict[str, Any]]) -> None:
    root, facts = family
    folder = root / "bred" / f"{NAME}_1"
    children = sorted(folder.glob("*.yaml"))
    assert facts["children"] == [str(path) for path in children] and children
    assert all(read_shot(path).intent.startswith(NAME) for path in children)
    assert read_png(folder / "sheet.png").ndim == 3
    page = (folder / "index.html").read_text()
    assert not [part for part in ("title", "style", "script", "facts") if f"[[{part}]]" in page]
    assert "http" not in re.sub("http-equiv|http://www.w3.org/2000/svg", "", page), "it asks for nothing"
    assert json.loads((folder / "generation.json").read_text())["generation"] == 1
    assert not [*(root / ".flowsculpt" / "breeding").glob("*")]


def test_the_same_seed_gives_the_same_bytes_in_one_process_and_in_two(root: Path) -> None:
    bred(root, NAME, "-j", "1", "-o", "one/same")
    bred(root, NAME, "-j", "2", "-o", "two/same")
    one, two = files(root / "one" / "same"), files(root / "two" / "same")
    pages = [
        each.pop("index.html").replace(folder, b"")
        for each, folder in ((one, b"one/same"), (two, b"two/same"))
    ]
    assert one == two and pages[0] == pages[1]


def test_the_choice_of_a_page_makes_the_next_generation_and_its_family_tree(
    family: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    root, first = family
    monkeypatch.chdir(root)
    parents = "1,2" if len(first["children"]) > 1 else "1"
    choice = root / "choice.txt"
    choice.write_text(f"bred/{NAME}_1 parents={parents} favourites=1 change=0.4 seed=3 name=calm\n")
    second = bred(root, "--from-page", str(choice))
    folder = root / "bred" / "calm"
    assert second["folder"] == str(folder)
    ancestry = read_shot(next(folder.glob("*.yaml"))).entries["breed.ancestry"]
    assert (ancestry.generation, ancestry.seed, ancestry.ancestors) == (2, 3, [NAME])
    rows = rows_of(folder, folder)
    assert [len(row.pictures) for row in rows] == [1, len(first["children"]), len(second["children"])]
    assert rows[2].favourites == (f"{NAME}_1_01",)


def test_an_interrupted_run_leaves_no_folder_and_the_next_one_goes_on(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = 0

    def interrupted(shot: object) -> object:
        nonlocal count
        count += 1
        if count == 3:
            raise KeyboardInterrupt
        return tried(shot)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(generation, "tried", interrupted)
        assert commanded(root, "breed", NAME, "-j", "1", *FEW)[0] == 130
    assert not [*(root / "bred").iterdir()]
    again: list[object] = []
    monkeypatch.setattr(generation, "tried", lambda shot: again.append(shot) or tried(shot))
    bred(root, NAME, "-j", "1")
    assert len(again) == 3  # two candidates, and the parent


def test_trials_that_were_cut_short_or_hold_something_else_are_made_again(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(generation, "CHILDREN", 0)  # nothing can be chosen, and the trials stay
        commanded(root, "breed", NAME, "-j", "1", *FEW)
    files = sorted((root / generation.TRIALS).glob("*/*.npz"))
    whole = [file.read_bytes() for file in files]
    files[0].write_bytes(whole[0][:-10])
    files[1].write_bytes(b"[]")
    files[2].write_bytes(b"")
    np.savez(files[3], explodes=np.array(True), pictures=np.zeros(3))
    again: list[object] = []
    monkeypatch.setattr(generation, "tried", lambda shot: again.append(shot) or tried(shot))
    bred(root, NAME, "-j", "1")
    assert len(again) == 4


def mistakes() -> Iterator[tuple[list[str], str]]:
    yield [], "breed needs a shot"
    yield ["film"], "film is an edit; breed takes shots"
    yield [NAME, "film"], "film is an edit; breed takes shots"
    yield ["T999_none"], "T999_none"
    yield [NAME, "--change", "1.5"], "--change 1.5 is out of range"
    yield [NAME, "--change", "nan"], "--change nan is out of range"
    yield [NAME, "-o", "shots"], "shots is there already"
    yield [NAME, "-o", "a folder"], "cannot name a shot"
    yield ["broken"], "shots/broken.yaml:1:8"
    yield ["--from-page", "bred/none parents=1"], "bred/none is not a generation"
    yield ["--from-page", "nonsense words"], "not a choice of a page"
    yield [NAME, "--from-page", "x"], "names the parents itself"


@pytest.mark.parametrize(("words", "fact"), [*mistakes()])
def test_a_mistake_is_one_line_and_writes_nothing(root: Path, words: list[str], fact: str) -> None:
    (root / "shots" / "broken.yaml").write_text("title: [1\n")
    code, said = commanded(root, "breed", *words)
    assert code in (2, 3) and fact in said and "\n" not in said.strip(), said
    assert not (root / "bred").exists()


def test_a_dry_run_writes_nothing(root: Path) -> None:
    code, said = commanded(root, "--dry-run", "breed", NAME)
    assert code == 0 and "12 of 40 candidates would be written" in said
    assert not (root / "bred").exists()


def test_a_shot_that_does_not_move_leaves_no_candidate(root: Path) -> None:
    (root / "shots" / "still.yaml").write_text(SHOT.replace("90", "0.01").replace("9,", "0.001,"))
    code, said = commanded(root, "breed", "still", "--change", "0", "--candidates", "2")
    assert code == 2 and "no candidate is left of 2" in said
    assert not [*(root / "bred").iterdir()]


def test_those_that_differ_most_are_chosen_and_faults_and_twins_are_not() -> None:
    places = {1: 0.0, 2: 0.05, 3: 1.0, 4: 2.0, 5: 9.0}
    candidates = {n: Candidate(np.array([x]), 1.0, "explodes" if n == 5 else "") for n, x in places.items()}
    assert chosen(candidates, np.array([-1.0]), 12) == ([4, 2, 3], [1])
    assert chosen(candidates, np.array([-1.0]), 2) == ([4, 2], [1])
    faint = {
        n: Candidate(each.features, 0.01 if n == 3 else 1.0, each.fault) for n, each in candidates.items()
    }
    assert chosen(faint, np.array([-1.0]), 12) == ([4, 2, 3], [1])


@pytest.mark.parametrize(("moved", "brightness", "fault"), [(0, 30, STILL), (2, 30, ""), (0, 200, "")])
def test_changes_of_shades_alone_that_the_camera_makes_are_no_movement(
    moved: int, brightness: int, fault: str
) -> None:
    shapes, pictures = np.zeros((SHOWN, 18, 32), np.float32), np.full((SHOWN, 72, 128, 3), 20, np.uint8)
    for k in range(SHOWN):
        shapes[k, 5:13, 10 + moved * k // SHOWN : 22 + moved * k // SHOWN] = 1.0
        pictures[k][shapes[k].repeat(4, 0).repeat(4, 1) > 0] = 50 + brightness * k // (SHOWN - 1)
    change, covered = np.linspace(0.0, 0.5, SHOWN), np.full(SHOWN, 96 / 576)
    trial = Trial(pictures, shapes, 1.2, 1.0, covered, change)
    assert judged(trial, [trial]).fault == fault
