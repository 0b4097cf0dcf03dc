"""Checks of the subject: measures of solids, files, and the points of clouds and nets."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt.pipeline.errors import MeshError, MissingInputError, UsageError, quote, suggest
from flowsculpt.pipeline.mesh.control_net import LEAST, Lattice
from flowsculpt.pipeline.mesh.points import read_net, read_points
from flowsculpt.pipeline.mesh.read import names_parts
from flowsculpt.pipeline.shot.documents.camera_documents import FOCUS_WORDS
from flowsculpt.pipeline.shot.documents.field_types import LARGEST, is_number, is_written_number
from flowsculpt.pipeline.shot.point_subjects import NETS, NetOfSolid, radii_of
from flowsculpt.pipeline.shot.subjects import SOLIDS, Measure, Solid
from flowsculpt.pipeline.shot.yaml.document_validation import missing_file
from flowsculpt.pipeline.shot.yaml.named_files import is_file
from flowsculpt.pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource
from flowsculpt.render.base.input_files import digest_of_file
from flowsculpt.render.base.plural import indefinite, plural

MEASURES = {measure for kind in SOLIDS.values() for measure in kind.measures}

SUBJECT_NAME = r"[A-Za-z][A-Za-z0-9_]{0,39}"
"""Names of subjects: they become part of file names, of mattes and of prims in USD."""

OBJECTS = ("stage", "plinth", "grey", "chrome", "chart", "wireframe")
"""Names of other objects in pictures, which mattes have too."""

_SETTINGS = {
    "cloud": {"a file": ("scale",), "a solid": ("count", "fill", "seed")},
    "net": {
        "a file": ("columns", "closed", "scale"),
        "rows": ("closed",),
        "a solid": ("rows", "columns"),
    },
}
"""Settings of a cloud or net by what it is made from."""

_MADE_FROM: Mapping[type, str] = {str: "a file", list: "rows", dict: "a solid"}


def check_focus(source: YamlSource) -> Iterator[Problem]:
    """Check that a focus by name is that of a subject."""
    focus, subjects = source.get("camera", "focus"), source.get("subjects")
    names = (*FOCUS_WORDS, *(subjects if isinstance(subjects, dict) else ()))
    if isinstance(focus, str) and not is_written_number(focus) and focus not in names:
        hint = suggest(focus, names)
        yield ("camera", "focus"), f"camera.focus: {quote(focus)} is not a thing to focus on. {hint}"


def check_one_or_several(source: YamlSource) -> Iterator[Problem]:
    """Check that the shot has a subject or subjects, and that their names can name files."""
    if not isinstance(source.data, dict):
        return
    entries = source.get("subjects")
    if "subject" in source.data and "subjects" in source.data:
        yield (
            ("subjects",),
            "the shot has both subject and subjects; it has one subject, or several by name. Remove subject, "
            "or make it an entry of subjects.",
        )
    elif "subject" not in source.data and "subjects" not in source.data:
        yield (
            ("subject",),
            "subject: missing; it has no default. Write subject: …, or several as subjects: {name: …}.",
        )
    elif "subject" in source.data and source.data["subject"] is None:
        yield ("subject",), "subject: empty; it must be a mapping, such as {solid: box}"
    elif "subjects" in source.data and not entries:
        yield (
            ("subjects",),
            "subjects has no entry, and a shot needs a subject. Write one: {ball: {solid: icosphere}}.",
        )
    elif isinstance(entries, dict):
        yield from (((("subjects", name)), fault) for name in entries if (fault := _name_fault(name)))


def _name_fault(name: Any) -> str | None:
    """Return rule and remedy for a name that no subject can have; None for a good one."""
    if not isinstance(name, str) or not re.fullmatch(SUBJECT_NAME, name):
        rule = "a name begins with a letter and has letters, digits and _ alone, 40 at most"
        return f"{quote(name)} cannot name a subject; {rule}. Rename it."
    if name in OBJECTS or name.endswith("_wireframe"):
        return f"{name} is the name of something else in pictures. Rename the subject, such as {name}_1."
    return None


def check_copies(source: YamlSource) -> Iterator[Problem]:
    """Check that subjects with copies can be copied and have no other place, and that regions are bounded."""
    for name in source.mapping("subjects"):
        where: Where = ("subjects", name)
        if not source.mapping(*where, "copies"):
            continue
        entry = source.mapping(*where)
        if "place" in entry:
            yield (
                (*where, "place"),
                "place is for a subject without copies, which lie in their region. Move the region's centre, "
                "and leave place out.",
            )
        if "net" in entry:
            yield (*where, "copies"), "a net is one grid of points and has no copies. Write several subjects."
        if source.get(*where, "copies", "rigid") is True:
            yield from _unfit_for_rigid(source, where)
        region = source.mapping(*where, "copies", "region")
        for setting in ("half_space", "falloff", "invert"):
            if region.get(setting) not in (None, 0, False):
                yield (
                    (*where, "copies", "region", setting),
                    f"copies lie in a region with an end and a sharp border; {setting} gives it none. Take "
                    "sphere, box, capsule, cylinder or mesh, and leave falloff and invert out.",
                )


def _unfit_for_rigid(source: YamlSource, where: Where) -> Iterator[Problem]:
    """Check that rigid copies are of a surface, and that its edges have one length."""
    if "cloud" in source.mapping(*where):
        yield (*where, "copies", "rigid"), "points have no shape to keep, and move alone. Leave rigid out."
    at = (*where, "resample") if source.get(*where, "resample") is not None else ("resample",)
    for setting, value in source.mapping(*at).items():
        if isinstance(value, dict) and setting.endswith(("edge_length", "hard_angle")):
            yield (
                (*at, setting),
                f"{setting} varies, and rigid copies keep the shape of the first frame. Write a number.",
            )


def check_files(source: YamlSource) -> Iterator[Problem]:
    """Check that the subject's file is there and readable. These problems are missing inputs."""
    for kind in ("model", "cloud", "net"):
        name = source.get("subject", kind)
        if not isinstance(name, str):
            continue
        path = source.path.parent / name
        if not is_file(path):
            yield ("subject", kind), missing_file(name, path, f"{kind} file")
            continue
        try:
            digest_of_file(path)
        except MissingInputError as error:
            yield ("subject", kind), str(error)


