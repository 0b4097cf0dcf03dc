"""Run parsers that are not ours in a process of their own, with limited memory and time.

Libraries that decode pictures, sound and scenes may crash, hang or fill the memory on a damaged file. With
limits, a process of its own takes the damage, and the caller gets an error. It costs the time to import the
library, or hundredths of a second where it can be forked from a process that has it.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import select
import signal
import subprocess
import sys
import time
import warnings
import weakref
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import BinaryIO, ClassVar

from flowsculpt.render.base import python_process
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.render_errors import MachineError, reason_of
from flowsculpt.render.base.user_cache import CachedAnswer

SECONDS = 60.0
"""Time that a parser may take for any file; a MiB of it adds a second."""

_PARSED, _REFUSED = b"parsed\n", b"refused\n"


class ParserError(ValueError):
    """The reason why a file cannot be parsed, in one line."""


@dataclass(frozen=True)
class Parser:
    """A module that reads files of others in a process of its own; run as a program it calls `Parser.serve`.

    module  its dotted name
    MEMORY  bytes that it may take beside what its process has at the start; see `allow_memory`
    """

    module: str

    MEMORY: ClassVar[int] = 1 << 30

    def answer(self, path: Path, *options: str) -> bytes:
        """Return what the module answers about the path of a file, and options.

        Raises ParserError, a ValueError, where it refuses, crashes, or takes too long or too much memory;
        MachineError where no process can be started.
        """
        seconds = SECONDS + InputFile(path).size() / 2**20
        try:
            done = subprocess.run(
                python_process.python_command(self.module),
                input=json.dumps([seconds, str(path.absolute()), *options]).encode(),
                env=python_process.environment(),
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                timeout=seconds,
            )
        except subprocess.TimeoutExpired:
            raise ParserError(f"its reader took over {seconds:.0f} seconds") from None
        except OSError as error:
            raise MachineError(f"no process can be started to read a file ({error.strerror})") from None
        return _parse(done.stdout, done.returncode)

    def answer_about_content(self, path: Path, digest: str, library: str, *options: str) -> str:
        """Return what the module answers about the path of a file; the disk cache stores it by content.

        digest   of the file's content
        library  the package that reads it; another version is asked again
        options  further arguments of the module

        Raises as `answer`.
        """
        known = CachedAnswer.of("parsed", [self.module, library, version(library), digest, *options])
        stored = known.load(lambda it: it["answer"])
        if isinstance(stored, str):
            return stored
        answer = self.answer(path, *options).decode()
        known.store({"answer": answer})
        return answer

    @staticmethod
    def answer_of_fork(answer: Callable[..., bytes], path: Path, *options: str) -> bytes:
        """Return what a function answers in a fork of this process, which has loaded what it needs.

        The function takes no locks that another thread of this process may hold: it only computes, and does
        not print or import. Systems that cannot fork start a new process of its module instead. Raises what
        `answer` raises.
        """
        seconds = SECONDS + InputFile(path).size() / 2**20
        if sys.platform != "linux" or multiprocessing.current_process().daemon:
            return Parser(answer.__module__).answer(path, *options)
        reading, writing = os.pipe()
        nowhere = os.open(os.devnull, os.O_WRONLY)

        def work() -> None:
            _write_answer(answer, os.fdopen(writing, "wb"), seconds, str(path), *options)

        with warnings.catch_warnings(action="ignore", category=DeprecationWarning):  # of forks with threads
            process = python_process.ForkedProcess(work, nowhere)
        os.close(writing)
        os.close(nowhere)
        try:
            content = _content(reading, seconds)
        except BaseException:
            process.send_signal(signal.SIGKILL)
            process.wait()
            raise
        finally:
            os.close(reading)
        return _parse(content, process.wait())

    def session(self, path: Path, *options: str) -> ParserSession:
        """Start a process that answers questions about a file, by `serve_session`. Raises MachineError."""
        return ParserSession(self.module, path, *options)

    @staticmethod
    def serve_session(begin: Callable[..., Callable[[str], bytes]]) -> None:
        """Answer questions on stdin, within limits, until it ends: a line of JSON each.

        begin  takes the path and the options of the session, and returns what answers a question
        """
        output = os.fdopen(os.dup(1), "wb")
        os.dup2(2, 1)
        seconds, path, *options = json.loads(sys.stdin.buffer.readline())
        _limit()
        answer: Callable[[str], bytes] | None = None
        for line in sys.stdin.buffer:
            Parser.allow_seconds(4 * seconds)
            try:
                if answer is None:
                    answer = begin(path, *options)
                result = _PARSED + answer(json.loads(line))
            except Exception as error:  # as in `serve`
                result = _refusal(error)
            output.write(len(result).to_bytes(8, "little") + result)
            output.flush()
        os._exit(0)

    @staticmethod
    def serve(answer: Callable[..., bytes]) -> None:
        """Answer about the path, and options, on stdin within limits. What libraries print goes to stderr."""
        output = os.fdopen(os.dup(1), "wb")
        os.dup2(2, 1)
        _write_answer(answer, output, *json.loads(sys.stdin.buffer.read()))

    @staticmethod
    def allow_memory(count: int) -> None:
        """Set the bytes that this process may take in addition to what it has now."""
        with suppress(ImportError, OSError, ValueError):  # systems differ in what they can limit
            import resource

            page = resource.getpagesize()
            used = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[0]) * page
            resource.setrlimit(resource.RLIMIT_AS, (used + count, resource.RLIM_INFINITY))

    @staticmethod
    def allow_seconds(count: float) -> None:
        """Set the seconds of a core that this process may take in addition to what it has taken."""
        with suppress(ImportError, OSError, ValueError):
            import resource

            _, most = resource.getrlimit(resource.RLIMIT_CPU)
            resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + count), most))


class ParserSession:
    """A process that answers one question after another about a file; `close` ends it.

    It ends by itself when nothing refers to it, and when this process has ended. A process that was forked
    from this one starts one of its own, for answers would go to either.
    """

    def __init__(self, module: str, path: Path, *options: str) -> None:
        self._seconds = SECONDS + InputFile(path).size() / 2**20
        self._start = module, json.dumps([self._seconds, str(path.absolute()), *options]) + "\n"
        self._begin()

    def _begin(self) -> None:
        module, self._opening = self._start
        try:
            self._process = subprocess.Popen(
                python_process.python_command(module),
                env=python_process.environment(),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
        except OSError as error:
            raise MachineError(f"no process can be started to read a file ({error.strerror})") from None
        self._owner = os.getpid()
        self._end = weakref.finalize(self, _end_process, self._process, self._owner)

    def ask(self, question: str) -> bytes:
        """Return the answer to a question. Raises as `Parser.answer`; the process has ended then."""
        if os.getpid() != self._owner:
            self._end()  # closes the pipes
            self._begin()
        assert self._process.stdin is not None and self._process.stdout is not None
        words, self._opening = self._opening + json.dumps(question) + "\n", ""
        try:
            with suppress(BrokenPipeError):
                self._process.stdin.write(words.encode())
                self._process.stdin.flush()
            end, pipe = time.monotonic() + self._seconds, self._process.stdout.fileno()
            count = int.from_bytes(_bytes_of(pipe, 8, end, self._seconds), "little")
            return _parse(_bytes_of(pipe, count, end, self._seconds), self._process.poll() or 0)
        except _EarlyEndError:
            code = self._process.wait()
            self.close()
            return _parse(b"", code)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the process."""
        self._end()


