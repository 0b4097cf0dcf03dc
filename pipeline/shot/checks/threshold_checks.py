"""What the thresholds of a shot must obey beyond the form of their values: checks like those of `checks`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pipeline.resample.thresholds import DEFAULT_RATIO, HIGHEST_RATIO
from pipeline.shot.checks.file_checks import Problem
from pipeline.shot.documents.fields import is_number
from pipeline.shot.yaml.source import Source, Where

THRESHOLDS = ("max_edge_length", "min_edge_length", "hard_angle")
BOUNDED = ("curvature", "camera")


def ratio(source: Source) -> Iterator[Problem]:
    """P13: with a minimum of half the maximum or more, splitting and collapsing undo each other."""
    longest, at_longest = _extreme(source, "max_edge_length", min)
    shortest, at_shortest = _extreme(source, "min_edge_length", max)
    if longest is None or shortest is None or longest <= 0:
        return
    moving = len(at_longest) > 2 and len(at_shortest) > 2
    if moving or shortest < HIGHEST_RATIO * longest:
        return  # where both change, each frame is looked at when it comes
    yield (
        at_shortest if len(at_shortest) > 2 else at_longest if len(at_longest) > 2 else at_shortest,
        f"min_edge_length {shortest:g} is {shortest / longest:.0%} of max_edge_length {longest:g}; "
        f"it must be below 50% (P13), or splitting and collapsing undo each other. "
        f"Try {DEFAULT_RATIO * longest:.3g}.",
    )


def bounds(source: Source) -> Iterator[Problem]:
    """The finest edge is no longer than the coarsest."""
    for name in THRESHOLDS:
        for kind in BOUNDED:
            where: Where = ("resample", name, kind)
            finest, coarsest = source.get(*where, "finest"), source.get(*where, "coarsest")
            if is_number(finest) and is_number(coarsest) and finest > coarsest > 0:
                yield (
                    (*where, "finest"),
                    f"finest {finest:g} is longer than coarsest {coarsest:g}; it must not be. Exchange them.",
                )


def splits(source: Source) -> Iterator[Problem]:
    """Faces are cut in four at the middles of their edges, and nowhere else."""
    placement = source.get("resample", "placement")
    polyhedra = source.get("resample", "method") == "polyhedra"
    if source.get("resample", "splits") != "faces" or polyhedra or placement == "chord":
        return
    has = "by default placement is exact" if placement is None else f"placement is {placement}"
    yield (
        ("resample", "splits"),
        f"splits: faces puts new vertices in the middle of their edges, and {has}. "
        "Write placement: chord, or leave splits out.",
    )


def _extreme(source: Source, name: str, of: Any) -> tuple[float | None, Where]:
    """The least or greatest that a threshold can be, as far as the file tells, and where that stands."""
    value, where = source.get("resample", name), ("resample", name)
    if is_number(value):
        return value, where
    if not isinstance(value, dict):
        return None, where
    if isinstance(value.get("keys"), dict):
        inner = {
            key: item["value"] if isinstance(item, dict) and "value" in item else item
            for key, item in value["keys"].items()
        }
        numbers = {key: item for key, item in inner.items() if is_number(item)}
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
