"""From a file to a film, with all its shots: everything wrong with any of them is told at once."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pipeline.errors import FlowsculptError, MissingInputError, ShotError, UsageError, suggestion
from pipeline.frames import FrameRange, FrameRate
from pipeline.shot import checks
from pipeline.shot.documents import FilmDocument
from pipeline.shot.edits import DEFAULTS, is_edit
from pipeline.shot.named_files import is_there, shown
from pipeline.shot.parse import parsed
from pipeline.shot.read import read_shot
from pipeline.shot.shot import Clip, Film, Shot
from pipeline.shot.source import Source, Where


def read_film(path: str | Path, settings: Iterable[str] = ()) -> Film:
    """The film of a YAML file, with all its shots read, and settings put in each of them.

    Raises ShotError with everything wrong in all of the files, and MissingInputError where one is not there.
    """
    path, settings = Path(path), tuple(settings)
    source = Source.read(path)
    problems: list[tuple[Where, str]] = []
    clips: list[Clip] = []
    failed: list[FlowsculptError] = []
    rate, found = checks.read_rate(source)
    problems += found
    entries = source.get("shots")
    for index, entry in enumerate(entries if isinstance(entries, list) else []):
        name, where = _named(entry, ("shots", index))
        if not isinstance(name, str):
            continue
        file = path.parent / f"{name}.yaml"
        if not is_there(file):
            known = sorted(
                f.stem for f in path.parent.glob("*.yaml") if not is_edit(f) and f.name != DEFAULTS
            )
            hint = suggestion(name, known) if known else "There are none."
            failed.append(MissingInputError(f"{source.place(where)}: there is no shot {shown(file)}. {hint}"))
            continue
        try:
            shot = read_shot(file, settings=settings)
        except (ShotError, MissingInputError) as error:
            failed.append(error)
            continue
        if rate and shot.rate != rate:
            problems.append(
                (
                    where,
                    f"{name} plays at {shot.rate} frames per second and the film at {rate}; "
                    "all shots of a film share its rate. Change one of them.",
                )
            )
        try:
            clips.append(_clip(shot, entry))
        except UsageError as error:
            problems.append((("shots", index, "frames"), str(error)))
    document = parsed(source, FilmDocument, problems, [], failed)
    return Film(
        title=document.title,
        subtitle=document.subtitle,
        credits=tuple(document.credits),
        clips=tuple(clips),
        rate=FrameRate.of(document.rate),
        title_seconds=float(document.title_seconds),
        credits_seconds=float(document.credits_seconds),
        path=path,
    )


def _named(entry: Any, where: Where) -> tuple[Any, Where]:
    """The shot that an entry of an edit names, and where."""
    return (entry.get("shot"), (*where, "shot")) if isinstance(entry, dict) else (entry, where)


def _clip(shot: Shot, entry: Any) -> Clip:
    """Raises UsageError where the entry's frames are no range, or not in the shot."""
    if not isinstance(entry, dict) or not isinstance(entry.get("frames"), str):
        return Clip(shot, shot.frames)
    frames = FrameRange.parse(entry["frames"])
    outside = frames.outside(shot.frames)
    if outside:
        raise UsageError(
            f"frames {outside} are not in {shot.name}, which has {shot.frames}; show frames among those"
        )
    return Clip(shot, frames)
