"""The command `render`: frames and movies of shots, or a published version again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.execution import carried_out, make, tell_plan
from pipeline.cli.options import AllowCode, Common, Crop, Frames, Scale, Settings, Variant
from pipeline.cli.output import answer, warn
from pipeline.cli.projects import project_of
from pipeline.errors import UsageError
from pipeline.frames import FrameRange
from pipeline.production.request.crop_and_scale import windowed
from pipeline.production.versions.provenance import Provenance
from pipeline.production.versions.reproduce import Comparison, Repetition
from render.scene.quality import QUALITIES


def render(
    common: Common,
    shots: Annotated[
        list[str] | None, typer.Argument(metavar="SHOT…", help="Names in shots/, or paths of shot files.")
    ] = None,
    frames: Frames = None,
    quality: Annotated[
        str | None,
        typer.Option("-q", "--quality", help=f"One of {', '.join(QUALITIES)}.", show_default="draft"),
    ] = None,
    provenance: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="PROVENANCE",
            help="Make a published version again from its provenance.json, and compare.",
        ),
    ] = None,
    variant: Variant = None,
    crop: Crop = None,
    scale: Scale = None,
    settings: Settings = None,
    allow_code: AllowCode = False,
) -> None:
    """Render shots, or a range of their frames, and assemble the movie.

    Only what is missing or stale is made: `flowsculpt render A010_cube -f 10-20x2 -q preview` renders six
    frames, and nothing when called again. Parts and scaled pictures have folders of their own, such as
    preview.scale50; a part shows what the whole picture does there, with other noise.

    `flowsculpt render --from renders/published/A010_cube/v001/provenance.json` makes a published version
    again in renders/repeated, from its shot file as it was then, and says which frames are the same to the
    last bit.
    """
    if provenance is not None:
        repeat(common, provenance, frames, variant, allow_code, [shots, quality, crop, scale, settings])
        return
    if not shots:
        raise UsageError(
            "render needs the name of a shot, or --from and a provenance; flowsculpt status lists shots"
        )
    named = windowed(quality or "draft", crop, scale)
    project = project_of(common, settings, allow_code, variant)
    make(common, lambda: project.pictures(shots, named, frames))


def repeat(
    common: Common,
    source: Path,
    frames: str | None,
    variant: str | None,
    allow_code: bool,
    beside: Sequence[object],
) -> None:
    """`render --from`: make a version again and compare; `beside` are options that a provenance answers."""
    if any(beside):
        raise UsageError(
            f"--from {source}: it says itself which shot is rendered, at what quality and with which "
            "settings; leave these out"
        )
    record = Provenance.read(source)
    again = Repetition(record, source, common.root, common.cores, frames, variant, allow_code, common.profile)
    here = replace(common, root=again.home)
    plan = again.plan()
    for note in again.notes:
        warn(f"{record.shot} {record.version}: {note}")
    if common.dry_run:
        tell_plan(here, plan)
        return
    outcome = carried_out(here, again.plan)
    found = again.comparisons()
    unlike = [each for each in found if not each.same]
    facts = {
        "shot": record.shot,
        "version": record.version,
        "path": str(again.home),
        "notes": again.notes,
        "identical": [each.what for each in found if each.same],
        "different": {each.what: each.words for each in unlike if each.same is False},
        "not_made": [each.what for each in unlike if each.same is None],
    }
    answer(_compared(record, again.home, found), facts, common.json)
    if outcome.exit_code or unlike:
        raise typer.Exit(outcome.exit_code or 1)


def _compared(record: Provenance, home: Path, found: Sequence[Comparison]) -> str:
    lines = [f"{each.what}: {each.words or 'differs'}" for each in found if not each.same]
    same = [each.what.removeprefix("frame ") for each in found if each.same]
    frames = FrameRange.of(int(what) for what in same if what != "movie")
    told = [f"frames {frames}"] * bool(frames) + ["the movie"] * ("movie" in same)
    whole = f"{' and '.join(told) or 'nothing'} identical to what was published, to the last bit"
    return "\n".join([*lines, f"{record.shot} {record.version}: {whole}. It lies in {home}"])
