"""The times of flows that have one of their own: by `speed`, or within `reversed` and `repeated`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.shot.clock import Clock
from pipeline.shot.documents.flows import Entry, RepeatedDocument, ReversedDocument, seconds
from pipeline.shot.documents.shot import ShotDocument
from pipeline.shot.yaml.source import Where


def flow_frames(document: ShotDocument, clock: Clock) -> dict[Where, list[float]]:
    """Return the time of flows at each frame of the shot, in frames, by the paths of what holds them.

    Of several paths that a flow lies within, the longest tells its time; none where it goes by that of the
    film. Within `repeated`, the time is that of the round.
    """
    first, fps = clock.frames.first, float(clock.rate.fps)
    numbers = range(first, clock.frames.last + 1)
    times = np.array([clock.flow_time(number) for number in numbers])
    lists: dict[Where, Sequence[Entry]] = {("flows",): document.flows}
    for name, subject in (document.subjects or {}).items():
        lists["subjects", name, "flows"] = subject.flows
    found: dict[Where, Floats] = {}
    for where, flows in lists.items():
        if clock.speed != 1.0:
            found[where] = times
        found |= _own_times(flows, where, times, clock)
    return {where: np.round(first + own * fps, 4).tolist() for where, own in found.items()}


def _own_times(
    flows: Sequence[Entry], where: Where, times: Floats, clock: Clock
) -> Iterator[tuple[Where, Floats]]:
    """Yield the paths of compositions with a time of their own, and these times (N,), seconds."""
    for index, entry in enumerate(flows):
        name, chosen = next(iter(entry.model_fields_set)), entry.chosen
        place, own = (*where, index, name), times
        if isinstance(chosen, ReversedDocument):
            whole = clock.duration if chosen.duration is None else seconds(chosen.duration, clock)
            own = whole - times
        elif isinstance(chosen, RepeatedDocument):
            own = times % seconds(chosen.period, clock)
        if own is not times:
            yield place, own
        if isinstance(chosen, list):
            yield from _own_times(chosen, place, own, clock)
        else:
            inner: Any = getattr(chosen, "flows", None)
            yield from _own_times(inner or [], (*place, "flows"), own, clock)