def check_solid_size(source: YamlSource) -> Iterator[Problem]:
    """Check that the size of a model is set once."""
    given = source.mapping("subject").keys()
    if {"scale", "fit"} <= given and not given & {"solid", "cloud", "net"}:
        yield (
            ("subject", "fit"),
            "fit and scale both set the size of the model. Write fit: 2 for a largest extent of 2 units, or "
            "scale for a factor on its coordinates, and leave the other out.",
        )


def check_stage(source: YamlSource) -> Iterator[Problem]:
    """Check that settings of USD stages are not given to models of other formats."""
    name = source.get("subject", "model")
    for setting in ("prim", "time_code"):
        if isinstance(name, str) and not names_parts(name) and source.get("subject", setting) is not None:
            yield (
                ("subject", setting),
                f"{setting} is for models of USD; this one is {quote(Path(name).suffix)}. Leave it out.",
            )


def check_solid(source: YamlSource) -> Iterator[Problem]:
    """Check the measures of solids: the subject, what a cloud fills, and the shape of a net."""
    for where, kinds in (("subject",), SOLIDS), (("subject", "cloud"), SOLIDS), (("subject", "net"), NETS):
        given = source.mapping(*where)
        name = given.get("solid")
        if isinstance(name, str) and name in kinds:
            yield from _measures(where, name, kinds[name].measures, given)


