"""Starts commands of tests as forks of a process that has loaded what commands load.

Python, numba, the documents of shot files, Snakemake and what jobs need take two to three seconds of CPU time
to load, longer than most commands of tests then work. From `COMMANDS.begin` on, a `subprocess.Popen` of one
of our modules or of Snakemake, also one in our own code, is such a fork. It is a child of the process that
asked, with the folder, the environment, the open files and the exit code that it would have. Tests of
plug-ins that are installed have the fixture `forks_with_plugins`: their commands are forks of a process that
has loaded libraries and no plug-in, and find plug-ins in a PYTHONPATH of their own.

What a fork does not show, new processes of Python do (`--no-forks`, as `make soak` has it, and the fixture
`without_forks`):

- a module that is used and not imported, an import that fails or takes long: all is imported
- settings that are looked at when a module is imported. Where a variable of the environment, a limit or a
  processor differs from those of the server, no fork is used; HARMLESS lists variables that may
- a sequence that follows the order of a set: all forks have one seed for hashes of text
- files of the working folder that Python or a library reads while it is imported
- what libraries do or say when Python takes them down: that would take a second, so a fork ends before
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import gc
import importlib
import json
import os
import re
import resource
import runpy
import socket
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Mapping, Sequence, Set
from pathlib import Path
from typing import Any, NamedTuple

from flowsculpt.render.base.python_process import PACKAGE_ROOT, SAFE_PATH, ForkedProcess, prepare

AT_START = "FLOWSCULPT_TESTS_AT_START"
"""A variable of the environment that names a file of Python, which a forked command runs first."""

HARMLESS = {
    AT_START,
    *("DRJIT_LIBLLVM_PATH", "NUMBA_DISABLE_INTEL_SVML", "OMP_WAIT_POLICY", "OpenImageIO_ROOT"),
    *("FLOWSCULPT_CACHE_WARNED", "FLOWSCULPT_PROCESS", "FLOWSCULPT_STORE", "FLOWSCULPT_STORE_READ_ONLY"),
    *("AWS_ACCESS_KEY_ID", "AWS_DEFAULT_REGION", "AWS_ENDPOINT_URL", "AWS_SECRET_ACCESS_KEY"),
    *("PYTEST_CURRENT_TEST", SAFE_PATH),
}
"""Variables that libraries, our code and tests set in a process, and that do not change what is loaded."""

OF_PLUGINS = {"COLUMNS", "PYTHONDONTWRITEBYTECODE", "PYTHONPATH"}
"""Variables that tests of plug-ins set, by which nothing of what LIBRARIES has loaded differs."""

FORKED = re.compile(r"flowsculpt(\.[a-z_.]+)?|snakemake")
"""Modules whose processes are forked."""

READERS = re.compile(r"flowsculpt\.pipeline\.plugins\.interchange\.\w+")
"""Modules of processes that read files of other programs."""

MESSAGE_BYTES = 1 << 17

SUBREAPER = 36
"""PR_SET_CHILD_SUBREAPER. Source: https://man7.org/linux/man-pages/man2/PR_SET_CHILD_SUBREAPER.2const.html"""

PLAIN = (None, 0, False, True, None, None, None, -1, False)
"""Arguments of `Popen._execute_child` that a fork has, beside those that `ForkingPopen` names: startupinfo,
creationflags, shell, restore_signals, gid, gids, uid, umask and start_new_session."""

PYTHON = sys.executable  # a test may name another one

LIMITS = [name for name in dir(resource) if name.startswith("RLIMIT_")]


class Command(NamedTuple):
    """What a process runs: a module and its words, with `-P` or without, in a folder and an environment."""

    module: str
    words: list[str]
    is_safe: bool
    folder: str
    environment: dict[str, str]


def _command(args: Any, cwd: Any, env: Mapping[str, str] | None) -> Command | None:
    """Return the command that arguments of `subprocess.Popen` name, if it is one of FORKED."""
    environment = dict(os.environ if env is None else env)
    match [*map(os.fspath, args)] if isinstance(args, list) else []:
        case [program, "-P", "-m", module, *words] | [program, "-m", module, *words] if program == PYTHON:
            is_safe = args[1] == "-P" or SAFE_PATH in environment
            if FORKED.fullmatch(module):
                return Command(module, words, is_safe, str(Path(cwd or ".").absolute()), environment)
    return None


