"""The job server: what it forks is a process like any other, and the one that stands for it shows it so."""

from __future__ import annotations

import os
import shutil
import signal
import socket as sockets
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import psutil
import pytest

from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.tasks import job_server
from flowsculpt.pipeline.production.tasks.job_process import SERVER
from tests.processes import has_ended, process_numbered, wait_until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux forks safely")

LONG = """
title: Long
frames: 1-9000
subject: {solid: box}
resample: {max_edge_length: 0.4}
flows: [translation: {rate: [1, 0, 0]}]
"""

SERVE = """
import os
from flowsculpt.pipeline.production.tasks.job_server import job_server
with job_server():
    print(os.environ["FLOWSCULPT_JOB_SERVER"], flush=True)
    input()
"""


@pytest.fixture(scope="module")
def owner() -> Iterator[subprocess.Popen[str]]:
    """A process that has a job server. Its first line is the server's socket."""
    command = [sys.executable, "-c", SERVE]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


@pytest.fixture(scope="module")
def socket(owner: subprocess.Popen[str]) -> Path:
    assert owner.stdout is not None
    return Path(owner.stdout.readline().strip())


@pytest.fixture
def job(tmp_path: Path) -> list[str]:
    """The words of a job that takes a minute."""
    shot = tmp_path / "long.yaml"
    shot.write_text(LONG)
    plan = Project(tmp_path, 1).meshes([str(shot)])
    return [str(plan.freeze(tmp_path)), plan.jobs[0].name]


def test_a_temporary_folder_whose_path_is_too_long_for_a_socket_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long = tmp_path / ("a" * 90)
    long.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(long))
    opened = job_server._listener()
    assert opened is not None
    folder, listener = opened
    listener.close()
    shutil.rmtree(folder)
    assert not folder.is_relative_to(long) and not [*long.iterdir()]


def start(socket: Path, root: Path, *words: str) -> subprocess.Popen[str]:
    """Start the process of a job as Snakemake does; it tells on standard error what it imports itself."""
    command = [
        sys.executable,
        "-X",
        "importtime",
        "-m",
        "flowsculpt.pipeline.production.tasks.job_process",
        *words,
    ]
    environment = {**os.environ, SERVER: str(socket)}
    return subprocess.Popen(command, cwd=root, env=environment, stderr=subprocess.PIPE, text=True)


def forked(owner: subprocess.Popen[str], root: Path) -> list[psutil.Process]:
    """The processes that the server has forked, at work in a root. One that ends meanwhile is left out."""
    (server,) = psutil.Process(owner.pid).children()
    working = []
    for each in server.children():
        with suppress(psutil.NoSuchProcess):
            if each.cwd() == str(root):
                working.append(each)
    return working


def test_a_job_that_ends_gives_its_words_and_its_exit_code(socket: Path, tmp_path: Path) -> None:
    process = start(socket, tmp_path)
    _, words = process.communicate(timeout=300)
    assert process.returncode == 2
    assert "required: plan_path, job_name" in words
    assert "numba" not in words and "numpy" not in words, "who stands for a job loads nothing for it"


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 130), (signal.SIGKILL, -signal.SIGKILL)]
)
def test_a_signal_to_who_stands_for_a_job_ends_the_job(
    owner: subprocess.Popen[str], socket: Path, tmp_path: Path, job: list[str], number: int, code: int
) -> None:
    process = start(socket, tmp_path, *job)
    wait_until(lambda: list(tmp_path.rglob("long.0002.npz")))
    assert len(forked(owner, tmp_path)) == 1
    process.send_signal(number)
    process.communicate(timeout=300)
    assert process.returncode == code
    wait_until(lambda: not forked(owner, tmp_path))


def test_who_stands_for_a_killed_job_dies_as_the_job_did(
    owner: subprocess.Popen[str], socket: Path, tmp_path: Path, job: list[str]
) -> None:
    process = start(socket, tmp_path, *job)
    wait_until(lambda: forked(owner, tmp_path))
    forked(owner, tmp_path)[0].send_signal(signal.SIGSEGV)
    process.communicate(timeout=300)
    assert process.returncode == -signal.SIGSEGV


def test_a_job_without_a_server_works_by_itself(tmp_path: Path) -> None:
    process = start(tmp_path / "no-socket", tmp_path)
    _, words = process.communicate(timeout=300)
    assert process.returncode == 2
    assert "required: plan_path, job_name" in words


def says_nothing(connection: sockets.socket) -> None:
    pass


def resets(connection: sockets.socket) -> None:
    connection.close()


def says_what_is_not_json(connection: sockets.socket) -> None:
    connection.send(b"\x00\xff{")


def says_half_a_request(connection: sockets.socket) -> None:
    with Path(os.devnull).open("rb") as empty:
        sockets.send_fds(connection, [b'{"words": ["plan"]}'], [empty.fileno(), empty.fileno()])


def gives_no_outputs(connection: sockets.socket) -> None:
    connection.send(b'{"words": [], "folder": "/", "process": 1}')


@pytest.mark.parametrize(
    "does", [says_nothing, resets, says_what_is_not_json, says_half_a_request, gives_no_outputs]
)
def test_whatever_a_connection_does_others_are_served(
    does: Callable[[sockets.socket], None], socket: Path, tmp_path: Path
) -> None:
    with ExitStack() as stack:
        for _ in range(20):
            connection = stack.enter_context(sockets.socket(sockets.AF_UNIX, sockets.SOCK_SEQPACKET))
            connection.connect(str(socket))
            does(connection)
        process = start(socket, tmp_path)
        _, words = process.communicate(timeout=300)
    assert process.returncode == 2 and "argparse" not in words, "the server has done it"


def test_a_signal_that_comes_when_the_job_has_ended_reaches_no_other_process(
    owner: subprocess.Popen[str], socket: Path, tmp_path: Path, job: list[str]
) -> None:
    process = start(socket, tmp_path, *job)
    wait_until(lambda: forked(owner, tmp_path))
    (work,) = forked(owner, tmp_path)
    psutil.Process(process.pid).suspend()  # so that it learns late of the end
    work.kill()
    wait_until(lambda: not forked(owner, tmp_path))
    with process_numbered(work.pid) as other:
        process.send_signal(signal.SIGTERM)
        psutil.Process(process.pid).resume()
        process.communicate(timeout=300)
        assert process.returncode == -signal.SIGKILL
        assert other.poll() is None


def test_a_server_goes_with_the_process_that_started_it(owner: subprocess.Popen[str], socket: Path) -> None:
    (server,) = psutil.Process(owner.pid).children()
    owner.kill()
    wait_until(lambda: has_ended(server))
    wait_until(lambda: not socket.parent.exists())
