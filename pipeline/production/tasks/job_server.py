"""The job server: a process that has imported what jobs need, and forks a process for each.

Python, numba, the registries of compiled kernels and the documents of shot files take 1.2 seconds of CPU time
to load, longer than many a job works. The server has what `flowsculpt` has loaded, and loads the rest. Jobs
remain processes of their own: one that crashes, hangs or is killed takes no other along.

Only on Linux, where forking a process that has loaded libraries is sound, and only on this machine. The
server has one thread; it loads neither Mitsuba nor the denoiser, which start threads, nor does it run a
kernel.
"""

from __future__ import annotations

import gc
import json
import os
import shutil
import signal
import socket
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import connection as connections
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import NoReturn

from flowsculpt.pipeline.production.tasks.job_process import NUMBER, SERVER
from flowsculpt.render.base.python_process import ENDING

REQUEST_BYTES = 65536
"""The longest request: the words of a job, which a command line has to hold too."""

SMALLEST_SHOT = "{title: A, frames: 1-2, subject: {solid: sheet}, resample: {max_edge_length: 1}, flows: []}"


@contextmanager
def job_server() -> Iterator[None]:
    """Have the jobs that this process starts forked by a server, where there can be one."""
    opened = _listener() if sys.platform == "linux" else None
    if opened is None:
        yield
        return
    folder, listener = opened
    os.environ[SERVER] = str(folder / "socket")  # a job that renders starts a process that does
    lifeline, ours = os.pipe()
    process = os.fork()
    if process == 0:
        os.close(ours)
        _serve(listener, lifeline, folder)
    listener.close()
    os.close(lifeline)
    try:
        yield
    finally:
        os.close(ours)
        os.waitpid(process, 0)


def _listener() -> tuple[Path, socket.socket] | None:
    """Return a folder of this user's alone and a listening socket in it, or None where there can be none.

    The path of a socket has 107 bytes at most, and some clusters have longer temporary folders.
    """
    for place in (None, "/tmp", "/dev/shm"):
        with ExitStack() as made, suppress(OSError):
            folder = Path(tempfile.mkdtemp(prefix="flowsculpt-jobs-", dir=place))
            made.callback(shutil.rmtree, folder, ignore_errors=True)
            listener = made.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
            listener.bind(str(folder / "socket"))
            listener.listen(128)
            made.pop_all()
            return folder, listener
    return None


def _serve(listener: socket.socket, lifeline: int, folder: Path) -> NoReturn:
    """Fork processes for jobs until no more can come and the last has ended."""
    code = 1
    try:
        for number in ENDING:  # they end jobs, one after the other, and with the last of them the server
            signal.signal(number, signal.SIG_IGN)
        _load_what_jobs_need()
        _Server(listener, lifeline).run()
        code = 0
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(code)


def _load_what_jobs_need() -> None:
    """Import the modules of all stages, and build what they build when first used; start no thread."""
    gc.disable()  # little of what is imported is ever freed
    import portalocker  # noqa: F401  # for the locks of jobs
    from numba.core.registry import cpu_target

    from flowsculpt.pipeline.production.stages import STAGES
    from flowsculpt.pipeline.production.store.remote_store import remote_stores, store_url
    from flowsculpt.pipeline.production.tasks.worker import task_of
    from flowsculpt.pipeline.shot import read_shot

    for stage in STAGES:
        task_of(stage)
    if url := store_url():
        remote_stores().load(url)
    read_shot("smallest.yaml", text=SMALLEST_SHOT)  # builds what validates the documents of shots
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
    gc.freeze()  # a collection would write to, and so copy, every page that jobs share
    gc.enable()


@dataclass
class _Server:
    """Forks a process for each connection that asks for one. Nothing that a connection does ends the others.

    lifeline  a pipe that is closed where the process goes that has started this one
    """

    listener: socket.socket
    lifeline: int
    _silent: set[socket.socket] = field(default_factory=set)
    _jobs: dict[socket.socket, BaseProcess] = field(default_factory=dict)

    def run(self) -> None:
        """Fork, and tell who asked how the forked process ended, until the lifeline is closed."""
        is_open = True
        while is_open or self._jobs:
            doors: list[socket.socket | int] = [self.listener, self.lifeline] if is_open else []
            sentinels = {process.sentinel: asking for asking, process in self._jobs.items()}
            for ready in connections.wait([*doors, *self._silent, *sentinels, *self._jobs]):
                if ready == self.lifeline:
                    is_open = False
                elif ready is self.listener:
                    with suppress(OSError):  # it has gone before it was accepted
                        self._silent.add(self.listener.accept()[0])
                elif ready in self._silent:
                    self._silent.remove(ready)
                    self._fork(ready)
                elif isinstance(ready, int):
                    self._end(sentinels[ready])
                elif ready in self._jobs:
                    self._pass_on(ready)

    def _fork(self, asking: socket.socket) -> None:
        """Fork a process for the job that is asked for, and answer with its id; hang up on anything else."""
        outputs: list[int] = []
        try:
            request, outputs, _, _ = socket.recv_fds(asking, REQUEST_BYTES, 2)
            words, folder, number = _parts_of(request)
            out, err = outputs
            process = get_context("fork").Process(target=_work, args=(out, err, words, folder, number))
            process.start()
        except (OSError, ValueError):  # the process that asks then does the job itself
            asking.close()
        else:
            self._jobs[asking] = process
            with suppress(OSError):  # it has gone, which the next wait sees
                asking.send(NUMBER.pack(process.pid))
        finally:
            for output in outputs:
                os.close(output)

    def _pass_on(self, asking: socket.socket) -> None:
        """Send the process of a job the signal that came for it; end it where who asked was killed.

        This process alone waits for that one, so its number is not given again before `_end`.
        """
        process, message = self._jobs[asking], b""
        with suppress(OSError):
            message = asking.recv(NUMBER.size)
        if len(message) == NUMBER.size and process.pid is not None:
            with suppress(OSError, ValueError):
                os.kill(process.pid, NUMBER.unpack(message)[0])
        else:
            process.kill()
            self._end(asking)

    def _end(self, asking: socket.socket) -> None:
        """Tell who asked how the process of its job ended."""
        process = self._jobs.pop(asking)
        process.join()
        with asking, suppress(OSError):
            asking.send(NUMBER.pack(process.exitcode))


def _parts_of(request: bytes) -> tuple[list[str], str, int]:
    """Return the words of a job, its folder and the number of the process that asks. Raises ValueError."""
    try:
        parts = json.loads(request)
        return [str(word) for word in parts["words"]], str(parts["folder"]), int(parts["process"])
    except (KeyError, TypeError, RecursionError) as error:
        raise ValueError("not a request") from error


def _work(out: int, err: int, words: list[str], folder: str, process: int) -> NoReturn:
    """Do a job in this process, which was forked for it.

    out, err  standard output and error of the process that stands for this one
    words     its arguments
    folder    its working folder
    process   its id
    """
    from flowsculpt.pipeline.production.tasks.worker import run

    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in set(ENDING) - {signal.SIGINT}:
        signal.signal(number, signal.SIG_DFL)
    os.dup2(out, 1)
    os.dup2(err, 2)
    os.chdir(folder)
    sys.exit(run(words, process))
