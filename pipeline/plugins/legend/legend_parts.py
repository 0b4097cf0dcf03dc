"""The parts of a legend, drawn over a finished frame: the palette, the date, and a scale.

Those in one corner stand above one another. In corners on the right, texts end at the margin: digits have one
width, so those that change quickly stay where they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from flowsculpt import FrameError, Streamlines
from flowsculpt.api.flows import Sampled, number_at
from flowsculpt.api.pictures import Camera, RenderedFrame
from flowsculpt.api.shots import Shot
from flowsculpt.pipeline.plugins.legend.drawn_parts import DrawnPart, Ink, LegendType, laid_over
from flowsculpt.pipeline.plugins.legend.numbers_in_words import (
    IN_FONT,
    date_text,
    marks,
    round_length,
    written,
)

PARTS = ("legend.colours", "legend.clock", "legend.scale")
"""Entries in the order in which they stand, the first next to the edge."""

MARGIN = 0.052  # of the shorter side
GAP = 1.5  # between parts in a corner, in sizes of letters

LIGHT_STAGE = 0.15  # reflectance from which a stage is lighter than dark ink reads on


def draw_colours(frame: RenderedFrame, entry: Any, number: int) -> RenderedFrame:
    """Draw the palette of the look over a frame."""
    return _drawn(frame, "legend.colours", number)


def draw_clock(frame: RenderedFrame, entry: Any, number: int) -> RenderedFrame:
    """Draw the date of the data over a frame."""
    return _drawn(frame, "legend.clock", number)


def draw_scale(frame: RenderedFrame, entry: Any, number: int) -> RenderedFrame:
    """Draw a scale over a frame."""
    return _drawn(frame, "legend.scale", number)


def _drawn(frame: RenderedFrame, name: str, number: int) -> RenderedFrame:
    shot, camera, (width, height) = (frame.facts[each] for each in ("shot", "camera", "whole"))
    if not isinstance(camera, Camera):
        raise FrameError(
            "a legend has no place in a picture without corners, as of a spherical camera. Leave it out."
        )
    entry = shot.entries[name]
    part = _part(name, shot, camera, number, width, height)
    margin = MARGIN * min(width, height)
    before = 0.0
    for other in PARTS[: PARTS.index(name)]:
        if (earlier := shot.entries.get(other)) is not None and earlier.place == entry.place:
            letters = LegendType.of(earlier.size, width, height)
            before += _part(other, shot, camera, number, width, height).height + GAP * letters.size
    upper, right = entry.place.startswith("upper"), entry.place.endswith("right")
    x = width - margin - part.width if right else margin
    y = margin + before if upper else height - margin - before - part.height
    left, top = frame.facts["corner"]
    light, alpha = laid_over(frame["beauty"], frame["alpha"], part, (round(x) - left, round(y) - top))
    return replace(frame, arrays={**frame.arrays, "beauty": light, "alpha": alpha})


def _part(name: str, shot: Shot, camera: Camera, number: int, width: int, height: int) -> DrawnPart:
    entry = shot.entries[name]
    letters, ink = LegendType.of(entry.size, width, height), _ink(shot, entry.ink)
    if name == "legend.colours":
        return _colours(shot, entry, letters, ink)
    if name == "legend.clock":
        return letters.line(_clock(shot, number), ink)
    return _scale(shot, entry, camera, number, width, letters, ink)


def _ink(shot: Shot, given: str | None) -> Ink:
    """Return the ink that a shot names, else the one that reads on its stage or under its sky."""
    stage = shot.picture.stage
    behind = np.array(stage.wall_colour or stage.colour) @ (0.2126, 0.7152, 0.0722)
    is_dark = given == "dark" or (given is None and (behind > LIGHT_STAGE or stage.kind == "none"))
    return Ink.DARK if is_dark else Ink.LIGHT


def _colours(shot: Shot, entry: Any, letters: LegendType, ink: Ink) -> DrawnPart:
    for part in shot.parts:
        pattern: Any = part.picture.look.pattern
        if hasattr(pattern, "range"):
            break
    else:
        raise FrameError("legend: colours needs a look with a measure. Add one, or leave colours out.")
    animated = part.motion.animated
    known = {} if animated is None or pattern.of != "values" else animated.model.sequence.facts(0.0)
    label = entry.label if entry.label is not None else known.get("values", pattern.of)
    unit = entry.unit if entry.unit is not None else known.get("unit", pattern.kind.unit)
    low, high = pattern.range
    places = marks(low, high, pattern.is_logarithmic)
    texts = [(place, written(value, places)) for value, place in places]
    label, unit = (text.translate(IN_FONT) for text in (_capital(label), unit))
    return letters.palette(label, unit, pattern.ramp(), texts, ink)


def _capital(label: str) -> str:
    return label[:1].upper() + label[1:]


def _clock(shot: Shot, number: int) -> str:
    """Return what the clock shows."""
    clock = shot.motion.clock
    now, then = (clock.flow_time(each) for each in (number, number + 1))
    date, later = (_facts(shot, each).get("date", "") for each in (now, then))
    if date:
        return date_text(date, later)
    return f"{now:.1f} s"


def _facts(shot: Shot, seconds: float) -> Mapping[str, Any]:
    """Return the date and the length of a unit in the data of a shot, where they have them."""
    for part in shot.parts:
        animated = part.motion.animated
        if animated is not None and (facts := animated.model.sequence.facts(seconds)):
            return facts
        fields = [each.field for each in part.motion.flow.members if isinstance(each, Streamlines)]
        for leaf in (leaf for field in fields for leaf, _ in field.leaves(np.zeros(3), 0.0)):
            if isinstance(leaf, Sampled):
                return _facts_of(leaf, seconds)
    return {}


def _facts_of(sampled: Sampled, seconds: float) -> dict[str, Any]:
    date = sampled.samples.date(sampled.seconds(seconds))
    metre = sampled.samples.metre
    return {"date": date, **({"metres": 1.0 / (metre * number_at(sampled.scale, seconds))} if metre else {})}


def _scale(
    shot: Shot, entry: Any, camera: Camera, number: int, width: int, letters: LegendType, ink: Ink
) -> DrawnPart:
    depth = float(camera.depths(np.array([camera.target]))[0])
    unit = 1.0 / (camera.pixel_size(width) * depth)  # pixels
    metres = _facts(shot, shot.motion.clock.flow_time(number)).get("metres")
    length, text = round_length(letters.scale_width / unit, metres, entry.unit)
    return letters.scale(length * unit, text, ink, entry.place.endswith("right"))
