"""The pool of workers: a process that has imported what jobs need, and forks a worker for each job.

Python, numba, the registries of compiled kernels and the documents of shot files take 1.2 seconds of CPU time
to load, longer than many a job works. The pool has what `flowsculpt` has loaded, and loads the rest. Jobs
remain processes of their own: one that crashes, hangs or is killed takes no other along.

Only on Linux, where forking a process that has loaded libraries is sound, and only on this machine. The pool
has one thread; it loads neither Mitsuba nor the denoiser, which start threads, nor does it run a kernel.
"""

from __future__ import annotations

import gc
import itertools
import json
import os
import signal
import socket
import struct
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing import connection as connections
from typing import NamedTuple

from flowsculpt.pipeline.production.tasks.worker_end import needs_another
from flowsculpt.render.base.python_process import ENDING, ForkedProcess, end_with_parent

REQUEST_BYTES = 65536
"""The longest request: the words of a job, which a command line has to hold too."""

ENDED = struct.Struct("<qi")
"""An answer of the pool: the number of a job, and its worker's exit code as `Popen.returncode` has it."""

PATIENCE = 5.0
"""Seconds that workers have to keep what they have done before they are killed."""

SMALLEST_SHOT = "{title: A, frames: 1-2, subject: {solid: sheet}, resample: {max_edge_length: 1}, flows: []}"


class WorkerPool:
    """The workers of this process; make it before this process starts a thread."""

    def __init__(self) -> None:
        self._connection, served = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._numbers = itertools.count()
        self._running: dict[int, Callable[[int], object]] = {}
        self._process = ForkedProcess(lambda: self._serve(served))
        served.close()

    def _serve(self, connection: socket.socket) -> None:
        self._connection.close()
        for number in ENDING:  # they end jobs, one after the other, and with the last of them the pool
            if signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, lambda *_: None)
        load_what_jobs_need()
        _Pool(connection).run()

    def start(self) -> None:
        """Call from now on, from a thread, what was given to `submit`."""
        threading.Thread(target=self._report, daemon=True).start()

    def submit(self, words: Sequence[str], ended: Callable[[int], object]) -> None:
        """Have a worker do the job that words name, as those of `worker`; call `ended` with its exit code."""
        number = next(self._numbers)
        self._running[number] = ended
        try:
            self._connection.send(json.dumps([number, *words]).encode())
        except OSError:  # the pool was killed
            self._end(number, -signal.SIGKILL)

    def close(self) -> None:
        """End the workers, which keep what they have done, and wait for the pool."""
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_WR)
        self._process.wait()

    def _report(self) -> None:
        while answer := self._connection.recv(ENDED.size):
            self._end(*ENDED.unpack(answer))
        for number in list(self._running):  # the pool has ended, and with it its workers
            self._end(number, -signal.SIGKILL)

    def _end(self, number: int, code: int) -> None:
        if ended := self._running.pop(number, None):
            ended(code)


def load_what_jobs_need() -> None:
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


class _Worker(NamedTuple):
    """A process that works, the number and words of its job, and the exit code of the worker before it."""

    process: ForkedProcess
    number: int
    words: list[str]
    after: int


@dataclass
class _Pool:
    """Forks a worker for each request that comes, and answers when it has ended."""

    connection: socket.socket
    _workers: dict[int, _Worker] = field(default_factory=dict)
    """The workers, by what becomes ready when they end."""
    _is_open: bool = True

    def run(self) -> None:
        """Serve until the connection is closed, also as the process at its other end was killed."""
        while self._is_open:
            for ready in connections.wait([self.connection, *self._workers]):
                if isinstance(ready, int):
                    self._end(ready)
                elif request := self.connection.recv(REQUEST_BYTES):
                    number, *words = json.loads(request)
                    self._fork(number, words, 0)
                else:
                    self._is_open = False
        self._end_all()

    def _fork(self, number: int, words: list[str], after: int) -> None:
        """Fork a worker for a job, with the exit code of the one before it, 0 for the first."""
        pool = os.getpid()

        def work() -> int:
            from flowsculpt.pipeline.production.tasks.worker import run

            end_with_parent(pool)
            self.connection.close()
            return run([*words, "--after", str(after)])

        process = ForkedProcess(work)
        self._workers[process.sentinel] = _Worker(process, number, words, after)

    def _end(self, sentinel: int) -> None:
        """Fork another worker for the job of one that has ended, or report the end of the job."""
        worker = self._workers.pop(sentinel)
        code = worker.process.wait()
        if self._is_open and needs_another(code, worker.after):
            self._fork(worker.number, worker.words, code)
            return
        with suppress(OSError):  # nobody listens any more
            self.connection.send(ENDED.pack(worker.number, code))

    def _end_all(self) -> None:
        """Ask the workers to end, which keep what they have done, and kill those that do not."""
        limit = time.monotonic() + PATIENCE
        self._send_all(signal.SIGTERM)
        while self._workers and (left := limit - time.monotonic()) > 0.0:
            for sentinel in {*self._workers} & {*connections.wait([*self._workers], left)}:
                self._end(sentinel)
        self._send_all(signal.SIGKILL)
        for sentinel in list(self._workers):
            self._end(sentinel)

    def _send_all(self, signal_number: int) -> None:
        for worker in self._workers.values():
            worker.process.send_signal(signal_number)
