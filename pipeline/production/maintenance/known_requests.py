"""Requests that a root holds output of: those of today's shots, and those of its last runs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipeline.errors import FlowsculptError, UsageError
from pipeline.production.execution.project import Project
from pipeline.production.planning.frame_states import is_begun
from pipeline.production.request.crop_and_scale import is_quality
from pipeline.production.request.edit import Edit
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.request.shot_lookup import FILM, edit_names, find_edit, find_shot, shot_names
from pipeline.production.store.paths import PLANS, RENDERS
from render.base.serialise import from_plain
from render.scene.render_quality import QUALITIES

Film = tuple[Edit, list[RenderRequest]]
"""An edit at one quality, and the requests of its clips."""


def begun_requests(project: Project, warn: Callable[[str], object]) -> Iterator[RenderRequest]:
    """Yield today's shots at every quality begun so far, crops and scales too.

    warn  called with a line about each shot that cannot be read
    """
    for name in shot_names():
        try:
            read = project.at_qualities(find_shot(name))
            requests = [project.as_finished(request) for request in read]
        except FlowsculptError as error:
            warn(str(error))
            continue
        for each in _crops_and_scales(project.root / RENDERS / name):
            with suppress(UsageError):  # a crop of pictures that had another shape
                request = replace(read[0], quality_name=each)
                _ = request.quality  # raises it
                requests.append(project.as_finished(request))
        begun = [request for request in requests if is_begun(request, project.store)]
        yield from begun or requests[:1]


def begun_films(project: Project) -> Iterator[Film]:
    """Yield today's edits at every quality begun so far."""
    for name in edit_names():
        for quality in _qualities(project.root / RENDERS / "film"):
            with suppress(FlowsculptError):
                yield project.edit(quality, FILM if name == FILM.stem else find_edit(name))


def last_requests(root: Path, count: int) -> Iterator[RenderRequest]:
    """Yield the requests of the last `count` runs of each shot at each quality, from their plans."""
    seen: Counter[tuple[Any, ...]] = Counter()
    for path in sorted((root / PLANS).glob("*.json"), reverse=True):
        with suppress(OSError, ValueError, KeyError):
            for data in json.loads(path.read_text(encoding="utf-8"))["requests"]:
                if not is_quality(data["quality_name"]):
                    continue  # a quality of an earlier version
                if data["source"].get("subject"):
                    continue  # one of several subjects, whose shot is in the plan too
                about = data["source"]["path"], data["quality_name"], str(data["turntable"]), data.get("home")
                seen[about] += 1
                if seen[about] <= count:
                    yield from_plain(RenderRequest, data)


def _qualities(folder: Path) -> list[str]:
    """Return the qualities that a folder has folders of."""
    return sorted(path.name for path in folder.glob("*") if path.is_dir() and is_quality(path.name))


def _crops_and_scales(folder: Path) -> list[str]:
    return [name for name in _qualities(folder) if name not in QUALITIES]