def _measures(
    where: Where, name: str, measures: Mapping[str, Measure], given: dict[str, Any]
) -> Iterator[Problem]:
    unknown = [m for m in given if m in MEASURES and m not in measures]
    yield from (
        ((*where, m), f"{m} is not a measure of {indefinite(name)}. {suggest(m, measures)}") for m in unknown
    )
    size, wanted = given.get("size"), np.size(measures.get("size", ()))
    if wanted and (meant := _meant_size(size, wanted)):
        yield (*where, "size"), f"size of {indefinite(name)} has {plural(wanted, 'number')}. Write {meant}."
    elif not unknown:
        known = {m: given[m] for m in measures if m in given}
        if all(_has_form(value, measures[m]) for m, value in known.items()):
            yield from _contradictions(where, name, known)


def _meant_size(size: Any, wanted: int) -> list[Any] | None:
    """Return the size that one with another number of sides means; None for a good one, or another type."""
    if is_number(size):
        return [size] * wanted
    if not isinstance(size, list) or len(size) == wanted:
        return None
    if len(size) == 1 and isinstance(size[0], list):
        return size[0]
    return [*size, *[size[-1] if size else 1] * wanted][:wanted]


def _has_form(value: Any, default: Measure) -> bool:
    """Tell whether a measure has the form of its default; the document reports others."""
    if isinstance(default, str):
        return isinstance(value, str)
    parts = value if isinstance(default, tuple) and isinstance(value, list) else [value]
    return all(is_number(part) and 0 < part <= LARGEST for part in parts)


def _contradictions(where: Where, name: str, given: dict[str, Any]) -> Iterator[Problem]:
    """Check that measures are consistent, by building the coarsest mesh of them."""
    try:
        if where[-1] == "net":
            NetOfSolid.of(name, given).build()
        else:
            Solid.of(name, given).build(100 * LARGEST)
    except UsageError as error:
        yield where, f"{error}"


def check_points(source: YamlSource) -> Iterator[Problem]:
    """Check the settings and the points of a cloud or net."""
    for kind in _SETTINGS:
        written = source.get("subject", kind)
        made_from = _MADE_FROM.get(type(written), "")
        if made_from in _SETTINGS[kind]:
            yield from _foreign_settings(source, kind, made_from)
            yield from _bad_points(source, kind, written)


def _foreign_settings(source: YamlSource, kind: str, made_from: str) -> Iterator[Problem]:
    every = {name for names in _SETTINGS[kind].values() for name in names}
    for name in sorted(every - set(_SETTINGS[kind][made_from])):
        if source.get("subject", name) is not None:
            owners = [form for form, names in _SETTINGS[kind].items() if name in names]
            yield (
                ("subject", name),
                f"{name} is for a {kind} of {' or '.join(owners)}; this is one of {made_from}. Leave it out.",
            )


def _bad_points(source: YamlSource, kind: str, written: Any) -> Iterator[Problem]:
    """Check the points themselves; `files` reports missing files."""
    where = ("subject", kind)
    try:
        if isinstance(written, str):
            path = source.path.parent / written
            if is_file(path):
                _require_good_file(source, kind, path)
        elif isinstance(written, list):
            yield from _bad_rows(written)
        elif kind == "cloud":
            yield from _unfillable(source, written)
    except MissingInputError:
        return  # `files` reports it
    except MeshError as error:
        yield where, str(error)


def _unfillable(source: YamlSource, written: dict[str, Any]) -> Iterator[Problem]:
    """Check that a cloud fills a solid with a volume, and that its radius is a number."""
    fill, radius = source.get("subject", "fill"), source.get("subject", "radius")
    if written.get("solid") == "sheet" and fill in (None, "volume"):
        yield ("subject", "cloud"), "a sheet encloses no volume to fill. Write fill: surface."
    if isinstance(radius, str):
        fact = f"points in a solid have no attribute {quote(radius)}"
        yield ("subject", "radius"), f"{fact}; write a number."


def _require_good_file(source: YamlSource, kind: str, path: Path) -> None:
    """Raise MeshError for a file that holds no cloud or net."""
    if kind == "cloud":
        radius = source.get("subject", "radius")
        radii_of(read_points(path), radius if isinstance(radius, str) else 1.0, str(path))
        return
    columns = source.get("subject", "columns")
    is_known = isinstance(columns, int) and not isinstance(columns, bool) and columns >= LEAST
    grid = read_net(path, columns if is_known else None)
    Lattice(*grid.shape[:2])


