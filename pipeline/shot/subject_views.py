"""A shot file of several subjects as one file for each subject, as if the shot had that subject alone.

All checks of a shot with one subject then hold for each of several. Every value keeps its place in the file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from pipeline.shot.yaml.source import Problem, Where, YamlSource

OWN = ("place", "copies", "look", "flows", "resample")
"""Settings of an entry of `subjects` that are no part of the subject itself."""

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
        entry, shared = source.data["subjects"][name], source.get("flows")
        overridden = tuple(setting for setting in OVERRIDING if setting in entry)
        data = {setting: value for setting, value in source.data.items() if setting != "subjects"}
        if {"cloud", "net"} & entry.keys():
            data.pop("resample", None)  # that of the shot is for surfaces
        data |= {setting: entry[setting] for setting in overridden}
        data["subject"] = {setting: value for setting, value in entry.items() if setting not in OWN}
        data["flows"] = [
            flow for flows in (shared, entry.get("flows")) if isinstance(flows, list) for flow in flows
        ]
        count = len(shared) if isinstance(shared, list) else 0
        view = cls(name, replace(source, data=data), count, overridden)

        def moved(spots: dict[Where, Any]) -> dict[Where, Any]:
            return {
                there: spot for where, spot in spots.items() if (there := view._forward(where)) is not None
            }

        places, texts, others = (moved(spots) for spots in (source.places, source.texts, source.others))
        return replace(
            view, source=replace(view.source, places=places, texts=texts, others=others, problems=[])
        )

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
    entries = source.get("subjects")
    if not isinstance(entries, dict):
        return ()
    return tuple(SubjectView.of(source, name) for name, entry in entries.items() if isinstance(entry, dict))
