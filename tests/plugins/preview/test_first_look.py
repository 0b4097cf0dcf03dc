"""What somebody at a terminal sees while something is rendered for the first time."""

from __future__ import annotations

import os
import pty
import re
import select
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from flowsculpt.pipeline.cli.options import CommonOptions
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.plugins.preview.first_look import arguments_for
from flowsculpt.pipeline.plugins.preview.first_pictures import WITHOUT
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.render.base import python_process
from flowsculpt.render.movie.probe import probe_movie
from tests.conftest import AT_LINK, QUALITY, TINY, ProjectFolder
from tests.processes import has_ended, wait_until

NAME = "T010_tiny"


class Terminal:
    """A command at a pseudo-terminal.

    search_path  folders in which its processes find modules
    """

    def __init__(self, folder: Path, *words: str, search_path: str) -> None:
        command = python_process.python_command("flowsculpt", "-j", "1", *words)
        environment = {**python_process.environment(), "TERM": "xterm", "COLUMNS": "160", "CI": ""}
        environment["PYTHONPATH"] = search_path
        self.process, self._terminal = pty.fork()
        if self.process == 0:
            os.chdir(folder)
            os.execvpe(command[0], command, environment)
        self.text = ""

    def read_until(self, pattern: str, seconds: float = 300.0) -> None:
        """Read until a pattern is on the screen, or the command has ended."""
        limit = time.monotonic() + seconds
        while not re.search(pattern, self.text) and self._reads():
            assert time.monotonic() < limit, self.text

    def _reads(self) -> bool:
        """Read what has been written, so that the command does not wait; False once it has ended."""
        if select.select([self._terminal], [], [], 0.1)[0]:
            try:
                self.text += os.read(self._terminal, 65536).decode(errors="replace")
            except OSError:
                return False
        return True

    def processes_that_draw(self) -> list[psutil.Process]:
        """Return the processes that draw the first pictures, once they do."""
        found: list[psutil.Process] = []
        wait_until(lambda: found.extend(drawing_processes(self.process)) or found or not self._reads())
        return found

    def press_ctrl_c(self) -> None:
        os.write(self._terminal, b"\x03")

    def end(self) -> int:
        """Return the exit code once the command has ended."""
        self.read_until(r"\Z.")
        _, status = os.waitpid(self.process, 0)
        os.close(self._terminal)
        return os.waitstatus_to_exitcode(status)


def longer(project: ProjectFolder) -> ProjectFolder:
    """Return the project with a shot of as many frames as an animatic has at the least."""
    project.shot.write_text(TINY.replace("frames: 1-6", "frames: 1-24"))
    return project


def drawing_processes(command: int) -> list[psutil.Process]:
    """Return the processes that draw the first pictures for a command."""
    found = []
    for child in psutil.Process(command).children():
        with suppress(psutil.Error):  # it has ended already
            if "first_pictures" in str(child.cmdline()):
                found.append(child)
    return found


def test_an_animatic_comes_first_and_is_whole_when_the_run_is_interrupted(project: ProjectFolder) -> None:
    hooks = project.path / "hooks"
    hooks.mkdir()
    waiting = AT_LINK.format(name=f"raw/{NAME}.0001.exr", done=str(hooks / "done"), do="signal.pause()")
    (hooks / "sitecustomize.py").write_text(waiting)  # so that nothing more is rendered meanwhile
    words = ("render", NAME, "-q", QUALITY)
    terminal = Terminal(longer(project).path, *words, search_path=str(hooks))
    drawing = terminal.processes_that_draw()
    terminal.read_until(r"Animatic: \S+\.mp4 \(24 frames")
    terminal.press_ctrl_c()
    assert terminal.end() == 130, terminal.text
    assert "in all" in terminal.text and "Traceback" not in terminal.text
    assert drawing and all(map(has_ended, drawing))
    assert probe_movie(project.path / "renders" / NAME / "preview" / f"{NAME}.mp4").frames == 24
    assert not list((project.path / "renders" / NAME / QUALITY).glob("frames/*.0024.exr"))


@contextmanager
def at_terminal(monkeypatch: pytest.MonkeyPatch, ci: str = "") -> Iterator[None]:
    """Have standard output and standard error be a pseudo-terminal."""
    ours, theirs = pty.openpty()
    with open(theirs, "w") as stream:  # noqa: PTH123 (a descriptor has no path)
        monkeypatch.setattr(sys, "stdout", stream)
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setenv("CI", ci)
        yield
    os.close(ours)


def planned(project: ProjectFolder, monkeypatch: pytest.MonkeyPatch, frames: str | None = None) -> Plan:
    monkeypatch.chdir(project.path)
    asked = None if frames is None else FrameRange.parse(frames)
    return Project(project.path, 2, variant="scalar_rgb").pictures([NAME], "draft", asked)


def words(
    project: ProjectFolder, plan: Plan, animatic: bool = True, ci: str = "", **options: object
) -> list[str] | None:
    """Return what the process that makes the pictures is called with, for somebody at a terminal."""
    common = CommonOptions(root=project.path, **options).resolved(CommonOptions())  # type: ignore[arg-type]
    with pytest.MonkeyPatch.context() as patch, at_terminal(patch, ci):
        return arguments_for(common, plan, animatic)


def test_a_person_at_a_terminal_gets_an_animatic_of_what_was_never_rendered(
    project: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = planned(longer(project), monkeypatch)
    assert words(project, plan) == [str(plan.file)]
    assert words(project, plan, animatic=False) == [str(plan.file), WITHOUT]


def test_few_frames_have_no_animatic_and_one_is_not_announced(
    project: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = planned(project, monkeypatch)
    assert words(project, plan) == [str(plan.file), WITHOUT]
    assert words(project, planned(project, monkeypatch, "3")) is None


@pytest.mark.parametrize("kind", ["raw", "frames"])
def test_where_a_frame_is_there_nothing_is_shown_first(
    project: ProjectFolder, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    plan = planned(longer(project), monkeypatch)
    folder = project.path / "renders" / NAME / "draft" / kind
    folder.mkdir(parents=True)
    assert words(project, plan) is not None
    (folder / f"{NAME}.0003.exr").touch()
    assert words(project, plan) is None


def test_scripts_farms_and_machines_of_ci_get_none(
    project: ProjectFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = planned(longer(project), monkeypatch)
    assert words(project, plan, no_progress=True) is None
    assert words(project, plan, json_=True) is None
    farm = project.path / "farm"
    farm.mkdir()
    (farm / "profile.yaml").write_text("executor: dryrun\n")
    assert words(project, plan, profile=str(farm)) is None
    assert words(project, plan, ci="true") is None


def test_output_to_a_file_gets_none(project: ProjectFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = planned(longer(project), monkeypatch)
    common = CommonOptions(root=project.path).resolved(CommonOptions())
    with at_terminal(monkeypatch), Path(os.devnull).open("w") as nowhere:
        assert arguments_for(common, plan) is not None
        monkeypatch.setattr(sys, "stdout", nowhere)
        assert arguments_for(common, plan) is None
