"""Drawing a preview for the user: where it is put, and bars meanwhile."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.cli.options import Common
from pipeline.cli.say import answer, err
from pipeline.dailies.preview.animatic import Animatic, Tell
from pipeline.dailies.preview.reel import Reel
from pipeline.dailies.preview.sketch import Sketch
from pipeline.production.store.disk import disk_faults
from pipeline.production.store.store import Store


def sketched(common: Common, sketch: Sketch, store: Store, at: int | None, output: Path | None) -> None:
    """A still of frame `at`, or the movie of what the take asks for."""
    path = output or common.root / place(sketch, at)
    asked = {at} if at is not None else set(sketch.take.requested)
    many = len(asked)
    frames = f"{many} frame{'s' if many > 1 else ''}"
    if not common.dry_run:
        with Reel(store, once=True) as reel:
            folder_for(path)
            animatic = Animatic(sketch, reel)
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
    with disk_faults(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)


def place(sketch: Sketch, number: int | None = None) -> Path:
    """Where a still is put, or the movie of the frames asked for."""
    take, name = sketch.take, sketch.take.name
    mark = ".flow" * sketch.flow + ".edges" * sketch.edges
    whole = "" if take.is_whole else f".{min(take.requested)}-{max(take.requested)}"
    file = f"{name}{whole}{mark}.mp4" if number is None else f"{name}.{number:04d}{mark}.png"
    return take.folders.cameras().parent / "sketch" / file


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