def _end_process(process: subprocess.Popen[bytes], owner: int) -> None:
    if os.getpid() == owner:
        process.kill()
        process.wait()
    else:
        process.poll()  # that it is not a child of this process ends it here
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):
            if pipe is not None:
                pipe.close()


class _EarlyEndError(Exception):
    """A process ended before its answer did."""


def _bytes_of(pipe: int, count: int, end: float, seconds: float) -> bytes:
    """Return so many bytes of a pipe. Raises ParserError where that takes longer than to the time `end`."""
    content, at, waiting = bytearray(count), 0, select.poll()
    waiting.register(pipe, select.POLLIN)
    while at < count:
        if not waiting.poll(max(1000.0 * (end - time.monotonic()), 0.0)):
            raise ParserError(f"its reader took over {seconds:.0f} seconds")
        part = os.read(pipe, min(count - at, 1 << 20))
        if not part:
            raise _EarlyEndError
        content[at : at + len(part)] = part
        at += len(part)
    return bytes(content)


def _parse(output: bytes, code: int) -> bytes:
    """Return the answer in what a process wrote. Raises ParserError where there is none."""
    if output.startswith(_PARSED) and code == 0:
        return output.removeprefix(_PARSED)
    if output.startswith(_REFUSED):
        raise ParserError(output.removeprefix(_REFUSED).decode("utf-8", "replace"))
    is_late = code == -getattr(signal, "SIGXCPU", 0) != 0
    raise ParserError("its reader took too long" if is_late else "its reader crashed or ran out of memory")


def _content(pipe: int, seconds: float) -> bytes:
    """Return what comes out of a pipe until its end. Raises ParserError where that takes longer."""
    end, parts, waiting = time.monotonic() + seconds, [], select.poll()
    waiting.register(pipe, select.POLLIN)
    while waiting.poll(max(1000.0 * (end - time.monotonic()), 0.0)):
        parts.append(os.read(pipe, 1 << 20))
        if not parts[-1]:
            return b"".join(parts)
    raise ParserError(f"its reader took over {seconds:.0f} seconds")


def _write_answer(
    answer: Callable[..., bytes], output: BinaryIO, seconds: float, path: str, *options: str
) -> None:
    """Write the answer about a path, or why there is none, and end this process."""
    _limit()
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (int(4 * seconds), int(4 * seconds)))
    try:
        result = _PARSED + answer(path, *options)
    except Exception as error:  # parsers raise anything
        result = _refusal(error)
    output.write(result)
    output.flush()
    os._exit(0)  # destructors of a library that met a damaged file may crash


def _refusal(error: Exception) -> bytes:
    """Return the answer that says why there is none; C++ lacks memory in its own words."""
    is_full = isinstance(error, MemoryError) or "bad_alloc" in str(error)
    return _REFUSED + (b"its reader needed too much memory" if is_full else reason_of(error).encode())


def _limit() -> None:
    """Limit the memory of this process, and let it write no file."""
    Parser.allow_memory(Parser.MEMORY)
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
