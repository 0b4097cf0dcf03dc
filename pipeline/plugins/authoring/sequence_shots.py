"""New shots of moving meshes of other programs: numbered files, or a file with an animation."""

from __future__ import annotations

import os
import re
from itertools import pairwise
from pathlib import Path

from flowsculpt import MissingInputError, UsageError
from flowsculpt.api import plural
from flowsculpt.api.frames import Show
from flowsculpt.api.meshes import ModelFile
from flowsculpt.api.shots import PRESETS, read_shot, to_yaml
from flowsculpt.pipeline.plugins.authoring.shot_templates import FIT, choice, title_of

_DIGITS = re.compile(r"-?\d+(?=\D*$)")
"""The number of a file: the last digits of its name without the suffix."""

MARKS = re.compile(r"#+|%0?\d*d|\$F\d*")
"""Marks that stand for a number in names of other programs: `fluid_####.ply`, Houdini's `fluid_$F4.ply`."""

SHOT = """\
title: {title}
frames: {frames}
{about}
subject: {subject}
# resample: {{max_edge_length: 0.05}}  # a finer surface on the same faces; flows act on it too
look: clay
camera: {{azimuth: 25, elevation: 12}}
lights: {lights}
stage: {stage}
shutter: {{angle: 180}}  # motion blur
"""


def shot_of_sequence(sequence: str, name: str) -> tuple[str, list[str]]:
    """Return the text of a new shot of a moving mesh, and lines to tell about it.

    sequence  a pattern of numbered files, as cache/*.ply or cache/fluid_####.ply; or a file with an animation

    Raises UsageError where it names no sequence, and what `read_shot` raises where it cannot be read.
    """
    path = Path(sequence)
    numbered = _numbered(path)
    if numbered is None:
        place, frames, facts = _animation(path)
        more = ""
    else:
        place, numbers = numbered
        step = min((b - a for a, b in pairwise(numbers)), default=1)
        more = "" if numbers[0] >= 0 and step == 1 else f", start: {numbers[0]}"
        more += ", rate: 24" if step > 1 else ""
        count = (numbers[-1] - numbers[0]) // step + 1
        frames = f"1-{count}" if more else f"{numbers[0]}-{numbers[-1]}"
        facts = f"{plural(len(numbers), 'file')}, numbered {numbers[0]} to {numbers[-1]}"
        more += ", missing: hold" if count > len(numbers) else ""
    reference = Path(os.path.relpath(place.absolute(), Show().folder.resolve())).as_posix()

    def text_with(named: str) -> str:
        subject = to_yaml({"sequence": named}).strip("{}")
        return SHOT.format(
            title=title_of(name),
            frames=frames,
            about=f"# {facts}. If the model lies on its face, its files have z up: add up: z.",
            subject=f"{{{subject}{more}, fit: {FIT:g}}}",
            lights=choice(PRESETS["lights"]),
            stage=choice(PRESETS["stage"]),
        )

    shot = read_shot(Path(f"{name}.yaml"), text_with(str(place.absolute())))  # shots/ may not be there yet
    return text_with(reference), [
        f"{sequence} stays where it is; the shot names it {reference}",
        *shot.motion.subject.notes,
    ]


def _numbered(path: Path) -> tuple[Path, list[int]] | None:
    """Return the pattern of numbered files, and their numbers in order; None for a name of one file."""
    if (shape := MARKS.sub("*", path.name)) == path.name and "*" not in shape:
        return None
    try:
        files = [file for file in path.parent.glob(shape) if not file.name.startswith(".")]
    except (OSError, ValueError):
        files = []
    found = {file.name: match for file in files if (match := _DIGITS.search(file.stem))}
    if not found:
        raise MissingInputError(f"no numbered file matches {path}. Write it in quotes, as 'cache/*.ply'.")
    kinds = {(name[: match.start()], name[match.end() :]) for name, match in found.items()}
    if len(kinds) > 1:
        one, other = (f"{before}#{after}" for before, after in sorted(kinds)[:2])
        raise UsageError(f"{path} matches {one} and {other}, which are two sequences. Write one of them.")
    ((before, after),) = kinds
    written = [match[0] for match in found.values()]
    digits = min(map(len, [each for each in written if each[0] != "-"] or written))
    numbers = sorted(int(match[0]) for match in found.values())
    if twice := [a for a, b in pairwise(numbers) if a == b]:
        raise UsageError(f"{path} matches two files that are both number {twice[0]}. Remove one.")
    return path.parent / f"{before}{'#' * digits}{after}", numbers


def _animation(path: Path) -> tuple[Path, str, str]:
    """Return the path of a file with an animation, its frames, and a fact about it."""
    moving = ModelFile(path).motion()
    try:
        seconds, rate = float(moving.times[-1] - moving.times[0]), moving.rate or 24.0
    finally:
        moving.close()
    return (
        path,
        f"1-{max(1, round(24.0 * seconds) + 1)}",
        f"{seconds:.4g} s, {rate:g} frames a second in the file",
    )
