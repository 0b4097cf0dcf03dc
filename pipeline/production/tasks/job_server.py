"""The job server: a process that has imported what jobs need, and forks a process for each.

Python, numba, the registries of compiled kernels and the documents of shot files take 1.2 seconds of CPU time
to load, longer than many a job works. Jobs remain processes of their own: one that crashes, hangs or is
killed takes no other along.

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
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import connection as connections
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import NoReturn

from pipeline.production.tasks.job_process import NUMBER, SERVER

REQUEST_BYTES = 65536
"""The longest request: the words of a job, which a command line has to hold too."""

SMALLEST_SHOT = "{title: A, frames: 1-2, subject: {solid: sheet}, resample: {max_edge_length: 1}, flows: []}"

IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end jobs, one after the other, and with the last of them the server."""


@contextmanager
def job_server() -> Iterator[None]:
    """Have the jobs that this process starts forked by a server, where there can be one."""
    if sys.platform != "linux":
        yield
        return
    folder = Path(tempfile.mkdtemp(prefix="flowsculpt-jobs-"))
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(str(folder / "socket"))
    listener.listen(128)
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


def _serve(listener: socket.socket, lifeline: int, folder: Path) -> NoReturn:
    """Be the server, until no more jobs can come and the last has ended."""
    code = 1
    try:
        for number in IGNORED:
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
    from numba.core.registry import cpu_target

    from pipeline.production.stages import STAGES
    from pipeline.production.store.remote_url import load_package, store_url
    from pipeline.production.tasks.worker import task_of
    from pipeline.shot import read_shot

    for stage in STAGES:
        task_of(stage)
    if url := store_url():
        load_package(url)
    read_shot("smallest.yaml", text=SMALLEST_SHOT)  # builds what validates the documents of shots
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
    gc.freeze()  # a collection would write to, and so copy, every page that jobs share
    gc.enable()


@dataclass
class _Server:
    """Forks a process for each connection.

    lifeline  a pipe that is closed where the process goes that has started this one
    """

    listener: socket.socket
    lifeline: int
    _jobs: dict[socket.socket, BaseProcess] = field(default_factory=dict)

    def run(self) -> None:
        """Fork, and tell who asked how the forked process ended, until the lifeline is closed."""
        is_open = True
        while is_open or self._jobs:
            doors: list[socket.socket | int] = [self.listener, self.lifeline] if is_open else []
            sentinels = {process.sentinel: asking for asking, process in self._jobs.items()}
            for ready in connections.wait([*doors, *sentinels, *self._jobs]):
                if ready == self.lifeline:
                    is_open = False
                elif ready is self.listener:
                    self._fork()
                elif isinstance(ready, int):
                    self._end(sentinels[ready])
                elif ready in self._jobs:  # who asked was killed; it says nothing else
                    self._jobs[ready].kill()
                    self._end(ready)

    def _fork(self) -> None:
        """Fork a process for the job that is asked for, and answer with its id."""
        asking, _ = self.listener.accept()
        with suppress(OSError):
            request, (out, err), _, _ = socket.recv_fds(asking, REQUEST_BYTES, 2)
            process = get_context("fork").Process(target=_work, args=(out, err), kwargs=json.loads(request))
            process.start()
            os.close(out)
            os.close(err)
            self._jobs[asking] = process
            asking.send(NUMBER.pack(process.pid))

    def _end(self, asking: socket.socket) -> None:
        """Tell who asked how the process of its job ended."""
        process = self._jobs.pop(asking)
        process.join()
        with asking, suppress(OSError):
            asking.send(NUMBER.pack(process.exitcode))


def _work(out: int, err: int, words: list[str], folder: str, process: int) -> NoReturn:
    """Do a job in this process, which was forked for it.

    out, err  standard output and error of the process that stands for this one
    words     its arguments
    folder    its working folder
    process   its id
    """
    from pipeline.production.tasks.worker import run

    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in set(IGNORED) - {signal.SIGINT}:
        signal.signal(number, signal.SIG_DFL)
    os.dup2(out, 1)
    os.dup2(err, 2)
    os.chdir(folder)
    sys.exit(run(words, process))
