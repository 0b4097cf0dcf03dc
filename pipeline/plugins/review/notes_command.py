"""The command `notes`: list what reviewers wrote about a shot, and take in their files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import Common, Shot, require_one_of
from pipeline.cli.output import print_result, table
from pipeline.plugins.review.notes_folder import NotesFolder
from pipeline.plugins.review.review_notes import STATUSES, ReviewNote, as_data
from pipeline.production.request.lookup import find_shot
from render.base.plural import plural
from render.base.render_errors import readable


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
    name, folder = find_shot(shot).stem, NotesFolder(common.root)
    added = folder.add(add or (), common.dry_run)
    found = [note for note in folder.notes(name) if status in (None, note.status)]
    live = sorted((note for note in found if not note.deleted), key=lambda note: (note.sequence, note.first))
    listing = table("sequence", "frames", "status", "by", "time (UTC)", "note")
    for note in live:
        listing.add_row(*map(readable, _row(note)))
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
