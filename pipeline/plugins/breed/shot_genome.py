"""Genomes: a shot as plain data that extends nothing, and its text."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flowsculpt.api.shots import FLOW_DOCUMENTS, FlowParameters, Shot, WrittenShot, to_yaml

INHERITED = ("extends", "looks", "rigs")
"""Entries whose effect is spelt out in a genome."""

ORDER = (
    "title", "intent", "frames", "rate", "speed", "subject", "subjects", "resample", "integrator",
    "tolerance", "substeps", "max_step", "flows",
)  # fmt: skip
"""Entries that stand first in a shot's text, in this order."""


@dataclass(frozen=True)
class Genome:
    """A shot as data.

    name     of the shot
    data     the shot file with everything that it inherits, without INHERITED
    folder   its file names are relative to this
    half     half of the subjects' largest extent at rest, units
    middle   the middle of the subjects at rest, units
    first    first frame
    last     last frame that keys of flows may have: flows have a time of their own
    seconds  duration of the flow
    digests  of the files that it names
    """

    name: str
    data: dict[str, Any]
    folder: Path
    half: float
    middle: tuple[float, float, float]
    first: int
    last: int
    seconds: float
    digests: tuple[str, ...] = ()

    @classmethod
    def of(cls, shot: Shot) -> Genome:
        """Return the genome of a shot that was read from a file. Raises the errors of its subject."""
        assert shot.path is not None, "it was read from a file"
        data = WrittenShot.read(shot.path).source.data
        data = {name: value for name, value in data.items() if name not in INHERITED}
        points = np.concatenate([part.motion.mesh_at_rest().vertices for part in shot.parts])
        low, high = points.min(axis=0), points.max(axis=0)
        clock = shot.motion.clock
        ends = [clock.flow_time(number) for number in clock.frames]
        longest = max(max(ends), 1.0 / float(clock.rate.fps))
        x, y, z = (round(float(value), 3) for value in (low + high) / 2)
        last = clock.frames.first + int(longest * float(clock.rate.fps) + 1e-6)
        half = float((high - low).max()) / 2
        digests = tuple(digest for _, digest in shot.files)
        first = clock.frames.first
        return cls(shot.name, data, shot.path.parent, half, (x, y, z), first, last, longest, digests)

    @property
    def ancestry(self) -> dict[str, Any]:
        """Its own `breed.ancestry`, which may be empty."""
        return (self.data.get("breed") or {}).get("ancestry") or {}

    def copy(self) -> dict[str, Any]:
        """Return the data, which may be changed."""
        return copy.deepcopy(self.data)

    def rebased(self, folder: Path) -> dict[str, Any]:
        """Return the data with file names relative to another folder."""

        def moved(value: Any, name: str = "") -> Any:
            if isinstance(value, dict):
                return {key: moved(item, str(key)) for key, item in value.items()}
            if isinstance(value, list):
                return [moved(item, name) for item in value]
            if isinstance(value, str) and name not in ("title", "intent") and self._is_file(value):
                return Path(os.path.relpath(self.folder / value, folder)).as_posix()
            return value

        rebased: dict[str, Any] = moved(self.data)
        return rebased

    def _is_file(self, word: str) -> bool:
        """Tell whether a text of the shot names a file, or a sequence of them."""
        try:
            return (self.folder / word).is_file() or ("*" in word and any(self.folder.glob(word)))
        except (OSError, ValueError, NotImplementedError):  # the text cannot name a file
            return False


def text_of_shot(data: Mapping[str, Any]) -> str:
    """Return a shot's data as the text of its file: one line for each entry and each flow."""
    names = [*(name for name in ORDER if name in data), *(name for name in data if name not in ORDER)]
    lines: list[str] = []
    for name in names:
        value = data[name]
        if name == "flows" and value:
            lines += ["flows:", *_entries(value, "  ")]
        elif name == "subjects":
            lines += [
                "subjects:",
                *(f"  {to_yaml(key)}: {to_yaml(item)}" for key, item in value.items()),
            ]
        else:
            lines.append(f"{name}: {to_yaml(value)}")
    return "\n".join(lines) + "\n"


def _entries(flows: list[Any], indent: str) -> Iterator[str]:
    """Yield the lines of a list of flows; those that hold others go over several lines."""
    for entry in flows:
        value: Any
        ((name, value),) = entry.items()
        inner: Any = value.get("flows") if isinstance(value, dict) else value
        if not (isinstance(inner, list) and inner and all(isinstance(item, dict) for item in inner)):
            yield f"{indent}- {name}: {to_yaml(value if value is not None else {})}"
        elif inner is value:
            yield f"{indent}- {name}:"
            yield from _entries(inner, f"{indent}    ")
        else:
            yield f"{indent}- {name}:"
            yield from (f"{indent}    {key}: {to_yaml(value[key])}" for key in value if key != "flows")
            yield f"{indent}    flows:"
            yield from _entries(inner, f"{indent}      ")


COMPOSITIONS = ("sequence", "sum", "within", "blend", "placed", "mirrored", "reversed", "repeated")


@dataclass(frozen=True)
class Leaf:
    """A flow of the catalogue in a genome.

    holder  the list or mapping that holds its entry, and `index` where
    name    of the flow
    values  its parameters, which may be changed
    entry   the index of the entry of `flows` that it is in
    """

    holder: list[Any]
    index: int
    name: str
    values: dict[str, Any]
    entry: int

    @property
    def document(self) -> type[FlowParameters]:
        """The document of its parameters."""
        return FLOW_DOCUMENTS[self.name]


def leaves_of(flows: list[Any], entry: int | None = None) -> Iterator[Leaf]:
    """Yield the flows of the catalogue in a list of entries, with those in compositions."""
    for index, item in enumerate(flows):
        ((name, value),) = item.items()
        place = index if entry is None else entry
        if name in COMPOSITIONS:
            yield from leaves_of(value if isinstance(value, list) else value["flows"], place)
        else:
            if not isinstance(value, dict):
                parameter = {"formula": "velocity", "lag": "seconds"}.get(name)
                value = {} if parameter is None or value is None else {parameter: value}
                item[name] = value
            yield Leaf(flows, index, name, value, place)


def flow_lists(data: Mapping[str, Any]) -> list[list[Any]]:
    """Return the lists of flows of a shot and of its subjects that are not empty."""
    subjects = (data.get("subjects") or {}).values()
    lists = [data.get("flows"), *(subject.get("flows") for subject in subjects)]
    return [flows for flows in lists if flows]
