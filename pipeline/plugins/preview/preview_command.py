"""The command `preview`: a quick look at a shot, and a page that follows its edits."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from flowsculpt import FlowsculptError, UsageError
from flowsculpt.api import Progress, ShotExtras, plural
from flowsculpt.api.commands import print_error, print_result, print_warning, progress_bars
from flowsculpt.api.files import make_folder
from flowsculpt.api.frames import Edit, FrameRange, RenderRequest, Show, Store
from flowsculpt.api.options import DEFAULT_QUALITY, Common, ShotOptions, shared_option
from flowsculpt.api.pictures import BurnIn
from flowsculpt.pipeline.plugins.preview.animatic import (
    FOLDER,
    Animatic,
    FrameCallback,
    FramedSurfaces,
    write_film_animatic,
)
from flowsculpt.pipeline.plugins.preview.live_server import actions_of, serving
from flowsculpt.pipeline.plugins.preview.live_session import (
    LiveFeed,
    LiveSession,
    files_of,
    stamp,
    wait_for_edit,
)
from flowsculpt.pipeline.plugins.preview.osc_input import osc_input
from flowsculpt.pipeline.plugins.preview.performer import Performer
from flowsculpt.pipeline.plugins.preview.shot_editor import ShotEditor
from flowsculpt.pipeline.plugins.preview.sketch import Sketch
from flowsculpt.pipeline.plugins.preview.surface_stream import SurfaceStream


def preview(
    common: Common,
    shot: Annotated[
        str, typer.Argument(metavar="SHOT", help="A shot or an edit: a name in shots/, or a path.")
    ],
    options: ShotOptions,
    at: Annotated[int | None, shared_option("at", "Draw a still of this frame. Default: a movie.")] = None,
    frames: Annotated[
        FrameRange | None,
        shared_option("frames", "Draw a movie of these frames: 1-48, 1-48x2, 1-24,30. Default: all."),
    ] = None,
    every: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=1,
            help="Draw every Nth frame of a movie, and hold it until the next.",
            show_default=False,
        ),
    ] = 1,
    flow: Annotated[
        bool, typer.Option("--flow", help="Draw the flow: its streamlines at each frame, coloured by speed.")
    ] = False,
    edges: Annotated[bool, typer.Option("--edges", help="Draw the edges of the faces.")] = False,
    burn_in: Annotated[
        str | None,
        typer.Option(
            "--burn-in",
            metavar="FIELDS",
            help="Burn into the picture: all, or some of shot, frame, timecode, key.",
        ),
    ] = None,
    live: Annotated[
        bool,
        typer.Option("--live", help="Open a page in the browser that shows the shot and edits its file."),
    ] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Draw again whenever the shot file is saved, until Ctrl-C.")
    ] = False,
    port: Annotated[
        int,
        typer.Option(metavar="PORT", help="The port of the live page. Default: any.", show_default=False),
    ] = 0,
    osc: Annotated[
        int | None,
        typer.Option("--osc", metavar="PORT", help="Listen to OSC at this UDP port, to perform the shot."),
    ] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address of the live page, and open no browser.")
    ] = False,
    output: Annotated[Path | None, shared_option("output", "Write this PNG or MP4.")] = None,
) -> None:
    """Draw a shot in seconds, without a path tracer: with its camera, lights and look, but no reflections.

    `flowsculpt preview A010_cube` writes a movie to renders/A010_cube/preview; `flowsculpt preview A010_cube
    --at 22 --edges` a still with its faces. Frames that are not simulated yet are simulated for the picture
    only; `flowsculpt simulate` stores meshes.

    `flowsculpt preview film` draws the film of shots/film.yaml, with cards, dissolves and sound, to
    renders/film/preview. With `--every 8` it draws every eighth frame; cuts and sound stay where they are.

    `flowsculpt preview A010_cube --live` opens a page on this machine that shows frames while they are
    simulated. You can edit values, keys, camera and flows there, which changes the shot file. After each
    edit, also in a text editor, simulation resumes at the first frame that changed. Values can be performed
    there while the shot plays, by hand, MIDI, gamepad or OSC (`--osc 9000`). Ctrl-C ends it.
    """
    if at is not None and frames is not None:
        raise UsageError("--at is for a still and --frames for a movie; give one of them")
    suffix = ".mp4" if at is None else ".png"
    if output is not None and output.suffix.lower() != suffix:
        remedy = "add --at FRAME for a still, or end" if at is None else "leave --at out, or end"
        raise UsageError(f"{output}: this preview is {suffix[1:].upper()}; {remedy} the name in {suffix}")
    if not 0 <= port <= 65535:
        raise UsageError(f"--port {port} is not a port; one is from 1 to 65535, and 0 is any free one")
    if osc is not None and not (live and 0 < osc <= 65535):
        raise UsageError("--osc is a port from 1 to 65535 for the live page; add --live")
    if at is not None and (live or watch):
        raise UsageError("--live and --watch show movies; leave --at out")
    if every > 1 and (live or at is not None):
        raise UsageError("--every is for movies in files; leave --at and --live out")
    fields = None if burn_in is None else BurnIn.parse(burn_in)
    if Show().names_edit(shot):
        if at is not None or frames is not None or live or watch:
            raise UsageError(
                f"{shot} is an edit, always drawn whole; --at, -f, --live and --watch are for shots"
            )
        edit, requests = options.project(common).edit(DEFAULT_QUALITY, Show().find_edit(shot), variant="none")
        _draw_film(common, edit, [Sketch(each, flow, edges, fields) for each in requests], every, output)
        return
    path = Show().find_shot(shot)

    def read() -> Sketch:
        """Return the shot as its file is now."""
        numbers = FrameRange([at]) if at is not None else frames
        request = options.project(common).request(path, DEFAULT_QUALITY, numbers, variant="none")
        request.shot.require_permission()
        return Sketch(request, flow, edges, fields)

    sketch, store = read(), Store(common.root)
    target = output or common.root / sketch.path(at)
    if common.dry_run or not (live or watch):
        _draw_once(common, sketch, store, at, every, target)
        return
    make_folder(target.parent)
    with SurfaceStream(store) as stream:
        if live:
            editor = ShotEditor(path, tuple(options.settings or ()), options.allow_code)
            _serve(common, read, stream, target, editor, (port, osc), not no_browser)
        else:
            _redraw(common, read, stream, every, target, {path, *files_of(sketch.request.source)})


def _draw_once(common: Common, sketch: Sketch, store: Store, at: int | None, every: int, path: Path) -> None:
    """Draw a still of frame `at`, or the movie of all requested frames."""
    numbers = {at} if at is not None else set(sketch.request.requested)
    if not common.dry_run:
        with SurfaceStream(store, once=True) as stream:
            make_folder(path.parent)
            animatic = Animatic(sketch, stream, every)
            played = animatic.played_for_movie() if at is None else animatic.played_for_still(at)
            with _bars(common, [animatic], {"simulating": len(played), "drawing": len(numbers)}) as report:
                if not all(stream.knows(sketch.request, number) for number in played):
                    _warn_of_cost(sketch.request, max(played))
                if at is None:
                    animatic.movie(path, report)
                else:
                    animatic.still(at, path, report)
    _print_notes([sketch])
    _report(common, path, len(numbers))


def _draw_film(
    common: Common, edit: Edit, sketches: Sequence[Sketch], every: int, output: Path | None
) -> None:
    """Draw the movie of an edit; `sketches` are those of its clips."""
    path, store = output or common.root / edit.path(FOLDER), Store(common.root)
    for sketch in sketches:
        sketch.request.shot.require_permission()
    if not common.dry_run:
        make_folder(path.parent)
        with ExitStack() as stack:
            streams = [stack.enter_context(SurfaceStream(store, once=True)) for _ in sketches]
            clips = [Animatic(*each, every) for each in zip(sketches, streams, strict=True)]
            played = sum(len(clip.played_for_movie()) for clip in clips)
            with _bars(common, clips, {"simulating": played, "drawing": edit.length}) as report:
                write_film_animatic(edit, clips, path, report)
    _print_notes(sketches)
    _report(common, path, edit.length)


def _report(common: Common, path: Path, frames: int) -> None:
    words = f"{path}: {plural(frames, 'frame')}{' would be drawn' if common.dry_run else ''}."
    print_result(words, {"path": str(path), "frames": frames}, common.json)


def _print_notes(sketches: Sequence[Sketch]) -> None:
    requests = [sketch.request for sketch in sketches]
    for line in dict.fromkeys(
        f"{each.name}: {line}" for each in requests for line in each.source.new_notes()
    ):
        print_warning(line)


def _warn_of_cost(request: RenderRequest, last: int) -> None:
    """Print what plug-ins foresee of the frames up to `last`, before they are simulated."""
    for extras in ShotExtras.of_plugins().values():
        for line in extras.warnings(request, last):
            print_warning(f"{request.name}: {line}")


def _redraw(
    common: Common,
    read: Callable[[], Sketch],
    stream: SurfaceStream,
    every: int,
    movie: Path,
    watched: set[Path],
) -> None:
    """Draw the movie now and after each edit of the watched files, until Ctrl-C."""
    while True:
        before = stamp(watched)
        try:
            sketch = read()
            added = files_of(sketch.request.source) - watched
            watched, before = watched | added, before | stamp(added)
            animatic = Animatic(sketch, stream, every)
            drawing = len(set(sketch.request.requested))
            totals = {"simulating": len(animatic.played_for_movie()), "drawing": drawing}
            with _bars(common, [animatic], totals) as report:
                _report(common, movie, animatic.movie(movie, report))
        except FlowsculptError as error:
            print_error(str(error))
        wait_for_edit(watched, before)


def _serve(
    common: Common,
    read: Callable[[], Sketch],
    stream: SurfaceStream,
    movie: Path,
    editor: ShotEditor,
    ports: tuple[int, int | None],
    browser: bool,
) -> None:
    """Show the shot on a live page, and after each edit; until Ctrl-C.

    ports  of the page, 0 for any, and of OSC, None for no OSC
    """
    feed = LiveFeed()

    def write_movie(surfaces: FramedSurfaces) -> None:
        _report(common, movie, surfaces.movie(movie, lambda stage, number: None))

    session = LiveSession(read, feed, stream, write_movie, {editor.path})
    performer = Performer(editor, session)
    feed.sound, (port, osc) = performer.sound, ports
    performer.rescue()
    with ExitStack() as stack:
        address = stack.enter_context(serving(feed, port, actions_of(editor, session, performer)))
        stack.callback(performer.end)
        if osc is not None:
            stack.enter_context(osc_input(osc, performer.heard))
        typer.echo(f"Live at {address} – Ctrl-C ends it.", err=True)
        if browser:
            webbrowser.open(address)
        session.follow()


@contextmanager
def _bars(
    common: Common, animatics: Sequence[Animatic], totals: Mapping[str, int]
) -> Iterator[FrameCallback]:
    """Yield what reports a frame as simulated or drawn, with a bar for each of `totals`.

    The first bar moves within frames that take long, and what makes a frame slow is printed.
    """
    with progress_bars(common.progress) as bar:
        bars = {stage: bar(stage, total) for stage, total in totals.items()}
        done = dict.fromkeys(totals, 0)

        def frame_done(stage: str, number: int) -> None:
            done[stage] += 1
            bars[stage].show(done[stage])

        def show(frame: int, share: float, work: str) -> None:
            bars["simulating"].show(done["simulating"] + share, f"frame {frame} ({share:.0%}, {work})")

        def report(within: Any) -> None:
            if within.slow:
                print_warning(within.slow)
            show(within.frame, within.share, within.work)

        def report_once(made: Progress) -> None:
            if made.is_once:  # such as a fit, before the first frame
                first = animatics[0].sketch.request.shot.frames.first
                show(first, made.done / made.total, made.activity)

        for animatic in animatics:
            animatic.stream.callback = report
        with Progress.reported_to(report_once):
            yield frame_done
