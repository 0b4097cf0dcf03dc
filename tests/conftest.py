"""Shared fixtures: a project with a tiny shot, and the real command."""

from __future__ import annotations

import atexit
import gc
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING
from unittest import mock

import psutil
import pytest
from hypothesis import HealthCheck, settings

from flowsculpt.render.base import python_process
from tests.command_server import AT_START, COMMANDS, LIBRARIES
from tests.needed_plugins import watch_imports
from tests.processes import wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from flowsculpt.pipeline.production.planning.plan import Plan

# Containers often tell Python to write no bytecode. Then each of a thousand commands compiles flowsculpt
# again, and each run compiles all tests.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Shells start what runs in the background (`make test &`) deaf to interrupts, and all that it starts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# No example fails for the time that it takes: a busy machine stalls any of them for seconds.
settings.register_profile("new", deadline=None, suppress_health_check=[HealthCheck.too_slow])
# The same examples in every run, so that what fails was broken by a change; `make soak` looks for others.
settings.register_profile("repeatable", settings.get_profile("new"), derandomize=True)
settings.load_profile("repeatable")

watch_imports()  # those of plug-ins that are not installed skip tests

FIXTURES = {
    "renderer": {"engine", "project", "finished", "finished_project", "published"},
    "slow": {"browser", "s3", "site", "slurm", "turned_in_two_looks", "wheel"},
}
"""Fixtures by the mark of the tests that use them: some start Mitsuba, or run the command, which does, others
start a server or a browser, or make in seconds what a module of tests looks at."""


MAY_BE_SKIPPED = re.compile(
    r"exact at any step|a command line has no such words"  # cases that a property does not speak of
    r"|no SLURM here|this machine has a GPU|nohup has hangups ignored|Blender is not there"
)
"""Reasons of tests that are skipped on a machine that has all that set-up installs."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--complete", action="store_true", help="fail where a test misses what set-up installs")
    parser.addoption("--no-forks", action="store_true", help="start each command as a new process of Python")


def pytest_configure(config: pytest.Config) -> None:
    """Have commands forked, unless they are to be started as users start them.

    Nothing is collected as garbage while tests are: what they load stays. At the end Python collects all of
    it, for libraries report what is never collected.
    """
    gc.disable()
    atexit.register(gc.unfreeze)
    if not config.getoption("--no-forks"):
        COMMANDS.begin()


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """With `--complete`, fail if a test was skipped for a reason that is not in MAY_BE_SKIPPED."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or not session.config.getoption("--complete"):
        return
    for report in reporter.stats.get("skipped", ()):
        *_, reason = report.longrepr if isinstance(report.longrepr, tuple) else (str(report.longrepr),)
        if not MAY_BE_SKIPPED.search(reason):
            reporter.write_line(
                f"{report.nodeid} was skipped, which set-up should prevent: {reason}", red=True
            )
            session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_collection_finish() -> None:
    """Keep garbage collections away from what is loaded: imageio collects after each movie, for 0.2 s."""
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Keep them also away from what the tests of a file have loaded: kernels are a million objects."""
    if nextitem is None or nextitem.path != item.path:
        gc.collect()
        gc.freeze()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests that `make quick` leaves out.

    They use one of FIXTURES, or lie in tests/production, whose modules without a renderer are marked `quick`.
    """
    for item in items:
        if item.path.parent.name == "production" and not item.get_closest_marker("quick"):
            item.add_marker(pytest.mark.renderer)
        for mark, fixtures in FIXTURES.items():
            if fixtures & set(getattr(item, "fixturenames", ())):
                item.add_marker(mark)


TINY = """\
title: A box, twisted
frames: 1-6
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 0.5}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 4: 36, 6: 60}}}
camera: {azimuth: -30, elevation: 14}
"""

QUALITY = "draft.scale20"
"""The quality of pictures whose details no test looks at: 96 × 54 pixels. A frame of it costs a tenth of one
at draft."""

HOSTILE = 'it\'s "{shot}" of $HOME; ünï 日本 & 50% (b) [c] \\d'
"""A folder's name that shells, formats, patterns and addresses could each take for something else."""

