"""The command `breed`: children of a shot or two, from which a person chooses."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from flowsculpt import UsageError
from flowsculpt.api import plural
from flowsculpt.api.commands import print_result, progress_bars
from flowsculpt.api.frames import Locks, Show
from flowsculpt.api.options import Common, shared_option
from flowsculpt.api.shots import Shot, read_shot
from flowsculpt.pipeline.plugins.breed.breeding import Litter
from flowsculpt.pipeline.plugins.breed.generation import (
    CHILDREN,
    GENERATIONS,
    Breeding,
    counted,
    forget_interrupted,
)
from flowsculpt.pipeline.plugins.breed.generation_page import OPTION, next_name, read_choice
from flowsculpt.pipeline.plugins.breed.shot_genome import Genome

CANDIDATES, CHANGE = 40, 0.3
"""How many are tried, and how far they go from their parents, by default."""

LONGEST_NAME = 90
"""Letters of a generation's name; those of its children are longer."""


def breed(
    common: Common,
    shot: Annotated[
        str | None, typer.Argument(metavar="SHOT", help="A name in shots/, or the path of a shot file.")
    ] = None,
    other: Annotated[
        str | None, typer.Argument(metavar="SHOT2", help="A second shot, to cross with the first.")
    ] = None,
    change: Annotated[
        float | None,
        typer.Option(
            "--change", metavar="0-1", help=f"How far children go from their parents. Default: {CHANGE}."
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", metavar="N", help="Another one, other children. Default: 0.")
    ] = None,
    candidates: Annotated[
        int, typer.Option("--candidates", min=1, max=400, metavar="N", help="How many are tried.")
    ] = CANDIDATES,
    from_page: Annotated[
        str | None,
        typer.Option(
            OPTION, metavar="CHOICE", help="Go on from a page: the line that it shows, or its file."
        ),
    ] = None,
    allow_code: Annotated[bool, shared_option("allow_code")] = False,
    output: Annotated[
        Path | None,
        shared_option("output", "Write this folder. Default: bred/SHOT_1, and so on.", metavar="FOLDER"),
    ] = None,
) -> None:
    """Make twelve children of a shot, or of two that are crossed, and a page to choose from.

    `flowsculpt breed A010_cube` changes numbers, keys, flows, places, looks and colours of a shot by chance.
    It tries forty candidates on coarse meshes, leaves out those that explode, leave the picture, hardly move
    or look like another, and writes the twelve that differ most to bred/A010_cube_1: shot files, sheet.png
    and index.html. `flowsculpt breed A010_cube A030_taffy` crosses two shots: the form of one, flows of both.

    Open index.html, click favourites, choose one parent or two, and run the command that the page shows. It
    is like `flowsculpt breed --from-page "bred/A010_cube_1 parents=3,7 name=calm"` and writes bred/calm. The
    picture family.png there shows all generations.

    A child is an ordinary shot: `flowsculpt preview bred/calm/calm_05.yaml` plays it, and `flowsculpt new
    A060_calm --from bred/calm/calm_05.yaml` takes it into shots/. The same seed gives the same children.
    """
    favourites: tuple[str, ...] = ()
    name = ""
    if from_page is not None:
        if shot is not None:
            raise UsageError(f"{OPTION} names the parents itself; leave {shot} out")
        choice = read_choice(from_page)
        paths, favourites, name = list(choice.parents), choice.favourites, choice.name
        change = choice.change if change is None else change
        seed = choice.seed if seed is None else seed
    elif shot is None:
        raise UsageError("breed needs a shot, as in flowsculpt breed A010_cube")
    else:
        paths = [_path(each) for each in (shot, other) if each is not None]
        name = next_name(_family(paths))
    change, seed = CHANGE if change is None else change, 0 if seed is None else seed
    if not 0.0 <= change <= 1.0:
        raise UsageError(f"--change {change:g} is out of range; it is from 0, nearly the same, to 1")
    folder = output or common.root / GENERATIONS / name
    if fault := Show.name_fault(name if output is None else folder.name):
        raise UsageError(fault if output is None else f"{folder}: {fault}")
    if len(folder.name) > LONGEST_NAME:
        raise UsageError(f"{folder.name} is too long for a generation; use at most {LONGEST_NAME} letters")
    if folder.exists():
        raise UsageError(f"{folder} is there already; choose another folder with -o, or delete it")
    shots = tuple(read_shot(path, allow_code=allow_code) for path in paths)
    litter = Litter(tuple(map(Genome.of, shots)), seed, change, folder, allow_code)
    if common.dry_run:
        words = f"{folder}: {CHILDREN} of {plural(candidates, 'candidate')} would be written."
        print_result(words, {"folder": str(folder), "candidates": candidates}, common.json)
        return
    _breed(common, litter, shots, candidates, favourites)


def _breed(
    common: Common, litter: Litter, shots: tuple[Shot, ...], candidates: int, favourites: tuple[str, ...]
) -> None:
    with Locks(common.root).hold_with_writers():  # `clean` would delete its trials
        forget_interrupted(common.root, litter.folder.parent)
        breeding = Breeding(litter, shots, common.root, candidates, common.cores, favourites)
        bred = breeding.write(partial(progress_bars, common.progress))
    left_out = f"; {counted(bred.left_out)}" if bred.left_out else ""
    children = plural(len(bred.children), "child", "children")
    lines = [
        f"{bred.folder}: {children} of {candidates} candidates{left_out}.",
        f"Choose on {bred.folder / 'index.html'}; all of them are on {bred.folder / 'sheet.png'}.",
    ]
    facts = {
        "folder": str(bred.folder),
        "children": [f"{bred.folder / name}.yaml" for name in bred.children],
        "left_out": dict(bred.left_out),
    }
    print_result("\n".join(lines), facts, common.json)


def _path(name: str) -> Path:
    """Return the path of a shot. Raises UsageError for an edit."""
    if Show().names_edit(name):
        raise UsageError(f"{name} is an edit; breed takes shots, one or two")
    return Show().find_shot(name)


def _family(paths: list[Path]) -> str:
    """Return a name of which the next one is that of the generation: A010_cube_0 for A010_cube."""
    if len(paths) == 2:
        return f"{paths[0].stem}_x_{paths[1].stem}_0"
    folder = paths[0].parent.name
    return folder if paths[0].stem.startswith(f"{folder}_") else f"{paths[0].stem}_0"
