"""Checks of the subject: measures of solids, files, and points."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from flowsculpt.pipeline.errors import MissingInputError, quote, suggest
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.shot.documents.camera_documents import FOCUS_WORDS
from flowsculpt.pipeline.shot.documents.field_types import is_written_number
from flowsculpt.pipeline.shot.documents.subject_documents import (
    POINTS,
    SolidDocument,
    named_kind,
    points_kind,
)
from flowsculpt.pipeline.shot.yaml.document_validation import missing_file
from flowsculpt.pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource
from flowsculpt.render.base.input_files import InputFile

SUBJECT_NAME = r"[A-Za-z][A-Za-z0-9_]{0,39}"
"""Names of subjects: they become part of file names, of mattes and of prims in USD."""

OBJECTS = ("stage", "plinth", "grey", "chrome", "chart", "wireframe")
"""Names of other objects in pictures, which mattes have too."""


def check_focus(source: YamlSource) -> Iterator[Problem]:
    """Check that a focus by name, and what the camera tracks, are subjects."""
    focus, subjects = source.get("camera", "focus"), source.get("subjects")
    names = (*FOCUS_WORDS, *(subjects if isinstance(subjects, dict) else ()))
    if isinstance(focus, str) and not is_written_number(focus) and focus not in names:
        hint = suggest(focus, names)
        yield ("camera", "focus"), f"camera.focus: {quote(focus)} is not a thing to focus on. {hint}"
    track, known = source.get("camera", "move", "track"), names[len(FOCUS_WORDS) :]
    for name in track if isinstance(track, list) else ():
        if isinstance(name, str) and name not in known:
            hint = suggest(name, known) if known else "Write several subjects by name."
            yield ("camera", "move", "track"), f"camera.move.track: {quote(name)} is not a subject. {hint}"


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
        if (kind := named_kind(entry)) and kind.not_copied:
            yield (*where, "copies"), kind.not_copied
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
    if (kind := points_kind(source.mapping(*where))) and not kind.is_net:
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
    for kind in ("model", *POINTS):
        name = source.get("subject", kind)
        if not isinstance(name, str):
            continue
        path = source.path.parent / name
        if not InputFile(path).is_there():
            yield ("subject", kind), missing_file(name, path, f"{kind} file")
            continue
        try:
            InputFile(path).digest()
        except MissingInputError as error:
            yield ("subject", kind), str(error)


def check_solid_size(source: YamlSource) -> Iterator[Problem]:
    """Check that the size of a model is set once."""
    given = source.mapping("subject").keys()
    if {"scale", "fit"} <= given and not given & {"solid", *POINTS}:
        yield (
            ("subject", "fit"),
            "fit and scale both set the size of the model. Write fit: 2 for a largest extent of 2 units, or "
            "scale for a factor on its coordinates, and leave the other out.",
        )


def check_stage(source: YamlSource) -> Iterator[Problem]:
    """Check that settings of USD stages are not given to models of other formats."""
    name = source.get("subject", "model")
    if not isinstance(name, str) or ModelFile(Path(name)).names_parts:
        return
    for setting in ("prim", "time_code"):
        if source.get("subject", setting) is not None:
            yield (
                ("subject", setting),
                f"{setting} is for models of USD; this one is {quote(Path(name).suffix)}. Leave it out.",
            )


def check_solid(source: YamlSource) -> Iterator[Problem]:
    """Check the measures of a solid."""
    for where, text in SolidDocument.faults((), source.mapping("subject")):
        yield ("subject", *where), text


def check_named_kind(source: YamlSource) -> Iterator[Problem]:
    """Check the settings of a subject of a plug-in that stand in the subject itself, and its points."""
    given = source.mapping("subject")
    if kind := named_kind(given):
        yield from ((("subject", *where), text) for where, text in kind.faults(given, source.path.parent))


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
        if named_kind(entry):
            data.pop("resample", None)  # that of the shot is for surfaces that flows carry
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
