"""Commands and readers of tests are forked: started as users start them, they take most of all its time."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

import pytest

import flowsculpt.pipeline.production.execution.project  # noqa: F401  # sets variables of the environment
from flowsculpt.render.base.limited_process import Parser, ParserError
from tests.conftest import COMMANDS, ProjectFolder

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux forks soundly")


def test_a_command_is_forked_unless_its_environment_may_change_what_is_loaded(
    project: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = COMMANDS.forks
    assert project.run("--version").code == 0 and COMMANDS.forks == before + 1
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    assert project.run("--version").code == 0 and COMMANDS.forks == before + 1


def test_a_reader_is_forked_from_its_second_time_on(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"nothing")
    for _ in range(2):
        before = COMMANDS.forks
        with suppress(ParserError):
            Parser("flowsculpt.render.scene.textures").answer(tmp_path / "a.png")
    assert COMMANDS.forks == before + 1
