"""The edit of an OpenTimelineIO timeline, which is read in a process of its own.

The library's parser recurses without a bound, and crashes where a file has too many brackets.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from pathlib import Path

from pipeline.errors import FlowsculptError, MissingInputError, ShotError, UsageError
from pipeline.shot.yaml.named_files import shown
from render.base.limited_process import ParserError, answer_of

_ERRORS: tuple[type[FlowsculptError], ...] = (ShotError, MissingInputError, UsageError)


def edit_of(timeline: Path, shots: Collection[str], folder: Path) -> tuple[Path, str]:
    """Return the file of a timeline's edit, and its text. Raises what `ImportedEdit.text` raises."""
    words = [str(timeline), str(folder), *shots]
    try:
        answer = answer_of("pipeline.plugins.delivery.imported_edit", timeline, *words)
    except ParserError as error:
        fault = f"it cannot be read as OpenTimelineIO ({error}); export it again"
        raise ShotError(f"{shown(timeline)}: {fault}") from None
    text, kind, *messages = json.loads(answer)
    for error_type in _ERRORS:
        if kind == error_type.__name__:
            raise error_type(*messages)
    return folder / f"{timeline.stem}.yaml", text
