"""The commands `sheet` and `wedge`: a shot over its frames, and in many variations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from flowsculpt import UsageError
from flowsculpt.api import plural
from flowsculpt.api.commands import execute, print_result, print_warning, report_plan
from flowsculpt.api.flows import MotionForecast
from flowsculpt.api.frames import FinishedPictures, FrameRange, Plan, RenderRequest, Show, Store
from flowsculpt.api.options import DEFAULT_QUALITY, Common, PictureOptions, Quality, Shot, shared_option
from flowsculpt.api.pictures import ContactSheet, write_still
from flowsculpt.api.shots import WrittenShot
from flowsculpt.pipeline.plugins.sheets.wedge import MOST_CELLS, OPTION, Grid, Variation, Wedge

DEFAULT_FRAMES = 12  # most frames of a sheet where none are requested


def spread(request: RenderRequest) -> RenderRequest:
    """Return a request for at most DEFAULT_FRAMES frames at equal distances."""
    numbers = sorted(request.angles)
    return replace(request, requested=FrameRange(numbers[:: -(-len(numbers) // DEFAULT_FRAMES)]))


@dataclass(frozen=True)
class ShotSheet:
    """A sheet of the requested frames; by default `columns` give it about the aspect of a screen."""

    request: RenderRequest
    store: Store
    columns: int | None = None

    @property
    def place(self) -> Path:
        """The path of the sheet, relative to the root."""
        request, frames = self.request, FrameRange.of(self.request.requested)
        return request.folders.home / request.quality_name / f"{request.name}.sheet.{frames}.png"

    def write(self, path: Path) -> list[str]:
        """Write the sheet as PNG, and return what is to be said about its light.

        Missing frames are shown as missing. Raises MachineError.
        """
        request, numbers = self.request, self.request.requested
        size = request.pictures.quality.rendered_size
        columns = min(len(numbers), self.columns or ContactSheet.columns_for(len(numbers), size))
        rate = request.shot.rate
        seconds = [rate.seconds(number - request.shot.frames.first) for number in numbers]
        captions = [(("frame", f"{n}   {s:.2f} s"),) for n, s in zip(numbers, seconds, strict=True)]
        sheet, factor = ContactSheet.fitted(request.shot.heading, captions, size, columns)
        finished = FinishedPictures(request, self.store)
        pictures = {number: finished.pixels(number, factor) for number in numbers}
        header = {"shot": request.name, "frames": str(FrameRange.of(numbers))}
        page = sheet.picture([*pictures.values()], request.quality_name)
        self.store.write(path, lambda draft: write_still(draft, page, header))
        return FinishedPictures.light_notes(pictures)


def sheet(
    common: Common,
    shot: Shot,
    options: PictureOptions,
    frames: Annotated[
        FrameRange | None, shared_option("frames", "Default: up to twelve, evenly over the shot.")
    ] = None,
    looks: Annotated[
        str | None, typer.Option(metavar="NAMES", help="One frame in each of these looks, as in clay,glaze.")
    ] = None,
    at: Annotated[int | None, shared_option("at", "The frame of --looks. Default: the middle one.")] = None,
    quality: Quality = DEFAULT_QUALITY,
    columns: Annotated[int | None, typer.Option(min=1, metavar="N", help="Columns of the sheet.")] = None,
    output: Annotated[Path | None, shared_option("output", "Write this PNG.")] = None,
) -> None:
    """Draw a contact sheet of a shot's frames, rendering what is missing.

    `flowsculpt sheet A010_cube -f 1-58x3 --columns 5` shows the shot over time. `flowsculpt sheet A010_cube
    --looks clay,glaze,chrome --at 44` shows one frame in three looks; it is a wedge.
    """
    if output is not None and output.suffix.lower() != ".png":
        raise UsageError(f"{output} is not a PNG; a sheet's name ends in .png")
    if looks is not None:
        if output is not None or frames is not None:
            raise UsageError("--looks draws a wedge; leave out -o and -f, and choose the frame by --at")

        if "," not in looks:
            raise UsageError(f"--looks {looks}: one look needs no sheet; name several, as in clay,glaze")
        wedge(common, shot, options, [f"look={looks}"], None, at, quality, columns)
        return
    if at is not None:
        raise UsageError("--at is the frame of --looks; name the frames of a sheet with -f")

    project = options.project(common)
    request = project.request(Show().find_shot(shot), options.quality(quality, project, [shot]), frames)
    made = ShotSheet(request if frames is not None else spread(request), project.store, columns)

    def planned() -> Plan:
        return project.frames([made.request])

    if common.dry_run:
        report_plan(common, planned())
        return
    outcome = execute(common, planned)
    path = output or common.root / made.place
    for note in made.write(path):
        print_warning(f"{request.name}: {note}")
    many = len(made.request.requested)
    facts = {"path": str(path), "frames": list(made.request.requested), "rendered": outcome.made("render")}
    print_result(f"{path}: {plural(many, 'frame')}, {outcome.made('render')} rendered.", facts, common.json)
    raise typer.Exit(outcome.exit_code)


def wedge(
    common: Common,
    shot: Shot,
    options: PictureOptions,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            OPTION,
            metavar="NAME=VALUES",
            help="Vary a value: NAME=first:last:count or NAME=value,value. Repeatable; cells are all "
            "combinations.",
        ),
    ] = None,
    frames: Annotated[
        FrameRange | None, shared_option("frames", "Frames of every cell. Default: the sheet's.")
    ] = None,
    at: Annotated[int | None, shared_option("at", "The frame of the sheet. Default: the middle one.")] = None,
    quality: Quality = DEFAULT_QUALITY,
    columns: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Columns of the sheet. Default: values of the last --vary."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help=f"Allow more than {MOST_CELLS} cells.")] = False,
) -> None:
    """Render a shot in a grid of variations, and put them on a contact sheet.

    `flowsculpt wedge A010_cube --vary flows.1.twist.amount.keys.31=20:80:4 --vary look=clay,glaze`
    renders the middle frame of eight cells to folders below renders/wedge/A010_cube, and a PNG labelled
    with their values. With `-f 1-48` it renders these frames of every cell, and the sheet is a movie too.
    Work that cells share is done once: a wedge over looks simulates the shot only once.

    A value with keys is varied at one of them, here at frame 68; otherwise it would lose its keys.
    """
    grid = Grid.parse(vary or [], yes)
    project = options.project(common)
    named = options.quality(quality, project, [shot])
    made = Wedge(project, Show().find_shot(shot), grid, named, frames, at, columns)
    for note in _notes(made):
        print_warning(note)
    if common.dry_run:
        _report(common, made)
        return
    outcome = execute(common, made.plan)
    sheets = made.draw()
    facts = {
        "cells": _cells(made),
        "frame": made.number,
        "sheets": [path.as_posix() for path in sheets],
        "made": outcome.made_by_stage(),
        "done": not outcome.unfinished,
    }
    rendered = f"{plural(len(grid), 'cell')}, {plural(outcome.made('render'), 'frame')} rendered"
    print_result(f"{', '.join(path.as_posix() for path in sheets)}: {rendered}.", facts, common.json)
    raise typer.Exit(outcome.exit_code)


def _notes(made: Wedge) -> list[str]:
    """Return what to tell about deformations whose amount a variation makes the same in every frame."""
    notes: dict[str, str] = {}
    varied = [variation for variation in made.grid.variations if variation.name.endswith(".amount")]
    if not varied:
        return []

    for _, request in made.requests:
        for flow, text in MotionForecast(request.shot.motion).constant_deformations():
            place, name = f"flows.{flow}", text.partition(" ")[0]
            for variation in varied:
                if variation.name.startswith(f"{place}.") and variation.name.endswith(f".{name}.amount"):
                    notes.setdefault(variation.name, _remedied(made, variation, text))
    return list(notes.values())


def _remedied(made: Wedge, variation: Variation, text: str) -> str:
    """Return the text of a finding with a variation that moves something."""
    value: Any = WrittenShot.read(made.shot, settings=made.project.settings).source.data
    for step in variation.name.split("."):
        value = value[int(step)] if isinstance(value, list) else value.get(step, {})
    keys = value.get("keys") if isinstance(value, dict) else None
    fact, _, remedy = text.partition(". ")
    rest = variation.said.partition("=")[2].strip()
    last = list(keys)[-1] if isinstance(keys, dict) and keys else made.requests[0][1].shot.frames.last
    vary = f"{OPTION} {variation.name}.keys.{last}={rest}"
    begin = "Vary one of its keys instead" if keys else f"{remedy.rstrip('.')} in the shot file, and vary it"
    return f"{OPTION} {variation.said}: {fact}. {begin}: {vary}."


def _report(common: Common, made: Wedge) -> None:
    """Report the grid and what a run would do for it."""
    lines = [f"{'  '.join(cell.settings)}" for cell, _ in made.requests]
    frames = len(made.requests[0][1].requested)
    lines.append(f"{plural(len(lines), 'cell')} of {plural(frames, 'frame')}, the sheet at {made.number}.")
    facts = {"cells": _cells(made), "frame": made.number}
    report_plan(common, made.plan(), lines, facts, "Only the sheet is to be drawn.")


def _cells(made: Wedge) -> list[dict[str, object]]:
    return [{"settings": list(cell.settings), "folder": request.home} for cell, request in made.requests]