AT_LINK = """\
import os, signal, sys

def watch(event, given):
    if event not in ("os.link", "os.rename"):
        return
    folder, name = os.path.split(os.fsdecode(given[1]))  # the folder may be held by its descriptor
    if os.path.basename(os.path.realpath(folder)) + "/" + name == {name!r}:
        try:
            os.mkdir({done!r})
        except FileExistsError:
            return
        {do}

sys.addaudithook(watch)
"""
"""A module that Python imports when it starts: it does something once, when a file gets a name."""

FILM = """\
title: Tiny
subtitle: six frames
shots: [T010_tiny]
title_seconds: 0.5
credits_seconds: 0
"""


@dataclass(frozen=True)
class Run:
    """A command's exit code and output."""

    code: int
    out: str
    err: str


def lines(text: str) -> list[str]:
    """Return the lines of a text that are not blank."""
    return [line for line in text.splitlines() if line.strip()]


def commanded(root: Path, *words: str) -> tuple[int, str]:
    """Exit code and words of a command, in this process; raises what no user should see."""
    from typer.testing import CliRunner

    from flowsculpt.pipeline.cli.app import command_line
    from flowsculpt.pipeline.errors import FlowsculptError

    asked = ["--no-progress", "--root", str(root), *words]
    said = CliRunner().invoke(command_line(), asked)
    if isinstance(said.exception, FlowsculptError):
        return said.exception.exit_code, str(said.exception)
    if said.exception is not None and not isinstance(said.exception, SystemExit):
        raise said.exception
    return said.exit_code, said.output


def done(root: Path, plan: Plan) -> None:
    """Do the jobs of a plan in this process, each after those that make what it reads."""
    from flowsculpt.pipeline.production.tasks.job import Context
    from flowsculpt.pipeline.production.tasks.worker import task_of

    waiting, missing = list(plan.jobs), {job.output for job in plan.jobs}
    while waiting:
        job = next(job for job in waiting if not missing & set(plan.all_inputs(job)))
        assert task_of(job.stage)(Context.of(root, plan, job.name)), job.name
        waiting.remove(job)
        missing.remove(job.output)


