"""The command `preview`: a quick look at a shot, and a page that follows its edits."""

from __future__ import annotations

import time
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import AllowCode, Common, Frames, Settings
from pipeline.cli.output import answer, complain, err
from pipeline.cli.projects import project_of
from pipeline.dailies.live.feed import LiveFeed
from pipeline.dailies.live.server import serving
from pipeline.dailies.live.session import Session, files_of, stamp, wait_for_edit
from pipeline.dailies.preview.animatic import Animatic, Ready, Tell
from pipeline.dailies.preview.sketch import Sketch
from pipeline.dailies.preview.surface_stream import SurfaceStream
from pipeline.errors import FlowsculptError, UsageError
from pipeline.production.request.lookup import find_shot
from pipeline.production.store.store import Store
from render.base.atomic_write import disk_errors
from render.graphics.burn_in import BurnIn


def preview(
    common: Common,
    shot: Annotated[
        str, typer.Argument(metavar="SHOT", help="A name in shots/, or the path of a shot file.")
    ],
    at: Annotated[
        int | None, typer.Option("--at", metavar="FRAME", help="A still of this frame; by default a movie.")
    ] = None,
    frames: Frames = None,
    flow: Annotated[
        bool, typer.Option("--flow", help="Draw the flow: its streamlines at each frame, coloured by speed.")
    ] = False,
    edges: Annotated[bool, typer.Option("--edges", help="Draw the edges of the faces.")] = False,
    burn_in: Annotated[
        str | None,
        typer.Option(
            "--burn-in",
            metavar="FIELDS",
            help="Write over the picture: all, or some of shot,frame,timecode,key.",
        ),
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="Open a page that shows frames while they are simulated.")
    ] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Go on: look again whenever the shot file is saved.")
    ] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of the live page; 0 is any that is free.")] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the live page in a browser.")
    ] = True,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write the PNG or MP4 there.")
    ] = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Show a shot quickly, without a path tracer: its own camera, lights and look, nothing reflected.

    What is not simulated yet is simulated for the look alone; `flowsculpt simulate` keeps meshes. Pictures go
    to renders/SHOT/sketch: `flowsculpt preview A010_cube --at 22 --edges` is a still with its faces.

    `flowsculpt preview A010_cube --live --watch` is for working: a page follows the simulation frame by
    frame, and after each save from the first frame on that the edit changed. Ctrl-C ends it.
    """
    if at is not None and frames is not None:
        raise UsageError("--at is for a still and --frames for a movie; give one of them")
    ending = ".mp4" if at is None else ".png"
    if output is not None and output.suffix.lower() != ending:
        raise UsageError(
            f"{output} is no {ending[1:].upper()}, which this preview is; end its name in {ending}"
        )
    if at is not None and (live or watch):
        raise UsageError("--live and --watch show movies; leave --at out")
    path, over = find_shot(shot), None if burn_in is None else BurnIn.parse(burn_in)

    def sketch() -> tuple[Sketch, Store]:
        """As the shot is now."""
        project = project_of(common, settings, allow_code)
        request = project.request(path, "preview", str(at) if at is not None else frames, variant="none")
        return Sketch(request, flow, edges, over), project.store

    if (live or watch) and not common.dry_run:
        watched(common, path, sketch, output, watch, (port, browser) if live else None)
    else:
        sketched(common, *sketch(), at, output)


def sketched(common: Common, sketch: Sketch, store: Store, at: int | None, output: Path | None) -> None:
    """A still of frame `at`, or the movie of what the take asks for."""
    path = output or common.root / place(sketch, at)
    asked = {at} if at is not None else set(sketch.request.requested)
    many = len(asked)
    frames = f"{many} frame{'s' if many > 1 else ''}"
    if not common.dry_run:
        with SurfaceStream(store, once=True) as stream:
            folder_for(path)
            animatic = Animatic(sketch, stream)
            with bars(common, len(animatic.played(asked)), many) as tell:
                if at is None:
                    animatic.movie(path, tell)
                else:
                    animatic.still(at, path, tell)
    answer(
        f"{path}: {frames}{' would be drawn' if common.dry_run else ''}.",
        {"path": str(path), "frames": many},
        common.json,
    )


def folder_for(path: Path) -> None:
    """Make the folder of a file. Raises MachineError where that cannot be: now, not after minutes."""
    with disk_errors(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)


def place(sketch: Sketch, number: int | None = None) -> Path:
    """Where a still is put, or the movie of the frames asked for."""
    request, name = sketch.request, sketch.request.name
    mark = ".flow" * sketch.flow + ".edges" * sketch.edges
    whole = "" if request.is_whole else f".{min(request.requested)}-{max(request.requested)}"
    file = f"{name}{whole}{mark}.mp4" if number is None else f"{name}.{number:04d}{mark}.png"
    return request.folders.cameras().parent / "sketch" / file


@contextmanager
def bars(common: Common, simulated: int, drawn: int) -> Iterator[Tell]:
    """What is told of frames, as a bar for each kind of work."""
    if not common.progress:
        yield lambda stage, number: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    with Progress(
        TextColumn("{task.description:>16}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=err,
    ) as progress:
        totals = {"simulating": simulated, "drawing": drawn}
        tasks = {stage: progress.add_task(stage, total=total) for stage, total in totals.items()}
        yield lambda stage, number: progress.advance(tasks[stage])


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
    with SurfaceStream(store) as stream:
        if page is None:
            _movies(common, read, stream, movie, {path, *files_of(sketch.request.source)})
        else:
            _shown(common, read, stream, movie, path, again, page)


def _movies(common: Common, read: Read, stream: SurfaceStream, movie: Path, edited: set[Path]) -> None:
    while True:
        before = stamp(edited)
        try:
            sketch, _ = read()
            more = files_of(sketch.request.source) - edited
            edited, before = edited | more, before | stamp(more)
            animatic, asked = Animatic(sketch, stream), set(sketch.request.requested)
            with bars(common, len(animatic.played(asked)), len(asked)) as tell:
                many = animatic.movie(movie, tell)
            answer(f"{movie}: {many} frames.", {"path": str(movie), "frames": many}, common.json)
        except FlowsculptError as error:
            complain(str(error))
        wait_for_edit(edited, before)


def _shown(
    common: Common, read: Read, stream: SurfaceStream, movie: Path, path: Path, again: bool, page: Page
) -> None:
    port, opened = page
    screen = LiveFeed()

    def done(ready: Ready) -> None:
        many = ready.movie(movie, lambda stage, number: None)
        answer(f"{movie}: {many} frames.", {"path": str(movie), "frames": many}, common.json)

    session = Session(lambda: read()[0], screen, stream, done, {path})
    with serving(screen, port) as address:
        err.print(f"Live at {address} – Ctrl-C ends it.", markup=False)
        if opened:
            webbrowser.open(address)
        if again:
            session.again_and_again()
        session.once()
        while True:  # somebody looks at the page
            time.sleep(3600.0)
