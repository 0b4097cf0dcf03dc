"""Hooks: commands that a studio runs for each published version, for example to inform its tracker.

A hook reads one JSON object from its standard input:

    {"event": "published", "folder": "/show/renders/published/A010_cube/v001", "published_before": false,
     "provenance": {"shot": "A010_cube", "version": "v001", …}}

Its own output goes to standard error, so that what `flowsculpt --json` prints stays JSON.
"""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
from dataclasses import dataclass

from pipeline.errors import MachineError, MissingInputError, UsageError
from pipeline.plugins.versions.publishing import Published
from pipeline.production.request.provenance import FILE
from render.base.python_process import environment_of_others

STANDARD_ERROR = 2
"""The file descriptor of standard error."""


@dataclass(frozen=True)
class Hook:
    """A command to run for each published version.

    text   as the user wrote it
    words  the program and its arguments
    """

    text: str
    words: tuple[str, ...]

    @classmethod
    def of(cls, text: str) -> Hook:
        """Read a command, without a shell. Raises UsageError or MissingInputError where it cannot run."""
        try:
            words = tuple(shlex.split(text))
        except ValueError as error:
            raise UsageError(f"--hook {text}: not a command ({error}); check its quotes") from None
        if not words:
            raise UsageError("--hook is empty; name a program and its arguments")
        if shutil.which(words[0]) is None:
            raise MissingInputError(
                f"--hook {text}: program {words[0]} not found; check its name, path and permission to run"
            )
        return cls(text, words)

    def tell(self, done: Published) -> None:
        """Run the command and wait for its end. Raises MachineError where it does not end with 0."""
        folder = done.folder.absolute()
        provenance = json.loads((folder / FILE).read_text(encoding="utf-8"))
        told = {
            "event": "published",
            "folder": str(folder),
            "published_before": done.before,
            "provenance": provenance,
        }
        try:
            ended = subprocess.run(
                self.words,
                env=environment_of_others(),
                input=json.dumps(told),
                stdout=STANDARD_ERROR,
                text=True,
            )
        except OSError as error:
            raise self._failed(done, f"cannot run ({error.strerror})") from None
        if ended.returncode != 0:
            raise self._failed(done, f"ended with {ended.returncode}")

    def _failed(self, done: Published, fact: str) -> MachineError:
        return MachineError(
            f"--hook {self.text}: it {fact}. {done.version} is published nevertheless, in {done.folder}; "
            "the same command runs the hook again"
        )
