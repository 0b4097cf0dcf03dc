"""Runs commands for tests, each in a fork of a process that has loaded what commands load.

Python, numba, the documents of shot files and Snakemake take two seconds of CPU time to load, a third of a
run of a small shot. A command remains a process of its own, with its environment, folder and output. It is
started as users start it where its environment could change what is loaded.
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
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryFile

HARMLESS = {
    *("DRJIT_LIBLLVM_PATH", "NUMBA_DISABLE_INTEL_SVML", "OMP_WAIT_POLICY", "OpenImageIO_ROOT"),
    "PYTEST_CURRENT_TEST",
}
"""Variables that libraries and pytest set in a process, and that do not change what is loaded."""

REQUEST_BYTES = 1 << 17


class CommandServer:
    """A process that forks one for each command. It starts with the first command, and ends with this one."""

    def __init__(self) -> None:
        self._environment = _deciding()
        self._connection: socket.socket | None = None

    def run(
        self, command: list[str], folder: Path, timeout: float, stderr: int = subprocess.PIPE
    ) -> subprocess.CompletedProcess[str]:
        """Run `python [-P] -m MODULE WORDS…` in a folder, as `subprocess.run` does; return its output."""
        if sys.platform != "linux" or _deciding() != self._environment:
            output = {"stdout": subprocess.PIPE, "stderr": stderr}
            return subprocess.run(command, cwd=folder, **output, text=True, timeout=timeout)
        if self._connection is None:
            self._connection = self._start()
        request = {"command": command, "folder": str(folder), "environment": dict(os.environ)}
        with TemporaryFile() as out, TemporaryFile() as err:
            outputs = [out.fileno(), (out if stderr == subprocess.STDOUT else err).fileno()]
            socket.send_fds(self._connection, [json.dumps(request).encode()], outputs)
            process = int(self._connection.recv(32))
            self._connection.settimeout(timeout)
            try:
                code = int(self._connection.recv(32))
            except TimeoutError:
                os.kill(process, signal.SIGKILL)
                raise
            self._connection.settimeout(None)
            said = [os.pread(number, os.fstat(number).st_size, 0).decode() for number in outputs]
        return subprocess.CompletedProcess(command, code, *said)

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
        request, outputs, *_ = socket.recv_fds(connection, REQUEST_BYTES, 2)
        if not request:
            return
        process = get_context("fork").Process(target=_run, args=(outputs,), kwargs=json.loads(request))
        process.start()
        for output in outputs:
            os.close(output)
        connection.send(str(process.pid).encode())
        process.join()
        connection.send(str(process.exitcode).encode())


def _run(outputs: list[int], command: list[str], folder: str, environment: dict[str, str]) -> None:
    """Run a command in this process, which ends with it."""
    for number, output in zip((1, 2), outputs, strict=True):
        os.dup2(output, number)
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
    """Load what the commands of tests load."""
    import snakemake.cli  # noqa: F401

    from flowsculpt.pipeline.cli import commands, render_commands  # noqa: F401
    from flowsculpt.pipeline.production.tasks import worker_pool

    worker_pool.load_what_jobs_need()


if __name__ == "__main__":
    _load()
    _serve(socket.socket(fileno=int(sys.argv[1])))
    os._exit(0)  # without looking for what was never freed
