"""The command review: a page to look at shots, in any browser."""

from __future__ import annotations

import re
from contextlib import ExitStack
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from pipeline.cli.options import AllowCode, Common, Settings, Shots
from pipeline.cli.output import answer, err, warn
from pipeline.cli.projects import project_of
from pipeline.dailies.review import three
from pipeline.dailies.review.discover import Search
from pipeline.dailies.review.page import Page
from pipeline.errors import UsageError, suggestion
from pipeline.production.planning.history import History
from pipeline.production.request.crop_and_scale import is_quality
from pipeline.production.request.lookup import NAME
from render.scene.quality import QUALITIES

FORMS = ("jpeg", "png")

MODELS = 24


def review(
    common: Common,
    shots: Shots,
    qualities: Annotated[
        list[str] | None,
        typer.Option(
            "-q",
            "--quality",
            help=f"Show this quality alone, of {', '.join(QUALITIES)}; may be given again. By default all.",
        ),
    ] = None,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="The page's folder; by default as its shots.")
    ] = None,
    form: Annotated[
        str, typer.Option("--as", help=f"Pictures as {' or '.join(FORMS)}; only png loses nothing.")
    ] = FORMS[0],
    models: Annotated[
        int, typer.Option(min=0, metavar="N", help="Mesh frames of each shot for the 3-D view.")
    ] = MODELS,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Write a page to look at shots: frame by frame, versions beside each other, measures, meshes.

    `flowsculpt review A010_cube` shows what is rendered of the shot, its published versions and its wedges,
    in renders/review/A010_cube. Open its index.html in any browser; it needs no server and no network, and
    the folder may be copied. Press ? there for its keys. Called again, only what is new is made.
    """
    for quality in qualities or ():
        if not is_quality(quality):
            raise UsageError(f"{quality!r} is not a quality; choose {', '.join(QUALITIES)}")
    if form not in FORMS:
        raise UsageError(
            f"--as {form}: pictures of a page are {' or '.join(FORMS)}. {suggestion(form, FORMS)}"
        )
    project = project_of(common, settings, allow_code)
    search = Search(project, tuple(qualities or ()), History.of(common.root))
    found = [search.shot(shot) for shot in dict.fromkeys(shots)]
    page = Page(
        _named(name, [shown.request.name for shown in found]),
        project.store,
        found,
        form,
        models,
        common.cores,
    )
    if common.dry_run:
        counts = {"sequences": len(page.sequences), "pictures": sum(len(s.found) for s in page.sequences)}
    else:
        counts = _written(page, common.progress)
    if three.bundle() is None:
        warn(three.HINT)
    verb = " would show" if common.dry_run else ""
    words = f"{page.index}:{verb} {counts['sequences']} sequences, {counts['pictures']} pictures."
    missing = {f"{s.shot} {s.label}": sorted(s.states()) for s in page.sequences if s.states()}
    answer(words, {"page": str(page.index), **counts, "not_as_asked_for": missing}, common.json)


def _written(page: Page, progress: bool) -> dict[str, int]:
    columns = TextColumn("{task.description:>16}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with ExitStack() as ends:
        if not progress:
            return page.write()
        bars = ends.enter_context(Progress(*columns, console=err))
        task = bars.add_task("making the page", total=page.steps)
        return page.write(lambda: bars.advance(task))


def _named(name: str | None, shots: list[str]) -> str:
    if name is None:
        whole = "+".join(shots)
        return whole if len(whole) <= 60 else f"{shots[0]}+{len(shots) - 1}"
    if not re.fullmatch(NAME, name):
        raise UsageError(
            f"--name {name}: a page is named by letters, digits, _, - and ., as in monday; mend it"
        )
    return name
