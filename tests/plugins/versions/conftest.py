"""Fixtures of versions: a published shot, and copies of it to work on."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import MissingInputError
from tests.plugins.versions.desk import MODEL, NAME, RENDER, SHOT, Desk


@pytest.fixture(scope="session")
def published(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """A shot rendered and published as v001; tests work on copies of it."""
    root = tmp_path_factory.mktemp("published")
    for file, text in ((f"shots/{NAME}.yaml", SHOT), ("models/wedge.obj", MODEL)):
        (root / file).parent.mkdir()
        (root / file).write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        desk = Desk(root)
        with pytest.raises(MissingInputError) as refused:
            desk.release().publish()
        assert f"frames 1-4 missing. Publishing needs frames of the current shot file; {RENDER}" in str(
            refused.value
        )
        desk.render()
        first = desk.release("first look").publish()
        assert (first.version, first.before) == ("v001", False)
    yield desk


@pytest.fixture
def desk(published: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Desk:
    root = tmp_path / "studio"
    shutil.copytree(published.root, root, copy_function=os.link)
    for file in (root / "shots").iterdir():  # these are edited in place
        text = file.read_text()
        file.unlink()
        file.write_text(text)
    monkeypatch.chdir(root)
    return Desk(root)
