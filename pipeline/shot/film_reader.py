"""From a file to a film, with all its shots: everything wrong with any of them is told at once."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pipeline.errors import FlowsculptError, MissingInputError, ShotError, UsageError, suggestion
from pipeline.frames import FrameRange, FrameRate
from pipeline.shot.checks import file_checks as checks
from pipeline.shot.checks.dissolves import dissolves, sound
from pipeline.shot.documents.fields import is_number
from pipeline.shot.documents.shot import FilmDocument, SoundDocument
from pipeline.shot.shot import Card, Clip, Film, Shot, SoundTrack
from pipeline.shot.shot_reader import read_shot
from pipeline.shot.yaml.lookup import DEFAULTS, digest_of_file, is_edit, is_there, shown
from pipeline.shot.yaml.messages import parsed
from pipeline.shot.yaml.source import Source, Where


def read_film(path: str | Path, settings: Iterable[str] = (), text: str | None = None) -> Film:
    """The film of a YAML file, or of a text as if it stood there, with all its shots read, and settings put
    in each of them.

    Raises ShotError with everything wrong in all of the files, and MissingInputError where one is not there.
    """
    path, settings = Path(path), tuple(settings)
    source = Source.read(path, text)
    problems: list[tuple[Where, str]] = []
    failed: list[FlowsculptError] = []
    rate, found = checks.read_rate(source)
    problems += found
    entries: list[Clip | Card | None] = []
    listed = source.get("shots")
    for index, entry in enumerate(listed if isinstance(listed, list) else []):
        if isinstance(entry, dict) and "card" in entry:
            entries.append(_card(entry))
            continue
        entries.append(None)
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
            entries[-1] = _clip(shot, entry)
        except UsageError as error:
            problems.append((("shots", index, "frames"), str(error)))
    title = Card(str(source.get("title") or ""), seconds=_seconds(source.get("title_seconds")))
    if rate:
        problems += dissolves(entries, title.length(rate) if title.title else 0, rate)
    missing: list[tuple[Where, str]] = []
    for is_missing, problem in sound(source, path.parent):
        (missing if is_missing else problems).append(problem)
    document = parsed(source, FilmDocument, problems, missing, failed)
    return Film(
        title=document.title,
        subtitle=document.subtitle,
        credits=tuple(document.credits),
        entries=tuple(entry for entry in entries if entry is not None),
        rate=FrameRate.of(document.rate),
        title_seconds=float(document.title_seconds),
        credits_seconds=float(document.credits_seconds),
        sound=_sound(document.sound, path.parent),
        path=path,
    )


def _named(entry: Any, where: Where) -> tuple[Any, Where]:
    """The shot that an entry of an edit names, and where."""
    return (entry.get("shot"), (*where, "shot")) if isinstance(entry, dict) else (entry, where)


def _clip(shot: Shot, entry: Any) -> Clip:
    """Raises UsageError where the entry's frames are no range, or not in the shot."""
    dissolve = _whole(entry.get("dissolve")) if isinstance(entry, dict) else 0
    if not isinstance(entry, dict) or not isinstance(entry.get("frames"), str):
        return Clip(shot, shot.frames, dissolve)
    frames = FrameRange.parse(entry["frames"])
    outside = frames.outside(shot.frames)
    if outside:
        raise UsageError(
            f"frames {outside} are not in {shot.name}, which has {shot.frames}; show frames among those"
        )
    return Clip(shot, frames, dissolve)


def _card(entry: dict[str, Any]) -> Card | None:
    """None where its form is wrong, which the document tells."""
    title, subtitle, seconds = entry["card"], entry.get("subtitle", ""), entry.get("seconds", 2.0)
    if not (
        isinstance(title, str) and isinstance(subtitle, str) and is_number(seconds) and 0 < seconds <= 60
    ):
        return None
    return Card(title, subtitle, float(seconds), _whole(entry.get("dissolve")))


def _sound(document: SoundDocument | None, folder: Path) -> SoundTrack | None:
    if document is None:
        return None
    file = (folder / document.file).absolute()
    values = document.model_dump(exclude={"file"})
    return SoundTrack(file, digest_of_file(file), **{name: float(value) for name, value in values.items()})


def _whole(value: Any) -> int:
    """A count as it is; what is none counts nothing here, and the document tells."""
    return value if isinstance(value, int) and not isinstance(value, bool) and value > 0 else 0


def _seconds(value: Any) -> float:
    default: float = FilmDocument.model_fields["title_seconds"].default
    return float(value) if is_number(value) and 0 <= value <= 60 else default
