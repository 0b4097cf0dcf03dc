"""What a shot file must obey beyond the form of its values. Each check looks at the raw data, so that one
mistake never hides another, and yields where it is and what to tell."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, TypeGuard

import numpy as np

from pipeline.errors import MissingInputError, UsageError, suggestion
from pipeline.frames import FrameRange, FrameRate
from pipeline.shot.clock import Clock
from pipeline.shot.documents.fields import LARGEST, is_number
from pipeline.shot.documents.flow_catalogue import DOCUMENTS
from pipeline.shot.point_subjects import NETS, NetOfSolid
from pipeline.shot.subject import SOLIDS, Measure, Solid
from pipeline.shot.yaml.lookup import digest_of_file, is_there, shown
from pipeline.shot.yaml.source import Source, Where
from render.scene.look import LOOKS

Problem = tuple[Where, str]

MEASURES = {measure for kind in SOLIDS.values() for measure in kind.measures}

ACROSS = {
    name: {p.name: p.default_in_file for p in document.parameters}
    for name, document in DOCUMENTS.items()
    if {"axis", "direction"} <= document.model_fields.keys()
}
"""The flows with a direction across their axis, and the defaults of both."""

DIRECTIONS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def read_clock(source: Source) -> tuple[Clock | None, list[Problem]]:
    """The shot's clock, or what keeps it from having one."""
    rate, problems = read_rate(source)
    text = source.get("frames")
    if not isinstance(text, str):
        return None, problems  # the form is for the document to judge
    try:
        frames = FrameRange.parse(text)
    except UsageError as error:
        return None, [*problems, (("frames",), str(error))]
    if frames.numbers != tuple(range(frames.first, frames.last + 1)):
        return None, [
            *problems,
            (("frames",), f"frames {text} skip or turn back; a shot plays all. Write 1-96."),
        ]
    return (Clock(frames, rate) if rate else None), problems


def read_rate(source: Source) -> tuple[FrameRate | None, list[Problem]]:
    """Frames per second, 24 where nothing is said."""
    rate = source.get("rate")
    if isinstance(rate, bool | list | dict):
        return None, [(("rate",), f"rate is {rate!r}; it must be frames per second. Write 24 or 24000/1001.")]
    try:
        return FrameRate.of(24 if rate is None else rate), []
    except UsageError as error:
        return None, [(("rate",), str(error))]


def directions(source: Source) -> Iterator[Problem]:
    """Axes have a direction, and a shear slides across its axis."""
    for where, mapping in source.mappings():
        for name in ("axis", "direction", "normal"):
            value = mapping.get(name)
            if _is_triple(value) and math.hypot(*value) < 1e-12:
                yield (*where, name), f"{name} {value} has no direction. Write x, y, z or a vector."
        flow = where[-1] if where else None
        if flow in ACROSS:
            axis, slide = (_direction(mapping.get(p, ACROSS[flow][p])) for p in ("axis", "direction"))
            if axis and slide and _along(axis, slide):
                does = "slides" if flow == "shear" else "is turned"
                yield (
                    where,
                    f"{flow} {does} along its own axis; direction must lie across axis. Turn one of them.",
                )


def _direction(value: Any) -> tuple[float, ...] | None:
    if _is_triple(value):
        return tuple(value)
    return DIRECTIONS.get(value) if isinstance(value, str) else None


def _along(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    """Whether two vectors are parallel, or one is none."""
    cross = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return math.hypot(*cross) <= 1e-9 * math.hypot(*a) * math.hypot(*b)


def solid(source: Source) -> Iterator[Problem]:
    """A solid is given the measures it has: the subject, what a cloud fills, what a net is shaped as."""
    for where, kinds in (("subject",), SOLIDS), (("subject", "cloud"), SOLIDS), (("subject", "net"), NETS):
        given = source.get(*where)
        name = given.get("solid") if isinstance(given, dict) else None
        if isinstance(name, str) and name in kinds:
            yield from _measures(where, name, kinds[name].measures, given)


def _measures(
    where: Where, name: str, measures: Mapping[str, Measure], given: dict[str, Any]
) -> Iterator[Problem]:
    strangers = [m for m in given if m in MEASURES and m not in measures]
    yield from (((*where, m), f"{m} is no measure of a {name}. {suggestion(m, measures)}") for m in strangers)
    size = given.get("size")
    if isinstance(size, list) and "size" in measures and len(size) != np.size(measures["size"]):
        wanted = np.size(measures["size"])
        yield (
            (*where, "size"),
            f"size of a {name} has {wanted} numbers, not {len(size)}. Write all of them.",
        )
    elif not strangers:
        yield from _impossible(where, name, {m: given[m] for m in measures if m in given})


def clear_look(source: Source) -> Iterator[Problem]:
    """Light that enters a body comes out of it again, which an open sheet does not have."""
    subject, look = source.get("subject"), source.get("look")
    name = look.get("material") if isinstance(look, dict) else look
    if not (isinstance(subject, dict) and subject.get("solid") == "sheet"):
        return
    if isinstance(name, str) and name in LOOKS and LOOKS[name].is_clear:
        yield ("look",), f"look {name} {_OPEN}"
    yield from (
        (where, f"a {kind} {_OPEN}") for where, kind in _bodies(source.get("look", "bsdf"), ("look", "bsdf"))
    )


_OPEN = (
    "is for closed surfaces, and a sheet is open. Take a thin box, or a look that light does not go through."
)


def _bodies(said: Any, where: Where) -> Iterator[tuple[Where, str]]:
    """The materials, in what is said of one, that light enters to come out elsewhere."""
    if isinstance(said, dict):
        if said.get("type") in ("dielectric", "roughdielectric"):
            yield (*where, "type"), said["type"]
        for name, part in said.items():
            yield from _bodies(part, (*where, name))


def _impossible(where: Where, name: str, given: dict[str, Any]) -> Iterator[Problem]:
    """Measures that contradict each other, by trying them on the coarsest of meshes."""
    parts = [part for value in given.values() for part in (value if isinstance(value, list) else [value])]
    if not all(isinstance(part, str) or (is_number(part) and 0 < part <= LARGEST) for part in parts):
        return
    try:
        if where[-1] == "net":
            NetOfSolid.of(name, given).build()
        else:
            Solid.of(name, given).build(100 * LARGEST)
    except UsageError as error:
        yield where, f"{error}"


def tolerance(source: Source) -> Iterator[Problem]:
    """Only sub-steps whose error is estimated have a tolerance."""
    if source.get("tolerance") is not None and source.get("integrator") != "adaptive":
        yield (
            ("tolerance",),
            "tolerance is for the error that integrator: adaptive estimates, and rk4 estimates none. "
            "Write integrator: adaptive, or take it out.",
        )


def files(source: Source) -> Iterator[Problem]:
    """The one problem that is a missing input: the subject's file is not there, or cannot be read."""
    for kind in ("model", "cloud", "net"):
        name = source.get("subject", kind)
        if not isinstance(name, str):
            continue
        path = source.path.parent / name
        if not is_there(path):
            yield (
                ("subject", kind),
                (
                    f"{kind} file {shown(name)} is not there; it is looked for beside the shot file, "
                    f"as {shown(path)}. Put it there or correct the name."
                ),
            )
            continue
        try:
            digest_of_file(path)
        except MissingInputError as error:
            yield ("subject", kind), str(error)


def _is_triple(value: Any) -> TypeGuard[list[float]]:
    return isinstance(value, list) and len(value) == 3 and all(is_number(x) for x in value)
