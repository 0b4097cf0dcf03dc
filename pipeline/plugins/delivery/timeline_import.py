"""The edit of an OpenTimelineIO timeline, which is read in a process of its own.

The library's parser recurses without a bound, and crashes where a file has too many brackets.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from flowsculpt import FlowsculptError, MissingInputError, UsageError
from flowsculpt.api import ShotError
from flowsculpt.api.files import InputFile, Parser
from flowsculpt.api.shots import WrittenShot

_ERRORS: tuple[type[FlowsculptError], ...] = (ShotError, MissingInputError, UsageError)


def edit_of(timeline: Path, shots: Collection[str], folder: Path) -> tuple[Path, str]:
    """Return the file of a timeline's edit, and its text. Raises what `ImportedEdit.text` raises."""
    frames = _frames_of_movies(timeline, shots, folder)
    words = [str(timeline), str(folder), json.dumps(frames), *shots]
    try:
        answer = Parser("flowsculpt.pipeline.plugins.delivery.imported_edit").answer(timeline, *words)
    except ValueError as error:
        fault = f"it cannot be read as OpenTimelineIO ({error}); export it again"
        raise ShotError(f"{timeline}: {fault}") from None
    text, kind, *messages = json.loads(answer)
    for error_type in _ERRORS:
        if kind == error_type.__name__:
            raise error_type(*messages)
    return folder / f"{timeline.stem}.yaml", text


def _frames_of_movies(timeline: Path, shots: Collection[str], folder: Path) -> dict[str, str]:
    """Return what shots write as their frames that a timeline names, if it has movies or sounds at all."""
    frames: dict[str, str] = {}
    with suppress(ValueError):  # the reader of the timeline reports its faults
        content = InputFile(timeline).content()
        content = content.decode(json.detect_encoding(content)).encode()
        if b'"ExternalReference.' not in content:
            return {}

        for shot in shots:
            with suppress(FlowsculptError):  # the reader of the edit reports its faults
                if shot.encode() in content:
                    written = WrittenShot.read(folder / f"{shot}.yaml")
                    frames[shot] = str(written.source.get("frames"))
    return frames
