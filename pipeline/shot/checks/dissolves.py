"""What dissolves and sound of an edit must obey beyond the form of their values."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline.errors import suggestion
from pipeline.frames import FrameRate
from pipeline.shot.checks.file_checks import Problem
from pipeline.shot.shot import Card, Clip
from pipeline.shot.yaml.lookup import is_there, shown
from pipeline.shot.yaml.source import Source

SOUNDS = (".wav", ".flac", ".aif", ".aiff", ".mp3", ".m4a", ".ogg", ".opus")
"""What files of sound are called; any that FFmpeg reads will do."""


def dissolves(entries: Sequence[Clip | Card | None], title_frames: int, rate: FrameRate) -> Iterator[Problem]:
    """Each dissolve has something before it to come through, and room; those of an entry do not meet.

    entries  in the order of the edit; None for one that is wrong itself
    """
    for index, entry in enumerate(entries):
        if entry is None:
            continue
        length, after = entry.length(rate), _dissolve(entries, index + 1)
        where = ("shots", index)
        if length == 0:
            yield (*where, "seconds"), "the card stands for less than a frame; give it more seconds."
        elif entry.dissolve and index == 0 and not title_frames:
            yield (
                (*where, "dissolve"),
                "there is nothing before the first entry to dissolve from. Take the dissolve out, or give "
                "the film a title.",
            )
        elif entry.dissolve and index == 0 and entry.dissolve > title_frames:
            yield (
                (*where, "dissolve"),
                f"a dissolve of {entry.dissolve} frames needs as many of the title, which stands for "
                f"{title_frames}. Shorten it, or raise title_seconds.",
            )
        elif entry.dissolve + after > length:
            both = f"{entry.dissolve} in and {after} out" if entry.dissolve and after else ""
            lost = both or entry.dissolve or after
            yield (
                ("shots", index if entry.dissolve else index + 1, "dissolve"),
                f"{_name(entry)} shows {length} frames, and {lost} are to dissolve. "
                "Shorten that, or show more frames.",
            )


def _dissolve(entries: Sequence[Clip | Card | None], index: int) -> int:
    following = entries[index] if index < len(entries) else None
    return following.dissolve if following is not None else 0


def _name(entry: Clip | Card) -> str:
    return f"the card {entry.title!r}" if isinstance(entry, Card) else entry.shot.name


def sound(source: Source, folder: Path) -> Iterator[tuple[bool, Problem]]:
    """What is wrong with the file of sound; whether it is that it is missing."""
    name = source.get("sound", "file")
    if not isinstance(name, str):
        return
    where = ("sound", "file")
    path = folder / name
    if not is_there(path):
        known = sorted(file.name for file in folder.glob("*") if file.suffix.lower() in SOUNDS)
        hint = suggestion(name, known) if known else "There are none."
        yield True, (where, f"there is no sound {shown(path)}; it is looked for beside the edit. {hint}")
        return
    from render.base.errors import RenderError
    from render.movie.sound import require_sound

    try:
        require_sound(path)
    except RenderError as error:
        yield False, (where, f"{error}")