@dataclass(frozen=True)
class ProjectFolder:
    """A working folder with `shots/`, and the command run in it."""

    path: Path

    @property
    def shot(self) -> Path:
        return self.path / "shots" / "T010_tiny.yaml"

    def run(self, *words: str, cores: int = 1) -> Run:
        """Run the command, by default on one core: on two, two renderers start for a few frames."""
        command = python_process.python_command("flowsculpt", "--no-progress", "-j", str(cores), *words)
        done = subprocess.run(command, cwd=self.path, capture_output=True, text=True, timeout=900)
        assert "Traceback" not in done.stdout + done.stderr, done.stderr
        return Run(done.returncode, done.stdout, done.stderr)

    def call(self, *words: str) -> Run:
        """Run the command in this process, where a test needs no process of its own: Python starts slowly."""
        import OpenImageIO  # noqa: F401 sets where its fonts are, which the patched environment would lose

        from flowsculpt.pipeline.cli.app import main
        from flowsculpt.render.base.python_process import ENDING

        out, err = StringIO(), StringIO()
        handlers = [(number, signal.getsignal(number)) for number in ENDING]
        with (
            chdir(self.path),
            redirect_stdout(out),
            redirect_stderr(err),
            pytest.MonkeyPatch.context() as patch,
            mock.patch.dict(os.environ),
            pytest.raises(SystemExit) as ended,
        ):
            patch.setattr(sys, "argv", ["flowsculpt", "--no-progress", "-j", "2", *words])
            patch.setattr(sys, "path", [*sys.path])
            try:
                main()
            finally:
                for number, handler in handlers:
                    signal.signal(number, handler)
        return Run(int(ended.value.code or 0), out.getvalue(), err.getvalue())

    def render(
        self, frames: str | None = None, *, settings: tuple[str, ...] = (), quality: str = QUALITY
    ) -> Plan:
        """Render frames of the shot in this process, stage after stage; return the plan that was followed."""
        from flowsculpt.pipeline.frames import FrameRange
        from flowsculpt.pipeline.production.execution.project import Project

        asked = None if frames is None else FrameRange.parse(frames)
        with chdir(self.path):
            plan = Project(self.path, 1, settings=settings).pictures([self.shot.stem], quality, asked)
            done(self.path, plan)
        return plan

    def start(self, *words: str, at_raw: tuple[int, str] | None = None) -> subprocess.Popen[str]:
        """The command at work, in a process group of its own.

        at_raw  a statement that the process which renders a frame executes when it shows the raw frame, once
        """
        command = python_process.python_command("flowsculpt", "--no-progress", "-j", "2", *words)
        environment = dict(os.environ)
        if at_raw is not None:
            number, statement = at_raw
            hooks = self.path.parent / f"{self.path.name}-hooks"
            hooks.mkdir()
            name, done = f"raw/{self.shot.stem}.{number:04d}.exr", str(hooks / "done")
            hook = hooks / "sitecustomize.py"
            hook.write_text(AT_LINK.format(name=name, done=done, do=statement))
            environment |= {AT_START: str(hook)} if COMMANDS.is_on else {"PYTHONPATH": str(hooks)}
        return subprocess.Popen(
            command,
            cwd=self.path,
            env=environment,
            process_group=0,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    wait_until = staticmethod(wait_until)

    @staticmethod
    def renderers(process: subprocess.Popen[str]) -> list[psutil.Process]:
        """Return those processes of a command that have loaded Mitsuba."""
        try:
            family = psutil.Process(process.pid).children(recursive=True)
            return [each for each in family if any("mitsuba" in file.path for file in each.memory_maps())]
        except psutil.Error:
            return []

    def frames(self, quality: str = QUALITY, kind: str = "frames") -> list[Path]:
        return sorted((self.path / "renders" / "T010_tiny" / quality / kind).glob("*.exr"))

    def copy(self, place: Path) -> ProjectFolder:
        shutil.copytree(self.path, place, copy_function=shutil.copy2)
        return ProjectFolder(place)


@pytest.fixture
def without_forks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the commands of a test started as users start them, for what a fork does not show."""
    monkeypatch.setattr(COMMANDS, "is_on", False)


@contextmanager
def forking_with_plugins() -> Iterator[None]:
    """Have commands forked whose PYTHONPATH leads to other plug-ins, of a process that has none."""
    if COMMANDS.is_on:
        LIBRARIES.begin()
    yield
    LIBRARIES.is_on = False


@pytest.fixture
def forks_with_plugins() -> Iterator[None]:
    """Have all commands of a test forked as `forking_with_plugins` does."""
    with forking_with_plugins():
        yield


@pytest.fixture
def project(tmp_path: Path) -> ProjectFolder:
    """A working folder with one tiny shot and an edit; nothing made yet."""
    return new_project(tmp_path)


@pytest.fixture(scope="session")
def finished_project(tmp_path_factory: pytest.TempPathFactory) -> ProjectFolder:
    """A project whose film is made at QUALITY; tests work on copies of it."""
    made = new_project(tmp_path_factory.mktemp("finished") / HOSTILE)
    done = made.run("film", "-q", QUALITY, cores=2)
    assert done.code == 0, done.err
    return made


@pytest.fixture
def finished(finished_project: ProjectFolder, tmp_path: Path) -> ProjectFolder:
    """A copy of a finished project. Links have become copies, as on a file system without them."""
    return finished_project.copy(tmp_path / HOSTILE)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Debian's Chromium, which is fetched where it is not here; skips where it cannot be had.

    It ends with the module, for while it is there an event loop runs in this process.
    """
    from tests.chromium import ChromiumError, fetch, running

    try:
        fetch()
        with running() as found:
            yield found
    except ChromiumError as error:
        pytest.skip(f"no browser: {error}")


def new_project(path: Path) -> ProjectFolder:
    """Return a working folder at a path, with one tiny shot and an edit."""
    (path / "shots").mkdir(parents=True)
    (path / "shots" / "T010_tiny.yaml").write_text(TINY)
    (path / "shots" / "film.yaml").write_text(FILM)
    return ProjectFolder(path)
