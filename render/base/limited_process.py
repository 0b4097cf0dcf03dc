"""Run parsers that are not ours in a process of their own, with limited memory and time.

Libraries that decode pictures, sound and scenes may crash, hang or fill the memory on a damaged file. With
limits, a process of its own takes the damage, and the caller gets an error. It costs the time to import the
library.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from render.base import python_process
from render.base.input_files import require_input
from render.base.render_errors import MachineError, reason_of
from render.base.user_cache import cache_path, load_answer, store_answer

SECONDS = 60.0
"""Time that a parser may take for any file; a MiB of it adds a second."""

MEMORY = 1 << 30
"""Memory that a parser may take beside what its process has at the start, bytes; see `allow_memory`."""

_PARSED, _REFUSED = b"parsed\n", b"refused\n"


class ParserError(Exception):
    """The reason why a file cannot be parsed, in one line."""


def answer_of(module: str, path: Path, *options: str) -> bytes:
    """Return what a module answers about the path of a file, and options; it calls `serve` where it is run.

    Raises ParserError where it refuses, crashes, or takes too long or too much memory; MachineError where
    no process can be started.
    """
    seconds = SECONDS + require_input(path) / 2**20
    try:
        done = subprocess.run(
            python_process.command(module),
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
    if done.stdout.startswith(_PARSED):
        return done.stdout.removeprefix(_PARSED)
    if done.stdout.startswith(_REFUSED):
        raise ParserError(done.stdout.removeprefix(_REFUSED).decode("utf-8", "replace"))
    raise ParserError("its reader crashed or ran out of memory")


def answer_about_content(module: str, path: Path, digest: str, library: str, *options: str) -> str:
    """Return what a module answers about the path of a file; the disk cache stores it by content.

    digest   of the file's content
    library  the package that reads it; another version is asked again
    options  further arguments of the module

    Raises as `answer_of`.
    """
    known = cache_path("parsed", [module, library, version(library), digest, *options])
    stored = load_answer(known)
    if stored is not None and isinstance(stored.get("answer"), str):
        return str(stored["answer"])
    answer = answer_of(module, path, *options).decode()
    store_answer(known, {"answer": answer})
    return answer


def serve(answer: Callable[..., bytes]) -> None:
    """Answer about the path, and options, on stdin within limits. What libraries print goes to stderr."""
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    seconds, path, *options = json.loads(sys.stdin.buffer.read())
    _limit(seconds)
    try:
        result = _PARSED + answer(path, *options)
    except MemoryError:
        result = _REFUSED + b"its reader needed too much memory"
    except Exception as error:  # parsers raise anything
        result = _REFUSED + reason_of(error).encode()
    output.write(result)
    output.flush()
    os._exit(0)  # destructors of a library that met a damaged file may crash


def allow_memory(count: int) -> None:
    """Set the bytes that this process may take in addition to what it has now."""
    with suppress(ImportError, OSError, ValueError):  # systems differ in what they can limit
        import resource

        used = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + count, resource.RLIM_INFINITY))


def _limit(seconds: float) -> None:
    """Limit memory and time of this process, and let it write no file."""
    allow_memory(MEMORY)
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (int(4 * seconds), int(4 * seconds)))
