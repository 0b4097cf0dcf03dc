"""The kernels that set-up leaves to compile, because most films do without them.

A file in the user's cache says that some remain. The first command that runs jobs on this machine starts a
process of the lowest priority that compiles them, and holds the lock of that file. Where it is killed, the
next command starts another, which goes on from there.
"""

from __future__ import annotations

import os
import subprocess
from contextlib import suppress
from pathlib import Path

from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.python_process import environment, python_command
from flowsculpt.render.base.root_files import remove_file
from flowsculpt.render.base.user_cache import kernel_homes

_IN_BACKGROUND = "FLOWSCULPT_IN_BACKGROUND"
"""The environment variable of processes that nobody waits for."""

_DETACHED = ("sh", "-c", 'nice -n 19 "$0" "$@" &')
"""The beginning of a command that starts a process of the lowest priority, which nothing waits for."""


def note_remaining_kernels() -> None:
    """Note that kernels remain to be compiled. Raises MachineError where the disk refuses."""
    with atomic_write(_note(), flush=False) as draft:
        draft.touch()


def note_no_remaining_kernels() -> None:
    """Note that all kernels are compiled. Raises MachineError where the disk refuses."""
    remove_file(_note())


def kernels_remain() -> bool:
    """Tell whether set-up has left kernels that are not compiled yet."""
    return _note().exists()


def compile_remaining_kernels() -> bool:
    """Start the process that compiles what remains, unless one does so already; return whether it has.

    It stays in this session: Linux weighs priorities within a session alone.
    """
    with suppress(OSError, ImportError, subprocess.SubprocessError):  # Windows has no fcntl
        import fcntl

        with _note().open("rb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            subprocess.run(
                [*_DETACHED, *python_command("flowsculpt", "-j", "1", "doctor", "--prepare")],
                env={**environment(), _IN_BACKGROUND: "1"},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[lock.fileno()],  # the lock is the process's own from now on
                process_group=0,  # Ctrl-C and a closed terminal end what is in the foreground
                check=True,
            )
            return True
    return False


def is_in_background() -> bool:
    """Tell whether nobody waits for this process."""
    return _IN_BACKGROUND in os.environ


def _note() -> Path:
    return kernel_homes()[1] / "remaining"
