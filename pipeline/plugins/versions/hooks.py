"""Commands that a studio runs for each published version and delivery, and when a run is done or has failed.

They are named by `publish --hook`, or by `hooks.yaml` in the folder of the profile:

    run_done: python notify.py
    run_failed: [python notify.py, "curl -sd @- https://chat/hook"]
    version_published: python track.py
    files_delivered: python upload.py

A profile holds commands anyway, and is used only where it is named.
"""

from __future__ import annotations

import json
import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from flowsculpt import FlowsculptError, MachineError, MissingInputError, UsageError
from flowsculpt.api import RunObserver, suggest
from flowsculpt.api.commands import print_warning
from flowsculpt.api.frames import Runs
from flowsculpt.api.options import Common
from flowsculpt.pipeline.plugins.versions.provenance import FILE
from flowsculpt.pipeline.plugins.versions.publishing import Published

EVENT_NAMES = ("run_done", "run_failed", "version_published", "files_delivered")

HOOKS_FILE = "hooks.yaml"

STANDARD_ERROR = 2
"""The file descriptor of standard error."""


@dataclass(frozen=True)
class Hook:
    """A command, its program and arguments, that reads one JSON object from its standard input.

    Its own output goes to standard error, so that what `flowsculpt --json` prints stays JSON.

    source  what names it: the option --hook, or a file and its entry
    """

    text: str
    words: tuple[str, ...]
    source: str = "--hook"

    @classmethod
    def of(cls, text: str, source: str = "--hook") -> Hook:
        """Read a command, without a shell. Raises UsageError or MissingInputError where it cannot run."""
        try:
            words = tuple(shlex.split(text))
        except ValueError as error:
            raise UsageError(f"{source} {text}: not a command ({error}); check its quotes") from None
        if not words:
            raise UsageError(f"{source} is empty; name a program and its arguments")
        if shutil.which(words[0]) is None:
            raise MissingInputError(
                f"{source} {text}: program {words[0]} not found; check its name, path and permission to run"
            )
        return cls(text, words, source)

    def tell(self, facts: Mapping[str, Any], after: str) -> None:
        """Run the command with facts and wait for its end.

        after  what holds all the same where it fails

        Raises MachineError where it does not end with 0.
        """
        try:
            ended = subprocess.run(
                self.words,
                env=user_environment(),
                input=json.dumps(facts),
                stdout=STANDARD_ERROR,
                text=True,
            )
        except OSError as error:
            raise MachineError(
                f"{self.source} {self.text}: it cannot run ({error.strerror}). {after}"
            ) from None
        if ended.returncode != 0:
            raise MachineError(f"{self.source} {self.text}: it ended with {ended.returncode}. {after}")


def user_environment() -> dict[str, str]:
    """Return the environment of a program of the user, such as a Python script with modules next to it."""
    given = {name: value for name, value in os.environ.items() if name != "FLOWSCULPT_PROCESS"}
    if not sys.flags.safe_path:
        given.pop("PYTHONSAFEPATH", None)
    return given


def tell_published(hook: Hook, done: Published) -> None:
    """Tell a hook of a published version. Raises MachineError where it fails."""
    folder = done.folder.absolute()
    provenance = json.loads((folder / FILE).read_text(encoding="utf-8"))
    facts = {"event": "published", "folder": str(folder), "published_before": done.before}
    after = (
        f"{done.version} is published nevertheless, in {done.folder}; the same command runs the hook again"
    )
    hook.tell({**facts, "provenance": provenance}, after)


def hooks_of(profile: Path, event: str) -> Iterator[Hook]:
    """Yield the hooks that a profile's folder names for an event, one of EVENT_NAMES.

    Raises UsageError for a file that is not one of hooks, and as `Hook.of`.
    """
    file = profile / HOOKS_FILE
    if not file.is_file():
        return
    try:
        said = YAML(typ="safe", pure=True).load(file.read_text(encoding="utf-8")) or {}
    except (OSError, YAMLError, UnicodeDecodeError) as error:
        raise UsageError(f"{file}: cannot be read ({' '.join(str(error).split())})") from None
    if not isinstance(said, dict):
        raise UsageError(f"{file}: not hooks; write names and commands, such as run_failed: python notify.py")
    for name, commands in said.items():
        if name not in EVENT_NAMES:
            raise UsageError(f"{file}: {name} is not an event. {suggest(str(name), EVENT_NAMES)}")
        for command in commands if isinstance(commands, list) else [commands]:
            if not isinstance(command, str):
                raise UsageError(
                    f"{file}: {name} is {command!r}; it must be a command, or a list of commands"
                )
            if name == event:
                yield Hook.of(command, f"{file}: {name}:")


def tell_of_run(common: Common, run: str) -> str:
    """Tell the hooks of the profile that a run is done or has failed; those that fail are warnings."""
    events = list(Runs(common.root).reader(run).new())
    failures = [event for event in events if event["event"] == "fail"]
    name = "run_failed" if failures else "run_done"
    shots = dict.fromkeys((e["shot"], e.get("quality")) for e in events if e["event"] == "frame")
    facts = {
        "event": name,
        "run": run,
        "root": str(common.root.absolute()),
        "host": platform.node(),
        "shots": [{"shot": shot, "quality": quality} for shot, quality in shots],
        "frames": sum(e["event"] == "frame" and not e["found"] for e in events),
        "failures": [
            {part: e.get(part) for part in ("shot", "quality", "stage", "frame", "message")} for e in failures
        ],
    }
    _tell_all(common, name, facts, "The run is not affected")
    return ""


def tell_of_delivery(common: Common, delivery: Mapping[str, Any]) -> None:
    """Tell the hooks of the profile which files were delivered; those that fail are warnings."""
    files = [{**each, "path": str(Path(each["path"]).absolute())} for each in delivery["deliverables"]]
    facts = {
        "event": "files_delivered",
        "root": str(common.root.absolute()),
        "host": platform.node(),
        "deliverables": files,
        "failed": delivery["failed"],
    }
    _tell_all(common, "files_delivered", facts, "The files are there nevertheless")


class HookCaller(RunObserver):
    """Tells the hooks of the profile of runs and deliveries."""

    def summary(self, common: Common, run: str) -> str:
        return tell_of_run(common, run)

    def delivered(self, common: Common, delivery: Mapping[str, Any]) -> None:
        tell_of_delivery(common, delivery)


def _tell_all(common: Common, event: str, facts: Mapping[str, Any], after: str) -> None:
    try:
        for hook in hooks_of(common.profile.folder, event):
            hook.tell(facts, after)
    except FlowsculptError as error:
        print_warning(str(error))
