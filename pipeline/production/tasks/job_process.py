"""The process of one job, as Snakemake starts it, with a plan and the name of a job.

Where a job server runs, it forks the process that works. This one then passes on the signals that it gets,
and ends with the same exit code. Elsewhere this process does the job itself. It imports next to nothing
before.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import struct
import sys

SERVER = "FLOWSCULPT_JOB_SERVER"
"""The environment variable that names the socket of the job server."""

NUMBER = struct.Struct("<i")
"""An answer of the server: the id of the forked process, and then its end, as `Popen.returncode` has it; and
what it is sent: a signal."""


def main(words: list[str]) -> int:
    """Do a job, or have it done; return its exit code. Ends by a signal if the forked process did."""
    if SERVER in os.environ:
        passed_on = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP, signal.SIGCONT)
        signal.pthread_sigmask(signal.SIG_BLOCK, passed_on)  # until there is a process to pass them on to
        connection = _connection_to_forked(words)
        if connection is not None:
            for number in passed_on:
                if signal.getsignal(number) != signal.SIG_IGN:
                    signal.signal(number, lambda received, frame: _pass_on(received, connection))
        signal.pthread_sigmask(signal.SIG_UNBLOCK, passed_on)
        if connection is not None:
            return _end_of_forked(connection)
    from flowsculpt.pipeline.production.tasks.worker import run

    return run(words)


def _end_of_forked(connection: socket.socket) -> int:
    """Return the exit code of the forked process; end by the signal that ended it."""
    ended = b""
    with contextlib.suppress(OSError):
        ended = connection.recv(NUMBER.size)
    (code,) = NUMBER.unpack(ended) if ended else (-signal.SIGKILL,)  # the server was killed
    if code < 0:
        _die_of(-code)
    return int(code)


def _connection_to_forked(words: list[str]) -> socket.socket | None:
    """Have the job server fork a process for a job; return the connection, or None without one."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        connection.connect(os.environ[SERVER])
        request = {"words": words, "folder": os.getcwd(), "process": os.getpid()}  # noqa: PTH109 (pathlib loads slowly)
        outputs = [sys.stdout.fileno(), sys.stderr.fileno()]
        socket.send_fds(connection, [json.dumps(request).encode()], outputs)
        answer = connection.recv(NUMBER.size)
    except OSError:
        answer = b""
    return connection if answer else None


def _pass_on(number: int, connection: socket.socket) -> None:
    """Have the forked process sent the signal that this one received; stop where it asks to stop."""
    with contextlib.suppress(OSError):  # the server has ended, and the forked process with it
        connection.send(NUMBER.pack(number))
    if number == signal.SIGTSTP:
        os.kill(os.getpid(), signal.SIGSTOP)


def _die_of(number: int) -> None:
    """End this process by the signal that ended the forked one, which left a core file if any is wanted."""
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if number != signal.SIGKILL:
        signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
