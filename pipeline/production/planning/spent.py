"""What making a take's pictures took, as the runs that made them told it."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

from pipeline.production.keys.digest import Key
from pipeline.production.planning.timings import OF_MOTION
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.event_log import EventReader, logs_of

_PICTURES = ("finish", "assemble")


def seconds_of(request: RenderRequest, root: Path, number: int, raw: Key) -> dict[str, float]:
    """Of rendering one picture, by stage; nothing where it is not known for this very picture."""
    try:
        told = json.loads((root / request.folders.statistics(request.quality_name, number)).read_text())
        return dict(told["seconds"]) if told["key"] == raw else {}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def seconds_by_stage(request: RenderRequest, root: Path, raws: Mapping[int, Key]) -> dict[str, float]:
    """Of all of a take's frames together: what rendering them took, and what the event logs of the root last
    told of the other stages."""
    found: dict[str, dict[int, float]] = defaultdict(dict)
    for log in logs_of(root):
        for event in EventReader(log).new():
            if event["event"] == "frame" and event["shot"] == request.subject and not event["found"]:
                stage = str(event["stage"])
                if stage in OF_MOTION or (
                    stage in _PICTURES and event.get("quality") == request.quality_name
                ):
                    found[stage][event["frame"]] = event["seconds"]
    rendering = [sum(seconds_of(request, root, number, raw).values()) for number, raw in raws.items()]
    told = {stage: round(sum(frames.values()), 3) for stage, frames in found.items()}
    return {**told, "render": round(sum(rendering), 3)}
