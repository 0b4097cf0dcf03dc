"""Mistakes that people make on the command line: the messages name what is right, and that works.

The table is `mistakes.yaml`; a core of its cases has the whole message. Commands run in this process and with
--dry-run, so nothing is made.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.mesh.read import mesh_suffixes
from flowsculpt.pipeline.production.request.lookup import OTHER_MODELS, Show
from tests.conftest import FILM, TINY, commanded
from tests.mistakes import is_named
from tests.needed_plugins import SHIPPED, installed, needed_in, needs_plugins

ROWS = YAML(typ="safe").load((Path(__file__).parent / "mistakes.yaml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one shot and one edit."""
    folder = tmp_path_factory.mktemp("mistakes")
    (folder / "shots").mkdir()
    (folder / "shots" / "T010_tiny.yaml").write_text(TINY)
    (folder / "shots" / "film.yaml").write_text(FILM)
    return folder


def told(folder: Path, words: str) -> tuple[int, str]:
    """Return the exit code of a command and its words in one line, without frames and folders."""
    code, text = commanded(folder, "--dry-run", *shlex.split(words))
    text = " ".join(re.sub(r"[╭╮╰╯│─]+", "", text).split())
    return code, text.replace(f"{folder.resolve()}/", "").replace(f"{folder}/", "")


@needs_plugins(*SHIPPED)
def test_the_messages_name_what_is_right_in_nine_of_ten_cases(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    missed = []
    for row in ROWS:
        code, message = told(folder, row["write"])
        assert code == row["code"], row["write"]
        assert row.get("says", message) == message
        if not is_named(row, message):
            missed.append((row["write"], message))
    assert len(missed) <= 0.1 * len(ROWS), missed


@pytest.mark.parametrize(
    "words",
    [
        pytest.param(words, marks=needs_plugins(*needed_in(words)))
        for words in (row["right"] for row in ROWS if installed(shlex.split(row.get("right", "none"))))
    ],
)
def test_what_is_right_works(folder: Path, monkeypatch: pytest.MonkeyPatch, words: str) -> None:
    monkeypatch.chdir(folder)
    code, text = told(folder, words)
    assert code == 0, text


def test_a_model_of_every_format_is_told_from_a_shot() -> None:
    for suffix in mesh_suffixes():
        assert suffix not in OTHER_MODELS
        with pytest.raises(UsageError, match="is a model, not a shot"):
            Show().find_shot(f"heron.{suffix}")
