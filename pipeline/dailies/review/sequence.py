"""Sequences on a page: a shot at one quality, a published version, or a cell of a wedge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.production.stages import STAGES
from pipeline.production.store.store import Key, key_of
from render.base.errors import RenderError
from render.post.image import read_header
from render.post.view import ACES, ColourView


@dataclass(frozen=True)
class PictureDisplay:
    """The exposure (stops) and view transform of a page's pictures.

    shown_as   both as plain data, for the keys of stills
    """

    exposure: float
    view: ColourView
    shown_as: Mapping[str, Any]


PLAIN = PictureDisplay(0.0, ACES, {"exposure": 0.0, "view": ACES.recipe})
"""The display of pictures whose shot cannot be read."""


@dataclass(frozen=True)
class Found:
    """A picture that is there: its file, its key, and what its header says."""

    path: Path
    key: Key
    header: Mapping[str, Any]


@dataclass(frozen=True)
class PictureSequence:
    """A sequence of pictures of one shot, by frame.

    kind      render, version or wedge
    label     distinguishes it from other sequences of the shot
    subject   its name in event logs
    note      the note of a published version
    numbers   all frames of the sequence
    files     frames that are rendered
    told      frames that failed or are stale, with the reason
    seconds   seconds of rendering by frame and part, where they are known
    """

    shot: str
    kind: str
    label: str
    quality: str
    subject: str
    numbers: tuple[int, ...]
    files: Mapping[int, Path]
    display: PictureDisplay
    told: Mapping[int, tuple[str, str]]
    seconds: Mapping[int, Mapping[str, float]]
    note: str = ""

    @cached_property
    def _read(self) -> tuple[dict[int, Found], dict[int, str]]:
        found: dict[int, Found] = {}
        faults: dict[int, str] = {}
        for number, path in self.files.items():
            try:
                header = read_header(path)
                found[number] = Found(path, str(header["key"]), header)
            except (RenderError, KeyError):
                faults[number] = "it cannot be read; flowsculpt verify repairs it"
        return found, faults

    @property
    def found(self) -> Mapping[int, Found]:
        """Pictures that can be read."""
        return self._read[0]

    def states(self) -> dict[int, tuple[str, str]]:
        """Return by frame the state and the reason of frames that are missing, failed or stale."""
        found, faults = self._read
        states: dict[int, tuple[str, str]] = {}
        for number in self.numbers:
            state, why = self.told.get(number, ("", ""))
            if number in faults:
                states[number] = "failed", faults[number]
            elif number not in found:
                states[number] = ("failed", why) if state == "failed" else ("missing", "it is not rendered")
            elif state == "stale":
                states[number] = state, why
        return states

    def still_key(self, form: str, number: int) -> Key:
        """The key of a still, the same as `RenderRequest.still_key`, so that both share their files."""
        return key_of(STAGES[form].recipe, self.found[number].key, self.display.shown_as)
