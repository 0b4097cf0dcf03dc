"""A show may bring along links: no command changes anything where they lead."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

import pytest

from flowsculpt.pipeline.production.store.history import HISTORY
from flowsculpt.pipeline.production.store.locks import LOCKS, ROOT
from flowsculpt.pipeline.production.store.paths import (
    CHECKPOINTS,
    DIGESTS,
    DONE,
    EVENTS,
    LOGS,
    PLANS,
    STATE,
    STORE,
)
from flowsculpt.pipeline.production.store.store import UPLOADS
from flowsculpt.render.base.root_files import OWNED
from tests.conftest import QUALITY, ProjectFolder
from tests.needed_plugins import installed
from tests.render.test_root_files import contents

NAME = "T010_tiny"

STATES = [
    STATE,
    PLANS,
    EVENTS,
    LOGS,
    DONE,
    DIGESTS,
    CHECKPOINTS,
    STATE / "breeding",
    HISTORY,
    LOCKS,
    UPLOADS,
    ROOT,
    STORE,
]
STATES += [
    STATE / "tmp",
    STATE / "planning",
    *(Path(name) for name in OWNED[1:]),
    Path(".snakemake/metadata"),
]

OUTPUTS = {
    f"renders/{NAME}": f"curves {NAME}",
    f"renders/{NAME}/{QUALITY}": f"sheet {NAME} -q {QUALITY}",
    f"renders/{NAME}/{QUALITY}/deliver": f"deliver {NAME} -q {QUALITY}",
    f"renders/{NAME}/models": f"export obj {NAME}",
    f"renders/{NAME}/preview": f"preview {NAME} -f 1",
    f"renders/{NAME}/usd": f"export usd {NAME}",
    f"renders/{NAME}/vat": f"export vat {NAME}",
    f"renders/{NAME}/web": f"export web {NAME}",
    "renders/published": f"publish {NAME} -q {QUALITY}",
    f"renders/published/{NAME}": f"publish {NAME} -q {QUALITY}",
    "renders/review": f"review {NAME} -q {QUALITY}",
    "renders/film/preview": "preview film",
    "bred": f"breed {NAME} --candidates 1",
}
"""Commands by the folders that they write to."""


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A folder of the user's, old enough for everything that removes old files."""
    folder = tmp_path / "home"
    for number in range(25):
        for name in (
            f"20{number}.txt",
            f"20{number}/a.jpg",
            f".breeding-{number}/a.yaml",
            f"{number:04}.png",
        ):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text("mine")
    for path in folder.rglob("*"):
        os.utime(path, (time.time() - 30 * 86400,) * 2)
    return folder


def link(place: Path, home: Path) -> None:
    """Put a link in the place of a folder or file."""
    shutil.rmtree(place, ignore_errors=True)
    place.unlink(missing_ok=True)
    place.parent.mkdir(parents=True, exist_ok=True)
    place.symlink_to(home)


def test_no_command_changes_what_a_folder_of_state_links_to(project: ProjectFolder, home: Path) -> None:
    before = contents(home)
    for place in STATES:
        link(project.path / place, home)
        breed = ["breed", NAME, "--candidates", "1"]
        for words in installed(["simulate", NAME], ["clean"], ["publish", NAME], breed):
            done = project.call(*words)
            said = done.out + done.err
            assert done.code and (f"{place} is a link to {home}" in said or words[0] == "publish"), said
        assert contents(home) == before
        (project.path / place).unlink()


@pytest.mark.parametrize("place", [place for place, words in OUTPUTS.items() if installed(words.split())])
def test_no_command_writes_where_its_folder_links_to(finished: ProjectFolder, home: Path, place: str) -> None:
    (finished.path / place).parent.mkdir(parents=True, exist_ok=True)
    if place in (f"renders/{NAME}", f"renders/{NAME}/{QUALITY}"):  # frames are read from there
        shutil.copytree(finished.path / place, home, dirs_exist_ok=True)
    before = contents(home)
    link(finished.path / place, home)
    done = finished.call(*OUTPUTS[place].split())
    assert done.code == 4 and f"{place} is a link to" in done.err, done.out + done.err
    assert contents(home) == before