def _bad_rows(rows: list[Any]) -> Iterator[Problem]:
    """Check that a net has enough rows, all of one length; the document checks the points."""
    where = ("subject", "net")
    if not all(isinstance(row, list) for row in rows) or not rows:
        if not rows:
            yield where, "the net has no rows; a bicubic patch needs 4 × 4 points. Write them."
        return
    odd = next((k for k, row in enumerate(rows) if len(row) != len(rows[0])), None)
    if odd is not None:
        yield (
            (*where, odd),
            f"row {odd} has {plural(len(rows[odd]), 'point')} and row 0 has {len(rows[0])}; all rows of a "
            "net are equally long. Add or remove points.",
        )
        return
    try:
        Lattice(len(rows), len(rows[0]))
    except MeshError as error:
        yield where, str(error)


OWN = ("place", "copies", "look", "flows", "resample")
"""Settings of an entry of `subjects` that are not part of the subject itself."""

OVERRIDING = ("look", "resample")
"""Those that replace the shot's own."""


@dataclass(frozen=True)
class SubjectView:
    """The file of a shot with one of its subjects.

    source  its flows are those of the shot, then those of the subject
    """

    name: str
    source: YamlSource
    shared_flows: int
    overridden: tuple[str, ...]

    @classmethod
    def of(cls, source: YamlSource, name: str) -> SubjectView:
        """Return the view of an entry of `subjects`, which is a mapping."""
        entry, shared = source.data["subjects"][name], source.listing("flows")
        overridden = tuple(setting for setting in OVERRIDING if setting in entry)
        data = {setting: value for setting, value in source.data.items() if setting != "subjects"}
        if {"cloud", "net"} & entry.keys():
            data.pop("resample", None)  # that of the shot is for surfaces
        data |= {setting: entry[setting] for setting in overridden}
        data["subject"] = {setting: value for setting, value in entry.items() if setting not in OWN}
        data["flows"] = [*shared, *source.listing("subjects", name, "flows")]
        view = cls(name, replace(source, data=data), len(shared), overridden)

        moved = ((view._forward(where), spot) for where, spot in source.places.items())
        places = {there: spot for there, spot in moved if there is not None}
        return replace(view, source=replace(view.source, places=places, problems=[]))

    def in_file(self, where: Where) -> Where:
        """Return the path in the file of a path in the view."""
        match where:
            case ("subject", *rest):
                return ("subjects", self.name, *rest)
            case ("flows", int(index), *rest) if index >= self.shared_flows:
                return ("subjects", self.name, "flows", index - self.shared_flows, *rest)
            case (setting, *_) if setting in self.overridden:
                return ("subjects", self.name, *where)
        return where

    def _forward(self, where: Where) -> Where | None:
        """Return the path in the view of a path in the file; None for what the view lacks."""
        match where:
            case ("subjects", name, "flows", int(index), *rest) if name == self.name:
                return ("flows", self.shared_flows + index, *rest)
            case ("subjects", name, setting, *_) if name == self.name and setting in OWN:
                return where[2:] if setting in OVERRIDING else None
            case ("subjects", name, *rest) if name == self.name:
                return ("subject", *rest)
            case ("subjects", *_):
                return None
            case (setting, *_) if setting in self.overridden:
                return None
        return where

    def problems(self, found: Sequence[Problem], source: YamlSource) -> list[Problem]:
        """Return problems of the view as those of the file, which learns the spots within texts."""
        for where, _ in found:
            if where in self.source.places:
                source.places.setdefault(self.in_file(where), self.source.places[where])
        return [(self.in_file(where), text) for where, text in found]


def subject_views(source: YamlSource) -> tuple[SubjectView, ...]:
    """Return the views of a file with `subjects`; none of another, nor of entries that are no mappings."""
    entries = source.mapping("subjects").items()
    return tuple(SubjectView.of(source, name) for name, entry in entries if isinstance(entry, dict))
