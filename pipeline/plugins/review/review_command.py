"""The command `review`: a page to look at shots, in any browser."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import Common, Crossings, ShotOptions, Shots, quality_option, require_one_of
from pipeline.cli.output import print_result, print_warning, progress_bars, size
from pipeline.errors import UsageError
from pipeline.plugins.review.notes_folder import NotesFolder
from pipeline.plugins.review.review_material import Search
from pipeline.plugins.review.review_notes import merged
from pipeline.plugins.review.review_page import ReviewPage
from pipeline.plugins.review.view_3d import HINT, three_js
from pipeline.production.request.lookup import require_quality
from pipeline.production.store.history import History
from pipeline.shot.yaml.named_files import NAME
from render.base.plural import plural
from render.scene.render_quality import QUALITIES

FORMS = ("jpeg", "png")

NotesFiles = Annotated[
    list[Path] | None,
    typer.Option("--notes", metavar="FILE", help="Merge notes that the page downloaded. Repeatable."),
]


def review(
    common: Common,
    shots: Shots,
    options: ShotOptions,
    qualities: Annotated[
        list[str] | None,
        quality_option(f"Show only this quality, of {', '.join(QUALITIES)}. Repeatable. Default: all."),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="The folder of the page. Default: the names of the shots."),
    ] = None,
    form: Annotated[
        str, typer.Option("--as", metavar="FORM", help=f"Pictures as {' or '.join(FORMS)}; png is lossless.")
    ] = FORMS[0],
    models: Annotated[
        int, typer.Option(min=0, metavar="N", help="Mesh frames of each shot for the 3-D view.")
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
    for quality in qualities or ():
        require_quality(quality)
    require_one_of(form, FORMS, f"--as {form}: pictures of a page are {' or '.join(FORMS)}.")
    for each in shots:
        if each.endswith(".json"):
            raise UsageError(
                f"{each}: --notes takes one file; write --notes before each file, and shots without"
            )
    project = options.project(common)
    search = Search(project, tuple(qualities or ()), History.of(common.root))
    material = [search.shot(shot) for shot in dict.fromkeys(shots)]
    folder = NotesFolder(common.root)
    added = folder.add(notes or (), common.dry_run)
    written = merged(*(folder.notes(shot.request.name) for shot in material))
    title = _title(name, [shot.request.name for shot in material])
    page = ReviewPage(title, project.store, material, form, models, common.cores, crossings, written, layers)
    if common.dry_run:
        counts = {"sequences": len(page.sequences), "pictures": sum(len(s.pictures) for s in page.sequences)}
    else:
        with progress_bars(common.progress) as bar:
            counts = page.write(bar("making the page", page.steps))
    if three_js() is None:
        print_warning(HINT)
    verb = " would show" if common.dry_run else ""
    shown = f"{plural(counts['sequences'], 'sequence')}, {plural(counts['pictures'], 'picture')}"
    live = sum(not note.deleted for note in written)
    shown += f", {plural(live, 'note')}" if live else ""
    if counts.get("frames_with_layers"):
        shown += (
            f", layers of {plural(counts['frames_with_layers'], 'frame')} ({size(counts['layer_bytes'])})"
        )
    words = f"{page.index}:{verb} {shown}."
    missing = {f"{s.shot} {s.label}": sorted(s.states()) for s in page.sequences if s.states()}
    facts = {
        "page": str(page.index),
        **counts,
        "notes": live,
        "notes_added": added,
        "not_as_asked_for": missing,
    }
    print_result(words, facts, common.json)


def _title(name: str | None, shots: list[str]) -> str:
    """Return the name of the page's folder. Raises UsageError."""
    if name is None:
        whole = "+".join(shots)
        return whole if len(whole) <= 60 else f"{shots[0]}+{len(shots) - 1}"
    if not re.fullmatch(NAME, name):
        raise UsageError(
            f"--name {name}: the name of a page consists of letters, digits, _, - and ., as in monday"
        )
    return name
