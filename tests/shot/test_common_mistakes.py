"""Mistakes that people make in shots, edits and settings: the messages name what is right, and that reads.

The tables stand in `mistakes/`. An entry replaces the one of the same name in the file below, or the one that
`instead_of` names, and is added at the end if there is none. A core of the cases has the whole message.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.shot import read_film, read_shot
from tests.mistakes import is_named
from tests.needed_plugins import needed_in, needs_plugins

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


TABLES = {
    name: YAML(typ="safe").load((Path(__file__).parent / "mistakes" / f"{name}.yaml").read_text("utf-8"))
    for name in ("shots", "edits", "settings")
}
CASES = [
    pytest.param(
        name,
        row,
        id=f"{name}: {row['write'][:40]}",
        marks=needs_plugins(*needed_in(" ".join(map(str, row.values())))),
    )
    for name, rows in TABLES.items()
    for row in rows
]


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


def messages(folder: Path, table: str, written: str, instead_of: str | None = None) -> list[str]:
    """Return the messages about a file with an entry or a setting, without the folder; none if it reads."""
    try:
        match table:
            case "shots":
                read_shot(folder / "a.yaml", with_entry(SHOT, written, instead_of))
            case "edits":
                read_film(folder / "film.yaml", text=with_entry(EDIT, written, instead_of))
            case _:
                read_shot(folder / "a.yaml", SHOT, settings=(written,))
    except FlowsculptError as error:
        before = {"shots": "a.yaml:", "edits": "film.yaml:"}.get(table, f"--set {written}: ")
        return [line.removeprefix(before) for line in str(error).replace(f"{folder}/", "").split("\n")]
    return []


@pytest.mark.parametrize(("table", "row"), CASES)
def test_a_mistake_is_reported_and_what_is_right_reads(folder: Path, table: str, row: dict[str, Any]) -> None:
    found = messages(folder, table, row["write"], row.get("instead_of"))
    if "says" in row:
        assert found == ([row["says"]] if isinstance(row["says"], str) else row["says"])
    else:
        assert found
    assert "right" not in row or messages(folder, table, row["right"], row.get("instead_of")) == []


@pytest.mark.slow
def test_the_messages_name_what_is_right_in_nine_of_ten_cases(folder: Path) -> None:
    wrong = [
        (row, "\n".join(messages(folder, table, row["write"], row.get("instead_of"))))
        for table, rows in TABLES.items()
        for row in rows
        if row.get("says") != []
    ]
    missed = [(row["write"], message) for row, message in wrong if not is_named(row, message)]
    assert len(wrong) > 500
    assert len(missed) <= 0.1 * len(wrong), missed
