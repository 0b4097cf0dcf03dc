"""Run code of others, such as plug-ins, which may print, raise and change anything."""

from __future__ import annotations

import locale
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from importlib import import_module
from pathlib import Path


class ForeignError(Exception):
    """Code of others has raised what is not an Exception, such as SystemExit."""


@contextmanager
def foreign_code() -> Iterator[None]:
    """Let code of others run; the working folder, the locale and the filters of warnings stay as they are.

    What it prints goes to standard error, since standard output may be JSON. What it raises is an Exception,
    or the user's Ctrl-C.
    """
    folder, language = Path.cwd(), locale.setlocale(locale.LC_ALL)
    try:
        with redirect_stdout(sys.stderr), warnings.catch_warnings():
            yield
    except BaseException as error:
        if isinstance(error, Exception) or is_of_user(error):
            raise
        raise ForeignError(located_reason(error)) from error
    finally:
        os.chdir(folder)
        locale.setlocale(locale.LC_ALL, language)


def is_of_user(error: BaseException) -> bool:
    """Tell whether an error is Ctrl-C, and not a KeyboardInterrupt that code of others raises.

    Once a user has pressed Ctrl-C, our handlers are gone: signals are ignored.
    """
    handlers = {signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)}
    return isinstance(error, KeyboardInterrupt) and bool(
        handlers & {signal.SIG_IGN, signal.default_int_handler}
    )


def located_reason(error: BaseException) -> str:
    """Return what code of others raised, in one line, with the line of it that did."""
    if isinstance(error, ForeignError):
        return str(error)
    reason = reason_of_foreign(error)
    lines = [(Path(frame.filename), frame.lineno) for frame in traceback.extract_tb(error.__traceback__)]
    theirs = [
        (path, line)
        for path, line in lines
        if path.is_file() and not any(path.is_relative_to(folder) for folder in _OURS)
    ]
    if not theirs:
        return reason
    home = theirs[0][0].parent  # what it calls, such as numpy, is elsewhere
    path, line = [each for each in theirs if each[0].parent == home][-1]
    return f"{reason} ({path}:{line})"


_OURS = [
    *(Path(__file__).resolve().parents[2] / name for name in ("flowsculpt", "pipeline", "render")),
    Path(import_module.__code__.co_filename).parent,
]
"""Folders of modules that call code of others, or that it calls: ours, and what imports modules."""

_NUMBA_LINES = ("Failed in nopython mode", "During: ")  # around what is wrong


def _home_of(name: str) -> str:
    """Return where plug-ins find a name that they look for elsewhere in the public API, in words."""
    library = Path(import_module("flowsculpt").__file__ or "").parent
    for stub in (library / "__init__.pyi", *sorted((library / "api").glob("*.pyi"))):
        if f" as {name}\n" in stub.read_text("utf-8"):
            module = ".".join(stub.relative_to(library.parent).with_suffix("").parts)
            return f"it is in {module.removesuffix('.__init__')}"
    return "a later flowsculpt may have it"


def reason_of_foreign(error: BaseException) -> str:
    """Return what code of others raised, in one line."""
    try:
        text = str(error)
    except Exception:
        text = "its text cannot be written"
    lines = [line for line in text.splitlines() if not line.startswith(_NUMBA_LINES)]
    line = " ".join(f"{type(error).__name__}: {' '.join(lines)}".split()).removesuffix(":")
    absent = error.name if isinstance(error, ImportError) else None
    if absent in ("pipeline", "render"):
        return f"{line}; since flowsculpt 0.2.0 it is flowsculpt.{absent}, and for plug-ins flowsculpt.api"
    if absent and absent.startswith("flowsculpt.api"):
        name = line.partition("name '")[2].partition("'")[0]
        return f"{line}; {_home_of(name)}"
    return line
