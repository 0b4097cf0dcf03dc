"""Commands of tests are forked, and behave as new processes of Python would."""

from __future__ import annotations

import os
import signal
import subprocess
import warnings
from contextlib import suppress
from pathlib import Path

import pytest

import flowsculpt.pipeline.production.execution.project  # noqa: F401  # sets variables of the environment
from flowsculpt.render.base.limited_process import Parser, ParserError
from flowsculpt.render.base.python_process import ForkedProcess, environment, python_command
from tests.command_server import COMMANDS, LIBRARIES
from tests.conftest import ProjectFolder
from tests.test_plugin import GREETER, Environment

pytestmark = pytest.mark.skipif(
    not COMMANDS.is_on or "PYTHONPATH" in os.environ, reason="commands are not forked"
)


def test_a_command_is_forked_unless_its_environment_may_change_what_is_loaded(
    project: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = COMMANDS.forks
    assert project.run("--version").code == 0 and COMMANDS.forks == before + 1
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    assert project.run("--version").code == 0 and COMMANDS.forks == before + 1


def test_a_command_with_other_plug_ins_is_forked_and_finds_them(
    tmp_path: Path, forks_with_plugins: None
) -> None:
    environment, before = Environment(tmp_path), LIBRARIES.forks
    environment.install("greeter", GREETER)
    assert environment.run("greet", "A010").stdout == "Hello A010\n"
    second = GREETER.replace("greet", "wav").replace("txt", "text").replace("hail", "flag")
    environment.install("waver", second)
    assert environment.run("wav", "A010").stdout == "Hello A010\n"
    assert LIBRARIES.forks == before + 2 and not list(tmp_path.rglob("*.pyc"))


def test_processes_that_read_files_are_forked(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"nothing")
    before = COMMANDS.forks
    with suppress(ParserError):
        Parser("flowsculpt.render.scene.textures").answer(tmp_path / "a.png")
    assert COMMANDS.forks == before + 1


def test_a_killed_command_has_ended_by_that_signal() -> None:
    before = COMMANDS.forks
    process = subprocess.Popen(
        python_command("flowsculpt.render.scene.textures"),
        stdin=subprocess.PIPE,
        env=environment(),
        process_group=0,
    )
    with process:
        assert os.getpgid(process.pid) == process.pid
        process.kill()
    assert (process.returncode, COMMANDS.forks) == (-signal.SIGKILL, before + 1)


def test_a_fork_of_the_process_of_tests_forks_no_commands() -> None:
    before = COMMANDS.forks

    def start() -> int:
        done = subprocess.run(python_command("flowsculpt", "--version"), stdout=subprocess.DEVNULL)
        return done.returncode or COMMANDS.forks - before

    with warnings.catch_warnings(action="ignore", category=DeprecationWarning):  # of forks with threads
        assert ForkedProcess(start).wait() == 0
