"""Checks of overrides: look, lights and quality of some frames of a shot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from pipeline.errors import UsageError
from pipeline.frames import FrameRange
from pipeline.shot.documents.bsdf import bsdf_problems
from pipeline.shot.picture_checks import clear_look, dimmed, noise_threshold
from pipeline.shot.yaml.source import Problem, Where, YamlSource
from render.scene.materials import LOOKS
from render.scene.measure import Measure
from render.scene.quality import QUALITIES


@dataclass(frozen=True)
class _OverriddenSource:
    """A shot file as it is for the frames of one override: `get` is that of `YamlSource`."""

    source: YamlSource
    index: int

    @property
    def path(self) -> Path:
        return self.source.path

    def has(self, *where: Any) -> bool:
        """Tell whether the override has this value, or look or lights of which it is a part."""
        whole = where[:1] if where[0] in ("look", "lights") else where
        return self.source.get("overrides", self.index, *whole) is not None

    def get(self, *where: Any) -> Any:
        return (
            self.source.get("overrides", self.index, *where) if self.has(*where) else self.source.get(*where)
        )

    def written_path(self, where: Where) -> Where:
        return where


def overrides(source: YamlSource) -> Iterator[Problem]:
    """Check the frames of overrides, and their looks, lights and qualities as those of the shot."""
    written = source.get("overrides")
    taken: dict[int, int] = {}
    for index, override in enumerate(written if isinstance(written, list) else ()):
        if not isinstance(override, dict):
            continue
        yield from _overridden_frames(source, index, taken)
        yield from _whole_shot_only(source, index)
        seen = _OverriddenSource(source, index)
        for check in (clear_look, bsdf_problems, dimmed, noise_threshold):
            for where, text in check(cast(YamlSource, seen)):
                if seen.has(*where):
                    yield ("overrides", index, *where), text


def _overridden_frames(source: YamlSource, index: int, taken: dict[int, int]) -> Iterator[Problem]:
    """Check that frames are in the shot, and in no override before; note them in `taken`."""
    where, text = ("overrides", index, "frames"), source.get("overrides", index, "frames")
    if not isinstance(text, str | int) or isinstance(text, bool):
        return  # the document reports it
    try:
        frames = FrameRange.parse(str(text))
        whole = FrameRange.parse(str(source.get("frames")))
    except UsageError as error:
        yield where, str(error)
        return
    if outside := frames.outside(whole).numbers:
        yield (
            where,
            f"frames {FrameRange.of(outside)} are not in the shot, which has {whole}. Write frames of it.",
        )
    if both := [number for number in frames if number in taken]:
        yield (
            where,
            f"frames {FrameRange.of(both)} are in overrides.{taken[both[0]]} too; a frame has one override. "
            "Take them out of one.",
        )
    taken.update(dict.fromkeys(frames, index))


def _whole_shot_only(source: YamlSource, index: int) -> Iterator[Problem]:
    """Check that an override has nothing that all frames of a shot share."""
    where: Where = ("overrides", index)
    if source.get(*where, "lights", "exposure") is not None:
        yield (
            (*where, "lights", "exposure"),
            "exposure belongs to the display of the whole shot. Change the intensity of the lights.",
        )
    for quality in QUALITIES:
        for setting in ("denoise", "temporal_denoise"):
            if source.get(*where, "quality", quality, setting) is not None:
                yield (
                    (*where, "quality", quality, setting),
                    f"{setting} belongs to the whole shot: denoising reads frames beside. Write it there.",
                )
    if source.get(*where, "lights") is not None and source.get("light_groups") not in (None, "off"):
        yield (
            (*where, "lights"),
            "light_groups are layers that all frames have, of the same lights. Remove lights here, or "
            "light_groups.",
        )
    look = source.get(*where, "look")
    name = look.get("material") if isinstance(look, dict) else look
    known = LOOKS.get(name) if isinstance(name, str) else None
    if known is not None and (not known.is_lit or isinstance(known.pattern, Measure)):
        what = "shows measures of the motion" if known.is_lit else "is drawn without lights"
        yield (*where, "look"), f"look {name} {what}, which all frames of a shot share. Take another look."
