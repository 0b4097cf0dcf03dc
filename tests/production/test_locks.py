"""Runs of different shots and qualities go side by side in one root; a second run of the same is refused."""

from __future__ import annotations

import errno
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import chdir
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from flowsculpt.pipeline.errors import MachineError
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.store import locks
from flowsculpt.pipeline.production.store.locks import Locks
from flowsculpt.render.base.python_process import python_command
from tests.conftest import done, new_project
from tests.needed_plugins import installed

NAMES = ("T010_tiny", "T020_other")
QUALITY = "draft.scale10"


def names(shot: str, quality: str = "draft") -> dict[str, str]:
    return {Locks.name(shot, quality): f"{shot} at {quality}"}


def test_a_second_run_of_the_same_is_told_who_makes_it(tmp_path: Path) -> None:
    with Locks(tmp_path).hold_with_writers(), Locks(tmp_path).hold(names("A")) as waited:
        assert not waited
        with (
            Locks(tmp_path).hold_with_writers(),
            pytest.raises(MachineError, match=rf"^A at draft: .*, process {os.getpid()}, since 20"),
            Locks(tmp_path).hold(names("A")),
        ):
            pass
        with (
            Locks(tmp_path).hold_with_writers(),
            Locks(tmp_path).hold(names("A", "final")),
            Locks(tmp_path).hold(names("B")),
        ):
            pass
    with Locks(tmp_path).hold(names("A")):
        pass
    assert list((tmp_path / ".flowsculpt/locks").iterdir()) == []


