"""Start Python processes, and keep what lies in the working folder out of them and out of this one.

A show is data: people get shows from each other. Python takes modules from the folder that it is started in
(`python -m`), and from where a relative or empty entry of PYTHONPATH leads; programs are looked up in a PATH
that holds `.`; numba reads its settings from the working folder. Here is the one place that starts Python:
`python_command` and `environment` make a process that finds our packages and those of this process, and no
module of a show. Source: https://docs.python.org/3/using/cmdline.html#cmdoption-P
"""

from __future__ import annotations

import gc
import os
import shlex
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager, suppress
from functools import cache
from pathlib import Path
from types import FrameType

import flowsculpt

PACKAGE_ROOT = Path(flowsculpt.__file__).resolve().parents[1]
"""The folder in which Python finds the package `flowsculpt`."""

LOADED_OBJECTS = 400_000
"""Twice the objects that a process makes while it loads what it needs."""

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end a process: of a user, a farm or service manager, and a terminal that is closed. Windows
lacks the last."""


def interrupt_once(number: int, frame: FrameType | None) -> None:
    """Interrupt this process once: a signal often comes several times, and must not disturb the clean-up."""
    for other in ENDING:
        signal.signal(other, signal.SIG_IGN)
    sys.unraisablehook = _interrupt_again
    raise KeyboardInterrupt


def _interrupt_again(dropped: sys.UnraisableHookArgs) -> None:
    """Interrupt this process again where Python has dropped the interrupt, unless it ends anyway.

    Python only prints what is raised while an object is freed, such as a generator that then waits for its
    threads. So the interrupt comes again a moment later, when the object is gone.
    """
    if not isinstance(dropped.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(dropped)
    elif threading.main_thread().is_alive() and dropped.object is not threading:
        signal.signal(signal.SIGINT, interrupt_once)
        again = threading.Timer(_AGAIN, os.kill, (os.getpid(), signal.SIGINT))
        again.daemon = True
        again.start()


_AGAIN = 0.05  # seconds after which an interrupt that was dropped comes again


SAFE_PATH = "PYTHONSAFEPATH"
"""The environment variable that means `-P` to every Python, also to one that others start."""


def python_command(module: str, *words: str) -> list[str]:
    """Return the command that runs an installed module, whatever the folder that it is started in holds."""
    return [sys.executable, "-P", "-m", module, *words]


def command_line(module: str, *words: str) -> str:
    """Return `python_command` as one types it into a shell."""
    return shlex.join(python_command(module, *words))


def environment() -> dict[str, str]:
    """Return the environment of this process, without paths that lead into the working folder.

    PYTHONPATH names what this process has added to Python's own search path, so that both find the same
    packages.
    """
    path = [entry for entry in os.environ.get("PATH", "").split(os.pathsep) if Path(entry).is_absolute()]
    return {
        **os.environ,
        SAFE_PATH: "1",
        "PATH": os.pathsep.join(path) or os.defpath.removeprefix(":"),
        "PYTHONPATH": os.pathsep.join(_added_to_search_path()),
    }


class ForkedProcess:
    """A process that goes on with all that this one has loaded; it is used as a `subprocess.Popen` is.

    work    is called in it; its exit code is what that returns. Locks are left to this process
    output  a file for what it prints, by default where this process prints
    folder  the folder that it works in
    """

    def __init__(
        self, work: Callable[[], int | None], output: int | None = None, folder: Path | None = None
    ) -> None:
        from multiprocessing import get_context  # takes time to import

        self._process = get_context("fork").Process(target=_run_forked, args=(work, output, folder))
        with _signals_blocked():
            self._process.start()
        self.pid = self._process.pid or 0

    @staticmethod
    def may_start() -> bool:
        """Tell whether this process may be forked: under Linux, where it has no other thread.

        OpenBLAS ends its threads before a fork, and starts them when it needs them again. So they are gone
        once a process was forked for that.
        """
        if sys.platform != "linux" or threading.active_count() > 1:
            return False
        with _signals_blocked():
            if (trial := os.fork()) == 0:
                os._exit(0)
        os.waitpid(trial, 0)
        return len(os.listdir("/proc/self/task")) == 1  # noqa: PTH208  # Paths are slow

    @property
    def sentinel(self) -> int:
        """What `multiprocessing.connection.wait` finds ready once the process has ended."""
        return self._process.sentinel

    def wait(self) -> int:
        """Return the exit code once the process has ended: minus the number of a signal that ended it."""
        self._process.join()
        return self._process.exitcode or 0

    def send_signal(self, number: int) -> None:
        """Send the process a signal, if it has not ended."""
        if self._process.exitcode is None:
            os.kill(self.pid, number)


def end_with_parent(parent: int) -> None:
    """Have this process end (SIGTERM) when its parent process has, even if it was killed; under Linux."""
    import ctypes

    ctypes.CDLL(None).prctl(_PARENT_DEATH_SIGNAL, signal.SIGTERM)
    if os.getppid() != parent:  # it ended before
        os.kill(os.getpid(), signal.SIGTERM)


_PARENT_DEATH_SIGNAL = 1
"""PR_SET_PDEATHSIG. Source: https://man7.org/linux/man-pages/man2/PR_SET_PDEATHSIG.2const.html"""


