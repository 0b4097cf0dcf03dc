"""The commands `review`, a page to look at shots in any browser, and `notes`, what reviewers wrote on it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from flowsculpt import UsageError
from flowsculpt.api import plural
from flowsculpt.api.commands import (
    empty_table,
    print_result,
    print_warning,
    progress_bars,
    require_one_of,
    size_words,
)
from flowsculpt.api.frames import Locks, QualityName, Show
from flowsculpt.api.options import Common, Shot, ShotOptions, shared_option
from flowsculpt.api.shots import NAME_PATTERN
from flowsculpt.pipeline.plugins.review.measures import Crossings
from flowsculpt.pipeline.plugins.review.review_notes import STATUSES, NotesFolder, ReviewNote, as_data, merged
from flowsculpt.pipeline.plugins.review.review_page import ReviewPage, Search

FORMS = ("jpeg", "png")

NotesFiles = Annotated[
    list[Path] | None,
    typer.Option("--notes", metavar="FILE", help="Merge notes that the page downloaded. Repeatable."),
]


def review(
    common: Common,
    shots: Annotated[
        list[str], typer.Argument(metavar="SHOT", help="Names in shots/, or paths of shot files.")
    ],
    options: ShotOptions,
    qualities: Annotated[
        list[str] | None,
        shared_option(
            "quality",
            f"Show only this quality, of {', '.join(QualityName.names())}. Repeatable. Default: all.",
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="The folder of the page. Default: the names of the shots."),
    ] = None,
    form: Annotated[
        str, typer.Option("--as", metavar="FORM", help=f"Pictures as {' or '.join(FORMS)}; png is lossless.")
    ] = FORMS[0],
    models: Annotated[
        int,
        typer.Option(
            min=0, metavar="N", help="Simulated frames of each shot in the 3-D view; 0: no motion either."
        ),
    ] = 24,
    layers: Annotated[
        int,
        typer.Option(min=0, metavar="N", help="Frames of each sequence with linear layers for the probe."),
    ] = 0,
    crossings: Crossings = False,
    notes: NotesFiles = None,
) -> None:
    """Write a page for reviewing shots: frame by frame, versions side by side, measures and meshes.

    `flowsculpt review A010_cube` writes renders/review/A010_cube with the rendered frames of the shot, its
    published versions and its wedges. Open index.html in any browser: it needs no server and no network, and
    the folder may be copied. Press ? on the page for its keys. The second time only new pictures are added.

    `flowsculpt review A010_cube --notes ann.json --notes ben.json` merges the notes that two reviewers
    downloaded into notes/A010_cube.json, and shows them.
    """
    require_one_of(form, FORMS, f"--as {form}: pictures of a page are {' or '.join(FORMS)}.")
    for each in shots:
        if each.endswith(".json"):
            raise UsageError(f"{each}: --notes takes one file; write it before each file, shots without")
    project = options.project(common)
    search = Search(project, tuple(qualities or ()))
    try:
        material = [search.shot(shot) for shot in dict.fromkeys(shots)]
    finally:
        for note in dict.fromkeys(project.notes):
            print_warning(note)
    folder = NotesFolder(common.root)
    added = folder.add(notes or (), common.dry_run)
    written = merged(*(folder.notes(shot.request.name) for shot in material))
    title = _title(name, [shot.request.name for shot in material])
    page = ReviewPage(title, project.store, material, form, models, common.cores, crossings, written, layers)
    if common.dry_run:
        counts = {"sequences": len(page.sequences), "pictures": sum(len(s.pictures) for s in page.sequences)}
    else:
        with Locks(common.root).hold_with_writers(common.wait), progress_bars(common.progress) as bar:
            counts = page.write(bar("making the page", page.steps), bar)
    if hint := page.three_js[1]:
        print_warning(hint)
    verb = " would show" if common.dry_run else ""
    shown = f"{plural(counts['sequences'], 'sequence')}, {plural(counts['pictures'], 'picture')}"
    live = sum(not note.deleted for note in written)
    shown += f", {plural(live, 'note')}" if live else ""
    if counts.get("frames_with_layers"):
        held = size_words(counts["layer_bytes"])
        shown += f", layers of {plural(counts['frames_with_layers'], 'frame')} ({held})"
    words = f"{page.index}:{verb} {shown}."
    missing = {f"{s.shot} {s.label}": sorted(s.states()) for s in page.sequences if s.states()}
    about_notes = {"notes": live, "notes_added": added}
    facts = {"page": str(page.index), **counts, **about_notes, "not_as_asked_for": missing}
    print_result(words, facts, common.json)


def _title(name: str | None, shots: list[str]) -> str:
    """Return the name of the page's folder. Raises UsageError."""
    if name is None:
        whole = "+".join(shots)
        return whole if len(whole) <= 60 else f"{shots[0]}+{len(shots) - 1}"
    if not re.fullmatch(NAME_PATTERN, name):
        raise UsageError(f"--name {name}: a page has letters, digits, _, - and . in its name, as monday")
    return name


def notes(
    common: Common,
    shot: Shot,
    add: Annotated[
        list[Path] | None,
        typer.Option("--add", metavar="FILE", help="First merge notes that the page downloaded. Repeatable."),
    ] = None,
    status: Annotated[
        str | None,
        typer.Option("--status", metavar="NAME", help=f"List only notes that are {', '.join(STATUSES)}."),
    ] = None,
) -> None:
    """List the notes of a shot: frames, status, author, time and words.

    Reviewers write them on the page of `flowsculpt review A010_cube`, and download a file. `flowsculpt notes
    A010_cube --add ann.json --add ben.json` merges such files into notes/A010_cube.json, in any order and
    any number of times. `--json` includes drawings, deleted notes and earlier revisions.
    """
    if status is not None:
        require_one_of(status, STATUSES, f"--status {status}: a note is {', '.join(STATUSES)}.")
    name, folder = Show().find_shot(shot).stem, NotesFolder(common.root)
    added = folder.add(add or (), common.dry_run)
    found = [note for note in folder.notes(name) if status in (None, note.status)]
    live = sorted((note for note in found if not note.deleted), key=lambda note: (note.sequence, note.first))
    listing = empty_table("sequence", "frames", "status", "by", "time (UTC)", "note")
    for note in live:
        listing.add_row(*_row(note))
    kind = f"{status} notes" if status else "notes"
    none = f"{name} has no {kind}; flowsculpt review {name} writes the page for taking them."
    facts = {"path": str(folder.path(name)), "added": added, **as_data(found)}
    print_result(listing if live else none, facts, common.json)
    if added and not common.json:
        changes = (f"{plural(count, 'new or changed note')} of {shot}" for shot, count in added.items())
        typer.echo(f"{', '.join(changes)}: {common.done('merged')}.", err=True)


def _row(note: ReviewNote) -> tuple[str, ...]:
    frames = str(note.first) if note.first == note.last else f"{note.first}-{note.last}"
    on_picture = [f"“{stroke.text}”" for stroke in note.drawings if stroke.text]
    strokes = plural(len(note.drawings), "stroke") + (f": {', '.join(on_picture)}" if on_picture else "")
    words = " ".join(f"{note.text}\n{f'({strokes})' if note.drawings else ''}".split("\n")).strip()
    writers = dict.fromkeys(each.author or "–" for each in ((note.history or (note,))[0], note))
    when = note.modified[:16].replace("T", " ")
    return note.sequence, frames, note.status, ", ".join(writers), when, words
