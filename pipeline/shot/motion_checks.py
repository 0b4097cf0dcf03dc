"""Checks of keys, flows and their integration, and the thresholds of resampling."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from flowsculpt.pipeline.errors import quote
from flowsculpt.pipeline.flow.keyframes import BEZIER
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.resample import polygon_methods
from flowsculpt.pipeline.resample.thresholds import DEFAULT_RATIO, HIGHEST_RATIO
from flowsculpt.pipeline.shot.documents.field_types import is_number, is_triple
from flowsculpt.pipeline.shot.documents.flow_documents import FLOW_DOCUMENTS
from flowsculpt.pipeline.shot.documents.subject_documents import named_kind, points_kind
from flowsculpt.pipeline.shot.motion import FURTHEST, Clock
from flowsculpt.pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource, dotted_path
from flowsculpt.render.base.plural import plural

AXIAL = {
    name: {p.name: p.default_in_file for p in document.parameters}
    for name, document in FLOW_DOCUMENTS.items()
    if {"axis", "direction"} <= document.model_fields.keys()
}
"""The flows with a direction across their axis, and the defaults of their parameters."""

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}

THRESHOLDS = ("max_edge_length", "min_edge_length", "hard_angle")
BOUNDED = ("curvature", "camera")

_ANY = Clock(FrameRange.of([1]), FrameRate.of(24))
"""Stands in for the clock of a shot whose own has problems."""


def check_keys(source: YamlSource, clock: Clock | None) -> Iterator[Problem]:
    """Check that keys are frames or seconds and ascend, and the form of handles."""
    for where, mapping in source.mappings():
        inner = mapping.get("keys")
        if isinstance(inner, dict):
            yield from _times(inner, (*where, "keys"), clock or _ANY)
            yield from _handles(mapping, (*where, "keys"), clock or _ANY)


def outside_note(source: YamlSource, clock: Clock) -> str | None:
    """Return the line about keys outside of the shot, which still shape their curves; None for none."""
    outside = [
        (*where, "keys", key)
        for where, mapping in source.mappings()
        for key in (mapping["keys"] if isinstance(mapping.get("keys"), dict) else ())
        if not clock.holds(seconds := clock.seconds(key) or 0.0)
        and not ("flows" in where[:3] and clock.flow_holds(seconds))
    ]
    if not outside:
        return None
    count, place = plural(len(outside), "key is", "keys are"), source.place(min(outside, key=source.order))
    return f"{place}: {count} outside of the shot, which has frames {clock.frames}; curves keep their shape."


def _times(keys: dict[Any, Any], where: Where, clock: Clock) -> Iterator[Problem]:
    before: tuple[Any, float] | None = None
    for key in keys:
        place, seconds = (*where, key), clock.seconds(key)
        if seconds is None or not abs(seconds) < FURTHEST:
            yield (
                place,
                f"key {quote(key)} is not a time; write a frame, such as 12, or seconds, such as 0.5s",
            )
            continue
        if before and math.isclose(seconds, before[1], rel_tol=0, abs_tol=1e-9):
            yield (
                place,
                f"key {_shown(key)} is at the same time as key {_shown(before[0])}; a time has one value. "
                "Remove one of them.",
            )
        elif before and seconds < before[1]:
            yield (
                place,
                f"key {_shown(key)} comes after key {_shown(before[0])}; keys go forward in time. Sort them.",
            )
        before = key, seconds


def _shown(key: float | str) -> str:
    """Return a key for a message: as it stands, unless it is too long."""
    return quote(key).strip("'")


def _handles(mapping: dict[Any, Any], where: Where, clock: Clock) -> Iterator[Problem]:
    """Check that a handle is [time, value], on its side of the key, beside a Bézier segment."""
    items = list(mapping["keys"].items())
    for i, (key, item) in enumerate(items):
        if not isinstance(item, dict):
            continue
        for side, segment in (("left", items[i - 1][1] if i else None), ("right", item)):
            handle, place = item.get(side), (*where, key, side)
            if handle is None:
                continue
            fault = _handle_fault(side, handle, item.get("value"), clock)
            if fault:
                yield place, fault
            elif segment is not None and not _is_bezier(segment, mapping.get("ease")):
                yield (
                    place,
                    f"{side} is a handle beside a segment that is not Bézier. Write ease: bezier with "
                    f"{'the key before' if side == 'left' else 'the key'}, or leave {side} out.",
                )


def _is_bezier(item: Any, ease: Any) -> bool:
    own = item.get("ease", BEZIER if "right" in item else ease) if isinstance(item, dict) else ease
    return bool(own == BEZIER)


def _handle_fault(side: str, handle: Any, value: Any, clock: Clock) -> str | None:
    rule = f"a handle is [time, value] away from its key, such as [{'-6' if side == 'left' else '6'}, 0.5]"
    if not isinstance(handle, list) or len(handle) != 2:
        return f"{side} is {quote(handle)}; {rule}"
    seconds, away = clock.length(handle[0]), handle[1]
    if seconds is None or not math.isfinite(seconds):
        return f"{side} has {quote(handle[0])} for its time, which is frames, or seconds as 0.5s; {rule}"
    if seconds < 0 if side == "right" else seconds > 0:
        sign = "negative" if side == "left" else "positive"
        return f"{side} has {quote(handle[0])} for its time, which must be {sign} there. Turn it round."
    wanted = len(value) if isinstance(value, list) else 1
    parts = away if isinstance(away, list) else [away]
    if not all(is_number(part) and abs(part) <= 1e12 for part in parts):
        return f"{side} has {quote(away)} for its value; {rule}"
    if len(parts) != wanted or isinstance(away, list) != isinstance(value, list):
        count = plural(len(parts), "number")
        return f"{side} has {count} and its key {wanted}; they need as many. Write all of them."
    return None


def check_directions(source: YamlSource) -> Iterator[Problem]:
    """Check that axes have a direction, and that flows with a direction have it across their axis."""
    for where, mapping in source.mappings():
        for name in ("axis", "direction", "normal"):
            value = mapping.get(name)
            if is_triple(value) and math.hypot(*value) < 1e-12:
                yield (*where, name), f"{name} {value} has no direction. Write x, y, z or a vector."
        flow = where[-1] if where else None
        if flow in AXIAL:
            axis, direction = (_vector(mapping.get(p, AXIAL[flow][p])) for p in ("axis", "direction"))
            if axis and direction and _are_parallel(axis, direction):
                does = "slides" if flow == "shear" else "is turned"
                yield (
                    where,
                    f"{flow} {does} along its own axis; direction must lie across axis. Turn one of them.",
                )


def _vector(value: Any) -> tuple[float, ...] | None:
    if is_triple(value):
        return tuple(value)
    return AXES.get(value) if isinstance(value, str) else None


def _are_parallel(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    """True if two vectors are parallel, or one is 0."""
    cross = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return math.hypot(*cross) <= 1e-9 * math.hypot(*a) * math.hypot(*b)


def check_tolerance(source: YamlSource) -> Iterator[Problem]:
    """Check that a tolerance stands beside the integrator that estimates errors."""
    if source.get("tolerance") is not None and source.get("integrator") != "adaptive":
        yield (
            ("tolerance",),
            "tolerance is for the error that integrator: adaptive estimates, and rk4 estimates none. "
            "Write integrator: adaptive, or take it out.",
        )


def check_sounds(source: YamlSource) -> Iterator[Problem]:
    """Check that flows follow sounds only where their time is the film's, which the sound has too."""
    if source.get("speed") in (None, 1):
        return
    for where, mapping in source.mappings():
        if where[:1] == ("flows",) and "audio" in mapping:
            yield (
                where,
                f"{dotted_path(where)} follows a sound, and speed re-times the flow, so that it would not "
                "move when the sound is heard. Remove speed, or let speed follow the sound.",
            )


