"""Runs commands for tests, each in a fork of a process that has loaded what commands load.

Python, numba, kernels, the documents of shot files and Snakemake take four seconds of CPU time to load, twice
what a run of a small shot then takes. A command remains a process of its own, with its environment, folder
and output. It is started as users start it where its environment could change what is loaded.
"""

from __future__ import annotations

import atexit
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import threading
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

HARMLESS = {
    *("DRJIT_LIBLLVM_PATH", "NUMBA_DISABLE_INTEL_SVML", "OMP_WAIT_POLICY", "OpenImageIO_ROOT"),
    *("PYTEST_CURRENT_TEST", "FLOWSCULPT_PROCESS", "FLOWSCULPT_STORE", "FLOWSCULPT_STORE_READ_ONLY"),
    *("AWS_ACCESS_KEY_ID", "AWS_DEFAULT_REGION", "AWS_ENDPOINT_URL", "AWS_SECRET_ACCESS_KEY"),
}
"""Variables that libraries, pytest and tests set in a process, and that do not change what is loaded."""

REQUEST_BYTES = 1 << 17

SMALL_SHOT = """\
{title: A, frames: 1-3, subject: {solid: box, size: [2, 2, 2]}, resample: {max_edge_length: 0.5},
flows: [{twist: {axis: y, amount: {keys: {1: 0, 3: 90}}}}]}
"""


class CommandServer:
    """A process that forks one for each command. It starts with the first command, and ends with this one.

    forks  how many it has forked
    """

    def __init__(self) -> None:
        self.forks = 0
        self._environment = _deciding()
        self._connection: socket.socket | None = None
        self._turn = threading.Lock()
        self._readers: set[str] = set()

    def run(
        self, command: list[str], folder: Path, timeout: float, stderr: int = subprocess.PIPE
    ) -> subprocess.CompletedProcess[str]:
        """Run `python [-P] -m MODULE WORDS…` in a folder, as `subprocess.run` does; return its output."""
        if not self._takes_turn():
            output = {"stdout": subprocess.PIPE, "stderr": stderr}
            return subprocess.run(command, cwd=folder, **output, text=True, timeout=timeout)
        with TemporaryFile() as out, TemporaryFile() as err:
            files = [out.fileno(), (out if stderr == subprocess.STDOUT else err).fileno()]
            code = self._end(self._fork(command, folder, *files), timeout)
            said = [os.pread(each.fileno(), os.fstat(each.fileno()).st_size, 0) for each in (out, err)]
        return subprocess.CompletedProcess(command, code, *(each.decode() for each in said))

    def read(
        self, command: list[str], input: bytes, timeout: float, **others: Any
    ) -> subprocess.CompletedProcess[bytes]:
        """Run a module that reads files of others, as `subprocess.run` does; forked from its second time on.

        It is given a pipe, for it may write no file.
        """
        is_known = command[-1] in self._readers
        self._readers |= {each for each in command[-1:] if each.startswith("flowsculpt.")}
        if not is_known or not self._takes_turn():
            return subprocess.run(command, input=input, timeout=timeout, **others)
        reading, writing = os.pipe()
        with TemporaryFile() as given, TemporaryFile() as errors, os.fdopen(reading, "rb") as said:
            given.write(input)
            given.seek(0)
            process = self._fork(command, Path.cwd(), writing, errors.fileno(), given.fileno())
            os.close(writing)
            limit = threading.Timer(timeout, os.kill, (process, signal.SIGKILL))
            limit.start()
            output = said.read()
            limit.cancel()
            return subprocess.CompletedProcess(command, self._end(process, timeout), output, b"")

    def _takes_turn(self) -> bool:
        """Tell whether it can fork now: it waits for one process, and then does not until `_end`."""
        is_same = sys.platform == "linux" and _deciding() == self._environment
        return is_same and self._turn.acquire(blocking=False)

    def _fork(self, command: list[str], folder: Path, *files: int) -> int:
        """Fork a process for a command, with files as output, errors and input; return its number."""
        if self._connection is None:
            self._connection = self._start()
        request = {"command": command, "folder": str(folder), "environment": dict(os.environ)}
        socket.send_fds(self._connection, [json.dumps(request).encode()], files)
        self.forks += 1
        return int(self._connection.recv(32))

    def _end(self, process: int, timeout: float) -> int:
        """Return the exit code of the process once it has ended. Raises TimeoutError where it is killed."""
        assert self._connection is not None
        self._connection.settimeout(timeout)
        try:
            return int(self._connection.recv(32))
        except TimeoutError:
            os.kill(process, signal.SIGKILL)
            self._connection.settimeout(None)
            self._connection.recv(32)
            raise
        finally:
            self._connection.settimeout(None)
            self._turn.release()

    @staticmethod
    def _start() -> socket.socket:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-P", __file__, str(theirs.fileno())],
                cwd="/",
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
            )
        atexit.register(process.wait)
        atexit.register(ours.close)
        return ours


def _deciding() -> dict[str, str]:
    """Return the variables of the environment that may decide what a process loads."""
    return {name: value for name, value in os.environ.items() if name not in HARMLESS}


def _serve(connection: socket.socket) -> None:
    """Fork a process for each command that is asked for; in the process, run the command."""
    while True:
        request, files, *_ = socket.recv_fds(connection, REQUEST_BYTES, 3)
        if not request:
            return
        process = get_context("fork").Process(target=_run, args=(files,), kwargs=json.loads(request))
        process.start()
        for file in files:
            os.close(file)
        connection.send(str(process.pid).encode())
        process.join()
        connection.send(str(process.exitcode).encode())


def _run(files: list[int], command: list[str], folder: str, environment: dict[str, str]) -> None:
    """Run a command in this process, which ends with it."""
    for number, file in zip((1, 2, 0), files, strict=False):
        os.dup2(file, number)
    sys.stdin = os.fdopen(0, closefd=False)  # multiprocessing has given it another file
    os.chdir(folder)
    loaded = {name: os.environ[name] for name in HARMLESS & set(os.environ)}
    os.environ.clear()
    os.environ.update(loaded | environment)
    module = command.index("-m") + 1
    if "-P" not in command[:module]:
        sys.path.insert(0, folder)
    sys.argv = command[module:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


def _load() -> None:
    """Load what the commands of tests load, and the kernels that make the frames of a small shot."""
    import smart_open  # noqa: F401  # Snakemake reads the Snakefile with it
    import snakemake.cli

    from flowsculpt.pipeline.animation import animate
    from flowsculpt.pipeline.cli import commands, render_commands  # noqa: F401
    from flowsculpt.pipeline.production.tasks import worker_pool
    from flowsculpt.pipeline.shot import read_shot
    from flowsculpt.render.base.kernel_build import PREPARED

    snakemake.cli.get_argument_parser()
    worker_pool.load_what_jobs_need()
    for _ in animate(read_shot("small.yaml", text=SMALL_SHOT)):
        pass
    for name in PREPARED:
        import_module(name).prepare()


if __name__ == "__main__":
    _load()
    _serve(socket.socket(fileno=int(sys.argv[1])))
    os._exit(0)  # without looking for what was never freed
