"""Reading a film file with all its shots: all mistakes in any of them are reported at once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from flowsculpt.pipeline.errors import FlowsculptError, MissingInputError, ShotError, UsageError, suggest
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.shot.documents.curves import SUFFIXES
from flowsculpt.pipeline.shot.documents.picture_documents import PictureShapeDocument
from flowsculpt.pipeline.shot.documents.shot_documents import CardDocument, CardStyleDocument, FilmDocument
from flowsculpt.pipeline.shot.shot import Card, Clip, Film, Shot
from flowsculpt.pipeline.shot.shot_reader import read_rate, read_shot
from flowsculpt.pipeline.shot.yaml.document_validation import Checks, unforeseen, validated
from flowsculpt.pipeline.shot.yaml.inheritance import OPTION
from flowsculpt.pipeline.shot.yaml.named_files import is_edit, name_fault, quote_name, shot_files
from flowsculpt.pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.base.plural import plural
from flowsculpt.render.graphics.title_card import CardStyle
from flowsculpt.render.scene.render_camera import Projection


def read_film(path: str | Path, settings: Iterable[str] = (), text: str | None = None) -> Film:
    """Read the film of a YAML file, or of a text in its place, with all its shots; each takes the settings.

    Raises ShotError with all mistakes in all of the files, and MissingInputError where one is not there.
    """
    path = Path(path)
    if fault := name_fault(path.stem, "edit"):
        raise ShotError(f"{quote_name(path)}:1:1: {fault}")
    with unforeseen(path):
        return _read(YamlSource.read(path, text), tuple(settings))


def _read(source: YamlSource, settings: tuple[str, ...]) -> Film:
    path = source.path
    follows_shots = source.get("rate") is None
    rate, problems = (None, []) if follows_shots else read_rate(source)
    failed: list[FlowsculptError] = []
    entries: list[Clip | Card | None] = []
    own, style = _picture_setting(source.get("picture")), _style(source.get("cards"))
    settings = (own, *settings) if own else settings
    placed: list[tuple[Where, Shot]] = []
    for index, entry in enumerate(source.listing("shots")):
        if isinstance(entry, dict) and "card" in entry:
            entries.append(_card(entry, style))
            continue
        entries.append(None)
        where: Where = ("shots", index)
        name = entry
        if isinstance(entry, dict):
            name, where = entry.get("shot"), (*where, "shot")
        if not isinstance(name, str):
            continue
        try:
            shot = _shot(path.parent, name, source.place(where), settings)
        except (ShotError, MissingInputError) as error:
            failed.append(_at_the_edit(error, own, source) if isinstance(error, ShotError) else error)
            continue
        placed.append((where, shot))
        if rate is None and follows_shots:
            rate = shot.rate
        if rate and shot.rate != rate:
            fact = f"{name} plays at {shot.rate} frames per second and the film at {rate}"
            problems.append((where, f"{fact}; all shots of a film share its rate. Change one of them."))
        try:
            entries[-1] = _clip(shot, entry)
        except UsageError as error:
            problems.append((("shots", index, "frames"), str(error)))
    if entries and all(isinstance(entry, Card) for entry in entries):
        problems.append((("shots",), "shots has cards only; a film shows at least one shot. Add one."))
    problems += _mixed_pictures(placed)
    seconds, default = source.get("title_seconds"), FilmDocument.model_fields["title_seconds"].default
    opening = _card({"card": source.get("title"), "seconds": default if seconds is None else seconds}, style)
    if rate:
        dissolves = list(_dissolves(entries, opening.length(rate) if opening else 0, rate))
        problems += dict(reversed(dissolves)).items()  # the first of each place
    missing = list(_missing_sound(source, path.parent))
    problems += [] if missing else _unreadable_sound(source, path.parent)
    document = validated(Checks(source, problems), FilmDocument, missing, failed)
    title, credits = document.cards_at_the_ends()
    rate = rate or FrameRate.of(24)
    shown = (
        each for each in (title, *entries, credits) if each and (isinstance(each, Clip) or each.shown(rate))
    )
    sound = None if document.sound is None else document.sound.build(path.parent)
    film = Film(document.title, document.subtitle, tuple(shown), rate, sound, path, own)
    return _require_room(source, film)


def _picture_setting(written: Any) -> str:
    """Return the setting that gives shots the picture of an edit; empty where it has none, or a wrong one."""
    try:
        document = PictureShapeDocument.model_validate(written)
    except ValidationError:  # the document of the film reports it
        return ""
    return "" if document.final is None else f"picture={{size: {list(document.final)}}}"


def _at_the_edit(error: ShotError, setting: str, source: YamlSource) -> ShotError:
    """Return the error of a shot with the place of the edit's picture where that is what is wrong."""
    place, begin = source.place(("picture",)), f"{OPTION} {setting}: "
    return ShotError(*(message.replace(begin, f"{place}: ", 1) for message in error.messages))


def _shot(folder: Path, name: str, place: str, settings: tuple[str, ...]) -> Shot:
    """Read a shot of an edit. Raises ShotError, and MissingInputError with its place in the edit."""
    file = folder / f"{name}.yaml"
    if InputFile(file).is_there():
        return read_shot(file, settings=settings)
    known = [shot.stem for shot in shot_files(folder) if not is_edit(shot)]
    hint = suggest(name, known) if known else "No shot is beside the edit; flowsculpt new NAME makes one."
    bare = name.rpartition("/")[2].removesuffix(".yaml")
    if bare in known:
        hint = f"Write {bare}, its name without folder and suffix."
    raise MissingInputError(f"{place}: shot not found: {quote_name(file)}. {hint}")