def check_edge_length_ratio(source: YamlSource) -> Iterator[Problem]:
    """Check P13: with a minimum of half the maximum or more, splitting and collapsing undo each other."""
    longest, at_longest = _extreme(source, "max_edge_length", min)
    shortest, at_shortest = _extreme(source, "min_edge_length", max)
    if longest is None or shortest is None or longest <= 0:
        return
    both_change = len(at_longest) > 2 and len(at_shortest) > 2
    if both_change or shortest < HIGHEST_RATIO * longest:
        return  # lengths that both change are checked at each frame
    yield (
        at_shortest if len(at_shortest) > 2 else at_longest if len(at_longest) > 2 else at_shortest,
        f"min_edge_length {shortest:g} is {shortest / longest:.0%} of max_edge_length {longest:g}; "
        f"it must be below 50%, or splitting and collapsing undo each other. "
        f"Try {DEFAULT_RATIO * longest:.3g}.",
    )


def check_threshold_bounds(source: YamlSource) -> Iterator[Problem]:
    """Check that the finest edge is no longer than the coarsest."""
    for name in THRESHOLDS:
        for kind in BOUNDED:
            where: Where = ("resample", name, kind)
            finest, coarsest = source.get(*where, "finest"), source.get(*where, "coarsest")
            if is_number(finest) and is_number(coarsest) and finest > coarsest > 0:
                yield (
                    (*where, "finest"),
                    f"finest {finest:g} is longer than coarsest {coarsest:g}; it must not be. Exchange them.",
                )


def check_splits(source: YamlSource) -> Iterator[Problem]:
    """Check that faces are split in four with chord placement only, at the middles of their edges."""
    placement = source.get("resample", "placement")
    polygons = source.get("resample", "method") in polygon_methods()
    if source.get("resample", "splits") != "faces" or polygons or placement == "chord":
        return
    actual = "by default placement is exact" if placement is None else f"placement is {placement}"
    yield (
        ("resample", "splits"),
        f"splits: faces puts new vertices in the middle of their edges, and {actual}. "
        "Write placement: chord, or leave splits out.",
    )


def check_resample_entry(source: YamlSource) -> Iterator[Problem]:
    """Check that surfaces that flows carry have the entry `resample`, and points have not."""
    subject = source.mapping("subject")
    kind, written = points_kind(subject), source.get("resample")
    if named_kind(subject) is None and isinstance(source.data, dict) and "resample" not in source.data:
        yield (
            ("resample",),
            "resample: missing; it has no default. Write resample: {max_edge_length: 0.05}.",
        )
    elif kind is not None and written not in (None, "off"):
        remedy = "Write resample: off, or leave it out."
        yield ("resample",), f"{kind.not_resampled}, and are not resampled. {remedy}"


def _extreme(source: YamlSource, name: str, of: Any) -> tuple[float | None, Where]:
    """Return the least or greatest value of a threshold, if the file shows it, and its place."""
    value, where = source.get("resample", name), ("resample", name)
    if is_number(value):
        return value, where
    if keys := source.mapping(*where, "keys"):
        values = {
            key: item.get("value", item) if isinstance(item, dict) else item for key, item in keys.items()
        }
        numbers = {key: item for key, item in values.items() if is_number(item)}
        if not numbers:
            return None, where
        key = of(numbers, key=numbers.__getitem__)
        return numbers[key], (*where, "keys", key)
    bound = "finest" if of is min else "coarsest"
    for kind in BOUNDED:
        limit = source.get(*where, kind, bound)
        if is_number(limit):
            return limit, (*where, kind, bound)
    return None, where