@contextmanager
def _signals_blocked() -> Iterator[None]:
    """Have signals wait, so that none interrupts a forked process in what this one does."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _run_forked(work: Callable[[], int | None], output: int | None, folder: Path | None) -> None:
    """Do the work of a forked process, with signals as in one that was started."""
    if output is not None:
        for stream, number in (("stdout", 1), ("stderr", 2)):
            os.dup2(output, number)
            setattr(sys, stream, os.fdopen(number, "w", buffering=1, encoding="utf-8", closefd=False))
    if folder is not None:
        os.chdir(folder)
    for number in ENDING:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
    sys.exit(work())


def is_own() -> bool:
    """Tell whether this is a process of flowsculpt's own, not one that uses the library."""
    return _OWN in os.environ


@cache
def prepare() -> None:
    """Make this process, and all that it starts, one of flowsculpt's own: as every command and job of it is.

    A process that uses the library keeps its settings and search path.
    """
    os.environ[_OWN] = "1"
    # Looked at when numba is first imported: see kernels.py.
    os.environ["NUMBA_DISABLE_INTEL_SVML"] = "1"
    # Threads that wait for the rest of a kernel sleep. Left to itself libgomp has them spin, and where others
    # work beside, a kernel for a hundred points then takes 10 ms, not 5 µs. It looks once, when it is loaded.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    _prefer_installed_packages()
    _forget_unreadable_settings()
    _import_numba_elsewhere()


_OWN = "FLOWSCULPT_PROCESS"
"""The environment variable of processes of flowsculpt's own."""


def _prefer_installed_packages() -> None:
    """Have what is installed come before PYTHONPATH, which may hold other versions of the same packages.

    Houdini, Maya and ROS name their own numpy there, for every Python.
    """
    named = {os.path.abspath(entry) for entry in _named()} - {str(PACKAGE_ROOT)}  # noqa: PTH100  # as `site`
    sys.path.sort(key=lambda entry: entry in named)


def _forget_unreadable_settings() -> None:
    """Leave out settings of numba that it cannot read, as another program or version of it may have."""
    threads = os.environ.get("NUMBA_NUM_THREADS", "1")
    if not threads.isdecimal() or not int(threads):
        del os.environ["NUMBA_NUM_THREADS"]
    warnings.filterwarnings("ignore", "Environment variable 'NUMBA_", RuntimeWarning)


def _import_numba_elsewhere() -> None:
    """Import numba in another folder if this one holds settings for it, which it reads when imported."""
    if os.path.exists(".numba_config.yaml"):  # noqa: PTH110  # a Path's raises errors of the disk
        with chdir("/"):
            import numba  # noqa: F401


def distrust_working_folder() -> None:
    """Take the working folder out of the search paths of this process, and of all that it starts."""
    folders, named = _untrusted(), _named()
    sys.path[:] = [e for e in sys.path if e in named or not (_is_relative(e) or _whole(e) in folders)]
    os.environ.update(environment())


def postpone_collection() -> None:
    """Have Python first look for garbage when this process has loaded what it needs, and then as usual.

    Imports make some 180,000 objects that stay. Looking through them again and again while they come takes a
    fifth of the time of a short command.
    """
    usual = gc.get_threshold()

    def restore(phase: str, info: dict[str, int]) -> None:
        if phase == "stop":
            gc.callbacks.remove(restore)
            gc.set_threshold(*usual)

    gc.callbacks.append(restore)
    gc.set_threshold(LOADED_OBJECTS, *usual[1:])


def _added_to_search_path() -> list[str]:
    """Return our folder, and entries of the search path that a new Python does not have by itself."""
    folders, installed = _untrusted(), (sys.prefix, sys.base_prefix)
    added = [
        entry
        for entry in sys.path
        if Path(entry).is_absolute() and _whole(entry) not in folders and not entry.startswith(installed)
    ]
    ours = [] if PACKAGE_ROOT.is_relative_to(sys.prefix) else [str(PACKAGE_ROOT)]
    return list(dict.fromkeys([*ours, *_named(), *added]))


def _named() -> list[str]:
    """Return the entries of PYTHONPATH that name one folder, wherever a process is started."""
    entries = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    return [entry for entry in entries if Path(entry).is_absolute()]


def _untrusted() -> set[Path]:
    """Return the working folder, the folder of the running script, and where relative entries lead."""
    entries = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    script = getattr(sys.modules["__main__"], "__file__", None)
    folders = {_whole(entry) for entry in ["", *entries] if not Path(entry).is_absolute()}
    return (folders | ({_whole(script).parent} if script else set())) - {PACKAGE_ROOT}


def _is_relative(entry: str) -> bool:
    return not Path(entry).is_absolute() and not entry.startswith("__editable__")  # which names an importer


def _whole(entry: str) -> Path:
    with suppress(FileNotFoundError):  # where the working folder was removed
        return Path(os.path.realpath(entry or "."))
    return Path(entry)
