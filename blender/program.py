# SPDX-License-Identifier: GPL-3.0-or-later
"""Run the program flowsculpt: find it, check its version, and follow its answers, which are lines of JSON."""

from __future__ import annotations

import json
import os
import queue
import shutil
import subprocess
import threading
import tomllib
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

Answer = dict[str, Any]

VERSION = tomllib.loads(Path(__file__).with_name("blender_manifest.toml").read_text(encoding="utf-8"))[
    "version"
]

SECONDS_TO_START = 60.0  # that the program may take to say its version, on a slow disk


class ProgramError(Exception):
    """What flowsculpt refuses, or why it cannot be run; one line for the artist.

    changed  whether the shot's file was changed by others in the meantime
    """

    def __init__(self, message: str, changed: bool = False) -> None:
        super().__init__(message)
        self.changed = changed


def find_program(path: str) -> str:
    """Return the path of flowsculpt: the one given, or for an empty text the one on PATH.

    Raises ProgramError where there is none, or one of another version.
    """
    found = shutil.which(path or "flowsculpt")
    if found is None:
        place = path or "flowsculpt on PATH"
        raise ProgramError(
            f"{place}: not found, or not a program. Install flowsculpt, or give its path in Edit > "
            "Preferences > Add-ons > Flowsculpt"
        )
    found = str(Path(found).absolute())  # it is run in another folder
    version = _version_of(found, Path(found).stat().st_mtime_ns)
    if version.split(".")[:2] != VERSION.split(".")[:2]:
        raise ProgramError(
            f"{found} is flowsculpt {version}, and this extension works with {VERSION}. Install the "
            "extension of that version, or give the path of another flowsculpt in its preferences"
        )
    return found


@lru_cache(maxsize=8)
def _version_of(found: str, changed: int) -> str:
    """Return the version that a program says; `changed` is when it was last written."""
    try:
        ran = subprocess.run(
            [found, "--version"], capture_output=True, env=_environment(), timeout=SECONDS_TO_START
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ProgramError(f"{found} does not start: {error}. Give the path of flowsculpt itself") from None
    name, _, version = ran.stdout.decode(errors="replace").strip().partition(" ")
    if name != "flowsculpt" or not version:
        raise ProgramError(f"{found} does not answer as flowsculpt does. Give the path of flowsculpt itself")
    return version


def _environment() -> dict[str, str]:
    """Return the environment without what is meant for Blender's own Python."""
    return {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}


class Run:
    """A run of flowsculpt in the background.

    words    the command and its options
    folder   the show, in which it runs
    request  what it reads from standard input, as JSON

    `progress` is the last step of its work that it has reported; `was_cancelled` is set by `cancel`, and
    `is_replaced` where another run does its work.
    """

    def __init__(
        self, program: str, words: Sequence[str], folder: Path, request: Answer | None = None
    ) -> None:
        self.words = list(words)
        self.progress: Answer | None = None
        self.is_replaced = False
        text = subprocess.PIPE
        try:
            self._process = subprocess.Popen(
                [program, *words], cwd=folder, env=_environment(), stdin=text, stdout=text, stderr=text
            )
        except OSError as error:
            raise ProgramError(f"{folder}: flowsculpt cannot be run there: {error.strerror}") from None
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._out: list[str] = []
        self._err: list[str] = []
        self.was_cancelled = False
        self._threads = [
            threading.Thread(target=work, daemon=True)
            for work in (lambda: self._send(request), self._read_out, self._read_err)
        ]
        for thread in self._threads:
            thread.start()

    def _send(self, request: Answer | None) -> None:
        assert self._process.stdin is not None, "it is a pipe"
        try:
            with self._process.stdin as pipe:
                pipe.write(json.dumps(request).encode() if request is not None else b"")
        except OSError:
            return  # it has ended, and says why

    def _read_out(self) -> None:
        for line in self._process.stdout or ():
            self._out.append(line.decode(errors="replace"))
            self._lines.put(self._out[-1])

    def _read_err(self) -> None:
        for line in self._process.stderr or ():
            self._err.append(line.decode(errors="replace"))

    @property
    def is_over(self) -> bool:
        """True once the program has ended and all that it said is read."""
        return self._process.poll() is not None and not any(thread.is_alive() for thread in self._threads)

    def new_steps(self) -> Iterator[Answer]:
        """Yield the steps of the work that were reported since the last call."""
        while not self._lines.empty():
            answer = _parsed(self._lines.get())
            if answer is not None and "stage" in answer:
                self.progress = answer
                yield answer

    def cancel(self, is_replaced: bool = False) -> None:
        """Have the program end; what it has made stays."""
        self.was_cancelled, self.is_replaced = True, is_replaced
        if self._process.poll() is None:
            self._process.terminate()

    def wait(self) -> Answer:
        """Wait for the end and return the last answer. Raises ProgramError."""
        for thread in self._threads:
            thread.join()
        self._process.wait()
        return self.result()

    def result(self) -> Answer:
        """Return the last answer of a run that is over. Raises ProgramError where it has failed.

        An answer that lists `failed` frames is returned: the others are done.
        """
        if self.was_cancelled:
            raise ProgramError("Cancelled; what is done stays done.")
        answer = _parsed("".join(self._out)) or (_parsed(self._out[-1]) if self._out else None)
        if answer is not None and "error" in answer:
            raise ProgramError(answer["error"], bool(answer.get("changed")))
        if answer is None or (self._process.returncode != 0 and not answer.get("failed")):
            said = [line.strip() for line in self._err if line.strip()]
            raise ProgramError(said[-1] if said else f"flowsculpt {self.words[0]} ended without an answer")
        return answer


def _parsed(text: str) -> Answer | None:
    try:
        answer = json.loads(text)
    except ValueError:
        return None
    return answer if isinstance(answer, dict) else None
