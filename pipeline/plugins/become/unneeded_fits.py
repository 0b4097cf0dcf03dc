"""Fits that no shot of a project needs, and no shot at all has used for long."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from flowsculpt import FlowsculptError
from flowsculpt.api.files import CachedAnswer
from flowsculpt.api.frames import RenderRequest
from flowsculpt.pipeline.plugins.become.become_flow import Become
from flowsculpt.pipeline.plugins.become.stored_fits import path_of

KEPT_DAYS = 30
"""Days without use after which a fit may go: all projects of the user share the cache."""


def unneeded_fits(root: Path, requests: Iterable[RenderRequest]) -> tuple[str, list[Path]]:
    """Return the fits, and what is left of interrupted ones, that were not used for KEPT_DAYS."""
    oldest = time.time() - 86400.0 * KEPT_DAYS
    found = CachedAnswer.home().joinpath("fits").glob("*.npz")
    old = [path for path in found if _last_use(path) < oldest]
    needed = {path.name for request in requests for path in _needed(request)} if old else ()
    return "fits of become", [path for path in sorted(old) if path.name not in needed]


def _last_use(path: Path) -> float:
    with suppress(FileNotFoundError):  # `clean` of another root was faster
        return path.stat().st_mtime
    return math.inf


def _needed(request: RenderRequest) -> Iterator[Path]:
    with suppress(FlowsculptError):  # a shot that cannot be read any more needs nothing
        for part in request.parts:
            for flow in part.shot.motion.flow.members:
                become = flow.plugin_flow
                if isinstance(become, Become) and become.start is not None:
                    yield path_of(become.start, become.target, become.detail)
