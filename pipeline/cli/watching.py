"""Following a shot while it is worked on: a movie after each save, and a page that shows frames at once."""

from __future__ import annotations

import time
import webbrowser
from collections.abc import Callable
from pathlib import Path

from pipeline.cli.options import Common
from pipeline.cli.say import answer, complain, err
from pipeline.cli.sketching import bars, folder_for, place
from pipeline.dailies.live.edits import stamp, wait_for_edit
from pipeline.dailies.live.screen import Screen
from pipeline.dailies.live.server import serving
from pipeline.dailies.live.session import Session, files_of
from pipeline.dailies.preview.animatic import Animatic, Ready
from pipeline.dailies.preview.reel import Reel
from pipeline.dailies.preview.sketch import Sketch
from pipeline.errors import FlowsculptError
from pipeline.production.store.store import Store
from render.base.errors import RenderError

Read = Callable[[], tuple[Sketch, Store]]

Page = tuple[int, bool]
"""The port of the live page, and whether a browser is to open it."""


def watched(
    common: Common, path: Path, read: Read, output: Path | None, again: bool, page: Page | None
) -> None:
    """Draw the movie of a shot, `again` and again, and on a page where there is one; until Ctrl-C."""
    sketch, store = read()
    movie = output or common.root / place(sketch)
    folder_for(movie)
    with Reel(store) as reel:
        if page is None:
            _movies(common, read, reel, movie, {path, *files_of(sketch.take.script)})
        else:
            _shown(common, read, reel, movie, path, again, page)


def _movies(common: Common, read: Read, reel: Reel, movie: Path, edited: set[Path]) -> None:
    while True:
        before = stamp(edited)
        try:
            sketch, _ = read()
            more = files_of(sketch.take.script) - edited
            edited, before = edited | more, before | stamp(more)
            animatic, asked = Animatic(sketch, reel), set(sketch.take.requested)
            with bars(common, len(animatic.played(asked)), len(asked)) as tell:
                many = animatic.movie(movie, tell)
            answer(f"{movie}: {many} frames.", {"path": str(movie), "frames": many}, common.json)
        except (FlowsculptError, RenderError) as error:
            complain(str(error))
        wait_for_edit(edited, before)


def _shown(common: Common, read: Read, reel: Reel, movie: Path, path: Path, again: bool, page: Page) -> None:
    port, opened = page
    screen = Screen()

    def done(ready: Ready) -> None:
        many = ready.movie(movie, lambda stage, number: None)
        answer(f"{movie}: {many} frames.", {"path": str(movie), "frames": many}, common.json)

    session = Session(lambda: read()[0], screen, reel, done, {path})
    with serving(screen, port) as address:
        err.print(f"Live at {address} – Ctrl-C ends it.", markup=False)
        if opened:
            webbrowser.open(address)
        if again:
            session.again_and_again()
        session.once()
        while True:  # somebody looks at the page
            time.sleep(3600.0)