def _state(environment: Mapping[str, str], ignored: Set[str]) -> tuple[object, ...]:
    """Return what may decide what a process that this one starts with an environment loads and does."""
    deciding = {name: value for name, value in environment.items() if name not in HARMLESS | ignored}
    named = deciding.pop("PYTHONPATH", "").split(os.pathsep)
    limits = [resource.getrlimit(getattr(resource, name)) for name in LIMITS]
    return deciding, {*named} - {"", str(PACKAGE_ROOT)}, limits, os.sched_getaffinity(0)


class CommandServer:
    """The process that forks commands. It starts with the first command, and ends with this process.

    loads    what it has loaded: a name of LOADS
    ignored  variables by which nothing of that differs
    forks    how many it has forked
    is_on    false where no command is forked, as before `begin`
    """

    def __init__(self, loads: str, ignored: Set[str] = frozenset()) -> None:
        self.loads = loads
        self.ignored = ignored
        self.forks = 0
        self.is_on = False
        self._owner = os.getpid()
        self._state: tuple[object, ...] = ()
        self._connection: socket.socket | None = None
        self._turn = threading.Lock()

    def begin(self) -> None:
        """Fork commands from now on, under Linux: those that are started as this process is now."""
        if sys.platform == "linux":
            self.is_on, self._state = True, self._state or _state(os.environ, self.ignored)
            subprocess.Popen = ForkingPopen  # type: ignore[misc]

    def takes(self, command: Command) -> bool:
        """Tell whether a process that this one starts for a command would load what the server has.

        A fork of this process forks none, for it would not be the parent of what the server forks.
        """
        is_ours = self.is_on and os.getpid() == self._owner and Path(command.folder).is_dir()
        return is_ours and _state(command.environment, self.ignored) == self._state

    def fork(self, command: Command, files: Sequence[int]) -> int:
        """Fork a child of this process for a command, with files as its first three; return its number."""
        with self._turn:
            if self._connection is None:
                self._connection = self._start()
            _take_orphans(True)
            try:
                socket.send_fds(self._connection, [json.dumps(command).encode()], files)
                answer = self._connection.recv(32)
            finally:
                _take_orphans(False)
            assert answer, "the process that forks commands has ended"
            self.forks += 1
            return int(answer)

    def _start(self) -> socket.socket:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-P", __file__, str(theirs.fileno()), self.loads],
                cwd="/",
                env={
                    name: value for name, value in os.environ.items() if name not in HARMLESS | self.ignored
                },
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
            )
        atexit.register(process.wait)
        atexit.register(ours.close)
        return ours


COMMANDS = CommandServer("commands", {"COLUMNS"})

LIBRARIES = CommandServer("libraries", OF_PLUGINS)
"""Forks commands that may find other plug-ins than this process, while `forks_with_plugins` has it on."""


class ForkingPopen(subprocess.Popen[Any]):
    """A `subprocess.Popen` that has COMMANDS or LIBRARIES fork what they can."""

    def _execute_child(
        self, args: Any, executable: Any, preexec_fn: Any, close_fds: Any, pass_fds: Any, *rest: Any
    ) -> None:
        cwd, env, pipes, options, group = *rest[:2], rest[5:11], (*rest[2:5], *rest[11:-1]), rest[-1]
        is_plain = (executable, preexec_fn, close_fds, pass_fds, options) == (None, None, True, (), PLAIN)
        command = _command(args, cwd, env) if is_plain else None
        servers = [server for server in (COMMANDS, LIBRARIES) if command and server.takes(command)]
        if command is None or not servers:
            super()._execute_child(args, executable, preexec_fn, close_fds, pass_fds, *rest)  # type: ignore[misc]
            return
        sys.audit("subprocess.Popen", args[0], args, cwd, env)
        files = [own if pipe == -1 else pipe for own, pipe in enumerate((pipes[0], pipes[3], pipes[5]))]
        self.pid = servers[0].fork(command, files)
        if group >= 0:
            os.setpgid(self.pid, group)
        self._child_created = True
        self._close_pipe_fds(*pipes)  # type: ignore[attr-defined]


def _take_orphans(is_wanted: bool) -> None:
    """Have processes whose parent has ended become children of this one, or no longer."""
    ctypes.CDLL(None).prctl(SUBREAPER, int(is_wanted))


def _serve(connection: socket.socket) -> Command | None:
    """Fork a process for each command that comes; in it, return the command. Returns None at the end."""
    while True:
        message, files, *_ = socket.recv_fds(connection, MESSAGE_BYTES, 3)
        if not message:
            return None
        _load_reader(json.loads(message)[0])
        number = _fork()
        if number == 0:
            connection.close()
            for own, file in enumerate(files):
                os.dup2(file, own)
        for file in files:
            os.close(file)
        if number == 0:
            return Command(*json.loads(message))
        connection.send(str(number).encode())