def _clip(shot: Shot, entry: Any) -> Clip:
    """Return the clip of an entry. Raises UsageError for frames that are no range or not in the shot."""
    dissolve = _frame_count(entry.get("dissolve")) if isinstance(entry, dict) else 0
    if not isinstance(entry, dict) or not isinstance(entry.get("frames"), str):
        return Clip(shot, shot.frames, dissolve)
    frames = FrameRange.parse(entry["frames"])
    outside = frames.outside(shot.frames)
    if outside:
        raise UsageError(
            f"frames {outside} are not in {shot.name}, which has {shot.frames}; show frames among those"
        )
    return Clip(shot, frames, dissolve)


def _card(entry: dict[str, Any], style: CardStyle) -> Card | None:
    """Return the card of an entry; None if its form is wrong, which the document of the film reports."""
    with suppress(ValidationError):
        return CardDocument.model_validate(entry).build(style)
    return None


def _style(written: Any) -> CardStyle:
    """Return how the cards of an edit look; by default where the document of the film reports a fault."""
    with suppress(ValidationError):
        return CardStyleDocument.model_validate(written or {}).style()
    return CardStyle()


def _require_room(source: YamlSource, film: Film) -> Film:
    """Return the film. Raises ShotError where words over pictures need more pictures than it has."""
    over = [each for each in film.entries if isinstance(each, Card) and each.style.over]
    needed, length = sum(card.shown(film.rate) for card in over), film.length
    if needed > length:
        fact = f"words lie over {plural(needed, 'frame')}, and the film has {length}"
        raise ShotError(f"{source.place(('shots',))}: {fact}; give cards fewer seconds, or a ground.")
    return film


def _frame_count(value: Any) -> int:
    """Return a positive count, or 0 for values that the document reports."""
    return value if isinstance(value, int) and not isinstance(value, bool) and value > 0 else 0


def _dissolves(
    entries: Sequence[Clip | Card | None], title_frames: int, rate: FrameRate
) -> Iterator[Problem]:
    """Check that each dissolve has enough frames before it and in its entry, and that two do not overlap.

    entries  in the order of the edit; None for one with problems
    """
    standing = [
        (index, each)
        for index, each in enumerate(entries)
        if not (isinstance(each, Card) and each.style.over)
    ]
    for index, entry in enumerate(entries):
        if isinstance(entry, Card) and not entry.shown(rate):
            yield ("shots", index, "seconds"), "the card is shorter than a frame; give it more seconds."
        elif isinstance(entry, Card) and entry.style.over and entry.dissolve:
            yield ("shots", index, "dissolve"), "words over pictures do not dissolve. Take the dissolve out."
    for place, (index, entry) in enumerate(standing):
        if entry is None:
            continue
        following = standing[place + 1][1] if place + 1 < len(standing) else None
        length, after = entry.length(rate), following.dissolve if following is not None else 0
        where = ("shots", index)
        if entry.dissolve and place == 0 and not title_frames:
            yield (
                (*where, "dissolve"),
                "there is nothing before the first entry to dissolve from. Take the dissolve out, or give "
                "the film a title on a ground.",
            )
        elif entry.dissolve and place == 0 and entry.dissolve > title_frames:
            yield (
                (*where, "dissolve"),
                f"a dissolve of {plural(entry.dissolve, 'frame')} needs as many of the title, which has "
                f"{title_frames}. Shorten it, or raise title_seconds.",
            )
        elif entry.dissolve + after > length:
            both = f"{entry.dissolve} in and {after} out" if entry.dissolve and after else ""
            name = f"the card {entry.title!r}" if isinstance(entry, Card) else entry.shot.name
            yield (
                ("shots", index if entry.dissolve else standing[place + 1][0], "dissolve"),
                f"{name} shows {plural(length, 'frame')}, and {both or entry.dissolve or after} are to "
                "dissolve. Shorten that, or show more frames.",
            )


def _mixed_pictures(placed: Sequence[tuple[Where, Shot]]) -> Iterator[Problem]:
    """Check that the shots of a film, each with its place, have projection and size of the first."""
    for where, shot in placed[1:]:
        first = placed[0][1]
        common, projection = (each.picture.camera.projection for each in (first, shot))
        one, size = (list(each.picture.qualities["final"].rendered_size) for each in (first, shot))
        if projection != common:
            yield (
                where,
                f"{shot.name} has projection {_words(projection)}, and {first.name} {_words(common)}; all "
                "shots of a film share one. Change one of them, or make a film of each.",
            )
        elif size != one:
            yield (
                where,
                f"{shot.name} has pictures of {size} pixels in final, and {first.name} of {one}; all shots "
                f"of a film share one size. Write picture: {{size: {one}}} in the edit.",
            )


def _words(projection: Projection) -> str:
    """Return a projection in words: `dome of 180°`."""
    angle = f" of {math.degrees(projection.angle):.4g}°" if projection.kind == "dome" else ""
    return projection.kind + angle


def _missing_sound(source: YamlSource, folder: Path) -> Iterator[Problem]:
    name = source.get("sound", "file")
    if isinstance(name, str) and not InputFile(folder / name).is_there():
        known = sorted(file.name for file in folder.glob("[!.]*") if file.suffix.lower() in SUFFIXES)
        remedy = "and no other beside the edit. Put it there, or remove sound."
        if known:
            remedy = f"which is looked for beside the edit. {suggest(name, known)}"
        yield ("sound", "file"), f"sound not found: {quote_name(folder / name)}, {remedy}"


def _unreadable_sound(source: YamlSource, folder: Path) -> Iterator[Problem]:
    name = source.get("sound", "file")
    if not isinstance(name, str):
        return
    from flowsculpt.render.movie.movie_sound import require_sound  # imports PyAV, which takes time

    try:
        require_sound(folder / name)
    except FlowsculptError as error:
        yield ("sound", "file"), f"{error}"
