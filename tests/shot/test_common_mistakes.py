"""Mistakes that people make in shots, edits and settings, each with the whole sentence it gives.

The tables stand in `mistakes/`. An entry replaces the one of the same name in the file below, or the one that
`instead_of` names, and is added at the end if there is none. What is right, by the sentence, reads.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from pipeline.errors import FlowsculptError
from pipeline.shot import read_film, read_shot

SHOT = """\
title: Cube
frames: 1-48
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.25}
flows:
  - twist: {axis: y, amount: {keys: {1: 0, 40: 80}}}
look: clay
camera: {azimuth: 20, elevation: 16}
"""

EDIT = "title: Film\nshots: [A010, A020]\n"

FILES = {
    "model.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    "models/other.obj": "",
    "notes.txt": "notes\n",
    "flow.py": "def flow(points, time):\n    return points\n",
    "base.yaml": "look: clay\n",
}
"""Files beside the shots, by their names."""


def table(name: str) -> list[Any]:
    """Return the rows of a table, named by what is written."""
    rows = YAML(typ="safe").load((Path(__file__).parent / "mistakes" / name).read_text(encoding="utf-8"))
    return [pytest.param(row, id=row["write"][:40]) for row in rows]


def with_entry(text: str, entry: str, instead_of: str | None) -> str:
    """Return a file with an entry in place of the one of its name, or at the end."""
    names = set(re.findall(r"^\w+", entry, flags=re.MULTILINE))
    own = instead_of or re.match(r"\w+", entry)[0]  # type: ignore[index]
    before = re.split(r"^(?=\w)", text, flags=re.MULTILINE)[1:]
    parts = {re.match(r"\w+", part)[0]: part for part in before}  # type: ignore[index]
    kept = {name: part for name, part in parts.items() if name == own or name not in names}
    return "".join((kept | {own: f"{entry}\n"}).values())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with files that shots name, and shots that an edit names."""
    folder = tmp_path_factory.mktemp("mistakes")
    shots = {"A010": SHOT, "A020": SHOT, "A025": f"{SHOT}rate: 25\n", "broken": SHOT.replace("clay", "wood")}
    for name, text in {**FILES, **{f"{name}.yaml": text for name, text in shots.items()}}.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def sentences(error: FlowsculptError, folder: Path, before: str) -> list[str]:
    """Return the lines of an error without the folder and without what all begin with."""
    return [line.removeprefix(before) for line in str(error).replace(f"{folder}/", "").split("\n")]


def said(says: str | list[str]) -> list[str]:
    return [says] if isinstance(says, str) else says


@pytest.mark.parametrize("row", table("shots.yaml"))
def test_a_mistake_in_a_shot_is_told_with_its_remedy_which_works(folder: Path, row: dict[str, Any]) -> None:
    def told(entry: str) -> list[str]:
        try:
            read_shot(folder / "a.yaml", with_entry(SHOT, entry, row.get("instead_of")))
        except FlowsculptError as error:
            return sentences(error, folder, "a.yaml:")
        return []

    assert told(row["write"]) == said(row["says"])
    assert "right" not in row or told(row["right"]) == []


@pytest.mark.parametrize("row", table("edits.yaml"))
def test_a_mistake_in_an_edit_is_told_with_its_remedy_which_works(folder: Path, row: dict[str, Any]) -> None:
    def told(entry: str) -> list[str]:
        try:
            read_film(folder / "film.yaml", text=with_entry(EDIT, entry, row.get("instead_of")))
        except FlowsculptError as error:
            return sentences(error, folder, "film.yaml:")
        return []

    assert told(row["write"]) == said(row["says"])
    assert "right" not in row or told(row["right"]) == []


@pytest.mark.parametrize("row", table("settings.yaml"))
def test_a_mistake_in_a_setting_is_told_with_its_remedy_which_works(
    folder: Path, row: dict[str, Any]
) -> None:
    def told(setting: str) -> list[str]:
        try:
            read_shot(folder / "a.yaml", SHOT, settings=(setting,))
        except FlowsculptError as error:
            return sentences(error, folder, f"--set {setting}: ")
        return []

    assert told(row["write"]) == said(row["says"])
    assert "right" not in row or told(row["right"]) == []
