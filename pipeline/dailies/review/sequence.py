"""What can be looked at: a shot's pictures at one quality, in one version, or as one cell of a wedge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.production.keys.digest import Key, key_of
from pipeline.production.keys.stages import STAGES
from render.base.errors import RenderError
from render.post.image import read_header
from render.post.view import ACES, ColourView


@dataclass(frozen=True)
class Screen:
    """What is between the light of pictures and the display of a page.

    exposure   stops
    shown_as   plain data of both, as keys of stills have it
    """

    exposure: float
    view: ColourView
    shown_as: Mapping[str, Any]


PLAIN = Screen(0.0, ACES, {"exposure": 0.0, "view": ACES.recipe})
"""Where the shot that pictures were made from cannot be read any more."""


@dataclass(frozen=True)
class Found:
    """A picture that is there: its file, its key, and what its header says."""

    path: Path
    key: Key
    header: Mapping[str, Any]


@dataclass(frozen=True)
class Pictures:
    """Pictures of one shot, by frame.

    kind      render, version or wedge
    label     what tells it from others of the shot
    subject   what the logs of runs call it
    note      what is to be remembered of it
    numbers   the frames that there should be
    files     those that are there
    told      of frames that are not as the shot file asks for: failed or stale, and why
    seconds   rendering each frame took, by stage, where that is known
    """

    shot: str
    kind: str
    label: str
    quality: str
    subject: str
    numbers: tuple[int, ...]
    files: Mapping[int, Path]
    screen: Screen
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
                faults[number] = "it cannot be read; flowsculpt verify mends it"
        return found, faults

    @property
    def found(self) -> Mapping[int, Found]:
        """The pictures that can be read."""
        return self._read[0]

    def states(self) -> dict[int, tuple[str, str]]:
        """By frame, of those that are not simply there: missing, failed or stale, and why."""
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
        """As `RenderRequest.still_key` has it, so that stills and pages share their files."""
        return key_of(STAGES[form].recipe, self.found[number].key, self.screen.shown_as)