def refusing(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def refuse(descriptor: int, flags: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("portalocker.portalocker.LOCKER", refuse)


def test_a_file_system_without_locks_is_used_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    refusing(monkeypatch, errno.ENOLCK)
    one, other = Locks(tmp_path).hold(names("A")), Locks(tmp_path).hold(names("A"))
    with (
        Locks(tmp_path).hold_with_writers(),
        Locks(tmp_path).hold_alone(),
        one as one_waited,
        other as other_waited,
    ):
        assert not one_waited and not other_waited


def test_an_error_of_the_disk_is_no_other_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    refusing(monkeypatch, errno.EIO)
    with (
        pytest.raises(MachineError, match="the disk reports an error"),
        Locks(tmp_path).hold_with_writers(wait=True),
    ):
        pass


HOLDER = """
import sys
from pathlib import Path
from flowsculpt.pipeline.production.store.locks import Locks
with Locks(Path.cwd()).hold_with_writers(), Locks(Path.cwd()).hold({"A.draft": "A at draft"}):
    print("held", flush=True)
    input()
"""


@pytest.mark.skipif(shutil.which("unshare") is None, reason="no unshare, which makes another host")
def test_a_forked_process_leaves_locks_to_the_one_that_forked_it(tmp_path: Path) -> None:
    context = get_context("fork")
    works = context.Event()
    with Locks(tmp_path).hold_with_writers(), Locks(tmp_path).hold(names("A")):
        process = context.Process(target=lambda: (works.set(), time.sleep(3600)))
        process.start()
        works.wait(120)
    try:
        with Locks(tmp_path).hold_alone():
            assert process.is_alive()
    finally:
        process.kill()
        process.join()


def test_a_run_of_another_host_holds_its_lock_and_is_named(tmp_path: Path) -> None:
    words = ["unshare", "--user", "--map-root-user", "--uts", "sh", "-c", 'hostname farm7 && exec "$@"', "sh"]
    command = [*words, sys.executable, "-c", HOLDER]
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, cwd=tmp_path, text=True, **pipes) as other:
        if not other.stdout.readline():
            pytest.skip(f"no second host: {other.communicate()[1].strip()}")
        with (
            pytest.raises(MachineError, match=r"^A at draft: another .* on farm7, process \d+, since 20"),
            Locks(tmp_path).hold(names("A")),
        ):
            pass
        with (
            pytest.raises(MachineError, match=r"here: A at draft by .* on farm7"),
            Locks(tmp_path).hold_alone(),
        ):
            pass
        other.kill()
        other.wait()
        with (
            Locks(tmp_path).hold_alone(),
            pytest.raises(MachineError, match="removes files"),
            Locks(tmp_path).hold_with_writers(),
        ):
            pass


def test_the_first_of_two_locks_is_given_back_where_the_second_is_refused(tmp_path: Path) -> None:
    with Locks(tmp_path).hold(names("B")):
        with pytest.raises(MachineError, match=r"^B at draft"), Locks(tmp_path).hold(names("A") | names("B")):
            pass
        with Locks(tmp_path).hold(names("A")):
            pass


def test_what_removes_files_works_alone_and_names_who_is_at_work(tmp_path: Path) -> None:
    at_work, removes = "is writing here: A at draft by ", "removes files from the store: "
    with (
        Locks(tmp_path).hold_with_writers(),
        Locks(tmp_path).hold(names("A")),
        pytest.raises(MachineError, match=at_work),
        Locks(tmp_path).hold_alone(),
    ):
        pass
    with (
        Locks(tmp_path).hold_alone(),
        pytest.raises(MachineError, match=removes),
        Locks(tmp_path).hold_with_writers(),
    ):
        pass
    with Locks(tmp_path).hold_with_writers(), Locks(tmp_path).hold_with_writers():
        pass


def test_whoever_waits_goes_on_once_the_other_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held, waits, events = threading.Event(), threading.Event(), []
    pauses = SimpleNamespace(sleep=lambda seconds: waits.set(), strftime=time.strftime)

    def hold() -> None:
        with Locks(tmp_path).hold(names("A")), Locks(tmp_path).hold_key("k", lambda: None):
            held.set()
            assert waits.wait(120)
            events.append("released")

    thread = threading.Thread(target=hold)
    thread.start()
    assert held.wait(120)
    monkeypatch.setattr(locks, "time", pauses)
    with Locks(tmp_path).hold(names("A"), wait=True) as waited:
        events.append("held")
        assert waited
    with Locks(tmp_path).hold_key("k", lambda: events.append("waits")):
        thread.join()
    assert events[:2] == ["released", "held"]


def test_a_plan_locks_the_shots_that_it_writes(project: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project.path)
    made = Project(project.path, 2)
    assert made.film("draft").lock_names == {"T010_tiny.draft": "T010_tiny at draft"}
    assert made.meshes([NAMES[0]]).lock_names == {"T010_tiny.meshes": "the meshes of T010_tiny"}


def test_reading_takes_no_lock(project: Any) -> None:
    for words in installed(["status"], ["--dry-run", "render", NAMES[0]], ["why", NAMES[0], "1"]):
        project.call(*words)
    assert not (project.path / ".flowsculpt/lock").exists()


def two_shots(project: Any) -> None:
    """Give a project two shots of three frames: enough for a run to be killed between two."""
    text = project.shot.read_text().replace("frames: 1-6", "frames: 1-3")
    for name, amount in zip(NAMES, ("3: 60}", "3: 90}"), strict=True):
        shot = project.shot.with_stem(name)
        shot.write_text(text.replace("4: 36, 6: 60}", amount))


def pixels(folder: Path) -> dict[str, bytes]:
    """The frames of both shots, bit for bit, by place."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for name in NAMES
        for path in sorted((folder / "renders" / name / QUALITY / "frames").glob("*.exr"))
    }


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The frames of both shots, made one after the other by one process."""
    project = new_project(tmp_path_factory.mktemp("undisturbed"))
    two_shots(project)
    with chdir(project.path):
        done(project.path, Project(project.path, 1).pictures(NAMES, QUALITY))
    return pixels(project.path)


def render(project: Any, name: str) -> subprocess.Popen[str]:
    """Start a run in a process group of its own; on one core, so that two runs start two renderers."""
    return subprocess.Popen(
        python_command("flowsculpt", "--no-progress", "-j", "1", "render", name, "-q", QUALITY),
        cwd=project.path,
        process_group=0,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_two_shots_rendered_side_by_side_have_the_bits_of_one_after_the_other(
    project: Any, undisturbed: dict[str, bytes]
) -> None:
    two_shots(project)
    runs = [render(project, name) for name in NAMES]
    for run in runs:
        out, err = run.communicate(timeout=300)
        assert run.returncode == 0, out + err
    assert len(undisturbed) == 6 and pixels(project.path) == undisturbed


def test_a_second_run_waits_where_it_is_told_to(project: Any) -> None:
    first = render(project, NAMES[0])
    folder = project.path / ".flowsculpt/locks"
    project.wait_until(lambda: first.poll() is not None or list(folder.glob("*.lock")))
    second = project.call("--wait", "render", NAMES[0], "-q", QUALITY)
    assert first.wait(300) == 0 and second.code == 0, second.err
    assert second.out.startswith("Nothing to be done")
    first.communicate()


def killed(project: Any, kills: int, seconds: tuple[float, float]) -> None:
    """Kill two runs that go on side by side, again and again, with all of their processes."""
    chance = random.Random(kills)
    for _ in range(kills):
        runs = [render(project, name) for name in NAMES]
        time.sleep(chance.uniform(*seconds))
        for run in runs:
            os.killpg(run.pid, signal.SIGKILL)
            run.communicate()


@pytest.mark.parametrize("kills", [2, pytest.param(20, marks=pytest.mark.soak)])
def test_two_runs_killed_side_by_side_again_and_again_make_the_same_bits(
    project: Any, undisturbed: dict[str, bytes], kills: int
) -> None:
    two_shots(project)
    killed(project, kills, (0.5, 6.0))
    runs = [render(project, name) for name in NAMES]
    for run in runs:
        out, err = run.communicate(timeout=300)
        assert run.returncode == 0, out + err
    assert len(undisturbed) == 6 and pixels(project.path) == undisturbed