def _fork() -> int:
    """Fork a process that becomes a child of the one that takes orphans; return its number, in it 0."""
    reading, writing = os.pipe()
    with os.fdopen(reading, "rb", buffering=0) as answer, os.fdopen(writing, "wb", buffering=0) as asked:
        if (between := os.fork()) == 0:
            parent = os.getpid()
            if number := os.fork():
                asked.write(str(number).encode())
                os._exit(0)
            while os.getppid() == parent:
                time.sleep(0.001)
            return 0
        os.waitpid(between, 0)
        return int(answer.read(32))


def _run(command: Command, loaded: dict[str, str]) -> None:
    """Run a command in this process, as Python does, with variables that loading has set; end the process."""
    os.chdir(command.folder)
    os.environ.clear()
    os.environ.update(loaded | command.environment)
    if not command.is_safe:
        sys.path.insert(0, command.folder)
    named = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    sys.path[:0] = [entry for entry in named if entry and entry not in sys.path]
    sys.dont_write_bytecode = "PYTHONDONTWRITEBYTECODE" in os.environ
    sys.argv = [command.module, *command.words]
    warnings.filterwarnings("ignore", ".* found in sys.modules", RuntimeWarning)  # as what was loaded is
    code = 0
    if AT_START in os.environ:
        runpy.run_path(os.environ[AT_START])
    try:
        runpy.run_module(command.module, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        if end.code is not None and not isinstance(end.code, int):
            print(end.code, file=sys.stderr)
            end.code = 1
        code = end.code or 0
    except BaseException:
        gc.unfreeze()  # libraries report what is never collected
        raise
    threading._shutdown()  # type: ignore[attr-defined]  # waits for threads
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code & 0xFF)


def _load_reader(module: str) -> None:
    """Load a module that reads files of other programs, and USD before it reads that."""
    if READERS.fullmatch(module):
        with contextlib.suppress(ImportError):  # the process itself says what is missing
            importlib.import_module(module)
            if "usd" in module:
                os.environ["PXR_WORK_THREAD_LIMIT"] = "1"  # as `load_usd` sets it
                from flowsculpt.pipeline.plugins.interchange import usd_paint, usd_samples  # noqa: F401


def _load_commands() -> None:
    """Load what commands load."""
    import smart_open  # noqa: F401  # Snakemake reads the Snakefile with it
    import snakemake.cli  # noqa: F401

    from flowsculpt.pipeline.cli import commands, render_commands  # noqa: F401
    from flowsculpt.pipeline.production.tasks import worker_pool

    worker_pool.load_what_jobs_need()


def _load_libraries() -> None:
    """Load libraries, and of flowsculpt what looks for no plug-ins."""
    prepare()  # before numba is imported
    import pydantic  # noqa: F401
    import rich.progress  # noqa: F401
    import ruamel.yaml  # noqa: F401
    import smart_open  # noqa: F401  # Snakemake reads the Snakefile with it
    import snakemake.cli  # noqa: F401
    import typer.main  # noqa: F401
    from numba.core.registry import cpu_target

    from flowsculpt.pipeline import flow, mesh  # noqa: F401
    from flowsculpt.pipeline.animation import frame  # noqa: F401
    from flowsculpt.pipeline.plugin import plugins
    from flowsculpt.render.movie import encode  # noqa: F401
    from flowsculpt.render.post import image  # noqa: F401
    from flowsculpt.render.scene.materials import models  # noqa: F401

    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
    prepare.cache_clear()  # each command has a search path of its own
    gc.collect()
    gc.freeze()
    assert not plugins.cache_info().currsize, "what is loaded has looked for plug-ins"


LOADS: dict[str, Callable[[], None]] = {"commands": _load_commands, "libraries": _load_libraries}
"""What a server can load. None may start a thread, which no fork would have."""


def _load(name: str) -> None:
    """Load what a server has; make sure that it can be forked."""
    LOADS[name]()
    from numba.np.ufunc import parallel  # where libgomp ends each fork of a process that has its threads

    assert not parallel._is_initialized and ForkedProcess.may_start(), "what is loaded has started threads"


if __name__ == "__main__":
    before = dict(os.environ)
    _load(sys.argv[2])
    changed = {name: value for name, value in os.environ.items() if before.get(name) != value}
    command = _serve(socket.socket(fileno=int(sys.argv[1])))
    if command is None:
        os._exit(0)  # without looking for what was never freed
    _run(command, changed)
