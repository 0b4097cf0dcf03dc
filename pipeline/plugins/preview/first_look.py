"""The first pictures of what was never rendered before, for somebody who waits at a terminal."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import IO

from flowsculpt.api import RunObserver
from flowsculpt.api.commands import print_warning
from flowsculpt.api.files import python_command
from flowsculpt.api.frames import Plan, RenderRequest
from flowsculpt.api.options import Common

FEWEST = 24  # frames that an animatic has at the least: fewer are soon rendered
ENDING_SECONDS = 3.0  # seconds in which the process that draws leaves, before it is killed


class FirstLook(RunObserver):
    """Shows the first pictures of a run, where somebody looks on and none is there yet.

    They are an animatic, if one is wanted as a `preview`, and the first finished frame.
    """

    def watch(self, common: Common, plan: Plan, preview: bool) -> AbstractContextManager[None]:
        arguments = arguments_for(common, plan, preview)
        return nullcontext() if arguments is None else _process(common.root, *arguments)


def arguments_for(common: Common, plan: Plan, animatic: bool = True) -> list[str] | None:
    """Return the arguments of the process that makes the pictures; None where none are shown."""
    from flowsculpt.pipeline.plugins.preview.first_pictures import WITHOUT, shown_requests

    requests = shown_requests(plan)
    frames = sum(len(request.requested) for request in requests)
    if not (frames > 1 and is_watched(common) and all(_is_new(common.root, each) for each in requests)):
        return None
    return [str(plan.file), *([] if animatic and frames >= FEWEST else [WITHOUT])]


def is_watched(common: Common) -> bool:
    """Tell whether a person looks on: progress at a terminal, outside of CI, of jobs of this machine."""
    at_terminal = sys.stdout.isatty() and sys.stderr.isatty() and not os.environ.get("CI")
    return common.progress and common.profile.is_local and at_terminal


def _is_new(root: Path, request: RenderRequest) -> bool:
    """Tell whether no frame of a shot was rendered yet at the quality of a request."""
    folders = (root / request.place(kind, 0).parent for kind in ("raw", "frame"))
    return not any(any(folder.glob("*.exr")) for folder in folders)


@contextmanager
def _process(root: Path, *words: str) -> Iterator[None]:
    """Have a process make the pictures, and print its lines; end it with the context."""
    process = subprocess.Popen(
        python_command("flowsculpt.pipeline.plugins.preview.first_pictures", *words),
        cwd=root,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None, "a pipe was asked for"
    is_ending = threading.Event()

    def print_lines(lines: IO[str]) -> None:
        for line in lines:
            print(line.rstrip(), file=sys.stderr)
        if (code := process.wait()) and not is_ending.is_set():
            print_warning(f"first pictures are left out: the process that draws them exited with {code}")

    reading = threading.Thread(target=print_lines, args=(process.stdout,), daemon=True)
    reading.start()
    try:
        yield
    finally:
        is_ending.set()
        process.terminate()
        with suppress(subprocess.TimeoutExpired):
            process.wait(ENDING_SECONDS)
        process.kill()
        process.wait()
        reading.join()
