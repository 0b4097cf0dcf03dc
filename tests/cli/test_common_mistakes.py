"""Mistakes that people make on the command line, each with the whole sentence it gives; what is right works.

The table is `mistakes.yaml`. Commands run in this process and with --dry-run, so nothing is made.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from pipeline.errors import UsageError
from pipeline.mesh.mesh_formats import mesh_suffixes
from pipeline.production.request.shot_lookup import OTHER_MODELS, find_shot
from tests.conftest import FILM, TINY, commanded

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


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["write"])
def test_a_mistake_on_the_command_line_is_told_with_its_remedy_which_works(
    folder: Path, monkeypatch: pytest.MonkeyPatch, row: dict[str, Any]
) -> None:
    monkeypatch.chdir(folder)
    assert told(folder, row["write"]) == (row["code"], row["says"])
    if "right" in row:
        code, text = told(folder, row["right"])
        assert code == 0, text


def test_a_model_of_every_format_is_told_from_a_shot() -> None:
    for suffix in mesh_suffixes():
        assert f".{suffix}" not in OTHER_MODELS
        with pytest.raises(UsageError, match="is a model, not a shot"):
            find_shot(f"heron.{suffix}")
