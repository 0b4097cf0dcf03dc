"""Names in generations and choices of somebody else lead nowhere but into bred/."""

from __future__ import annotations

import json
import shutil

import pytest

from tests.conftest import ProjectFolder

RECORD = {
    "name": "g",
    "generation": 1,
    "seed": 0,
    "change": 0.3,
    "parents": [],
    "children": [{"name": "g_01"}],
}

NAMES = ["../../x", "..", "/tmp/x", "a/b", "a\\b", "a\0b", ".x", "a" * 300, "published", "a\nb", 7, None]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("place", ["generation", "child", "choice"])
def test_a_name_that_leads_elsewhere_is_refused(project: ProjectFolder, name: object, place: str) -> None:
    folder = project.path / "bred/g"
    folder.mkdir(parents=True)
    shutil.copy(project.shot, folder / "g_01.yaml")
    changed = {"generation": {"name": name}, "child": {"children": [{"name": name}]}, "choice": {}}[place]
    (folder / "generation.json").write_text(json.dumps(RECORD | changed))
    choice = f"bred/g parents=1 name='{name}'" if place == "choice" else "bred/g parents=1"
    if place == "choice" and (not isinstance(name, str) or "\0" in name):
        pytest.skip("a command line has no such words")
    beside = set(project.path.parent.iterdir())
    told = project.call("breed", "--from-page", choice, "--dry-run")
    assert told.code == 2 and len(told.err.strip().splitlines()) == 1, told.out + told.err
    assert set(project.path.parent.iterdir()) == beside, "nothing is written"
