"""Seconds of frames by stage, from the event logs of a root."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path

from pipeline.production.planning.timings import OF_MOTION
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.event_log import EventReader, logs_of

_STAGES = ("simulate", "smooth_normals", "finish")

Timings = dict[str, dict[int, float]]
"""Seconds by stage and frame."""


def rendering(request: RenderRequest, root: Path) -> dict[int, dict[str, float]]:
    """Return by frame the seconds of its last rendering, in parts, where they are known."""
    found = {}
    for number in request.angles:
        try:
            told = json.loads((root / request.folders.statistics(request.quality_name, number)).read_text())
            found[number] = {str(part): float(seconds) for part, seconds in told["seconds"].items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            continue
    return found


class Clocks:
    """Seconds of every frame made under a root, the last time it was made."""

    def __init__(self, root: Path) -> None:
        self._seconds: dict[tuple[str, str, str], dict[int, float]] = defaultdict(dict)
        for log in logs_of(root):
            for event in EventReader(log).new():
                if event["event"] == "frame" and not event["found"] and event["stage"] in _STAGES:
                    stage = str(event["stage"])
                    quality = "" if stage in OF_MOTION else str(event.get("quality", ""))
                    self._seconds[str(event["shot"]), stage, quality][event["frame"]] = event["seconds"]

    def of(self, subject: str, shot: str, quality: str) -> Timings:
        """Return seconds by stage and frame. In logs pictures are of `subject`, meshes perhaps of `shot`."""
        found: Timings = {}
        for stage in _STAGES:
            at = "" if stage in OF_MOTION else quality
            told = self._seconds.get((subject, stage, at)) or (
                self._seconds.get((shot, stage, at)) if stage in OF_MOTION else None
            )
            if told:
                found[stage] = dict(told)
        return found
