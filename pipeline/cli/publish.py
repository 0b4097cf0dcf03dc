"""Commands for versions: publish, versions; and `render --from`, which makes one again."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from pipeline.cli.arguments import Crop, Quality, Scale, Settings, Variant
from pipeline.cli.options import Common
from pipeline.cli.runs import carried_out, tell_plan
from pipeline.cli.say import answer, complain, out, warn
from pipeline.errors import MissingInputError, UsageError
from pipeline.frames import FrameRange
from pipeline.production.execution.project import Project
from pipeline.production.request.crop_and_scale import windowed
from pipeline.production.request.lookup import find_shot
from pipeline.production.store.paths import PUBLISHED, published
from pipeline.production.versions.provenance import FILE, Provenance, records
from pipeline.production.versions.publish import Release
from pipeline.production.versions.reproduce import Comparison, Repetition


def publish(
    common: Common,
    shot: Annotated[
        str, typer.Argument(metavar="SHOT", help="A name in shots/, or the path of a shot file.")
    ],
    quality: Quality = "final",
    version: Annotated[
        str | None, typer.Option(metavar="V003", help="Call it so; by default the version after the last.")
    ] = None,
    note: Annotated[str, typer.Option(metavar="TEXT", help="What is to be remembered of it.")] = "",
    copy: Annotated[
        bool, typer.Option("--copy", help="Files of its own, not links to those that were rendered.")
    ] = False,
    crop: Crop = None,
    scale: Scale = None,
    variant: Variant = None,
    settings: Settings = None,
) -> None:
    """Freeze a shot's rendered frames and movie as its next version: v001, v002, …

    A version lies in renders/published/SHOT/VERSION and is never overwritten. Its provenance.json holds the
    shot file, keys, seeds, packages, host and timings; `flowsculpt render --from` makes it again from that.
    All frames must be rendered from the shot file of today: what is missing or stale is told, with the
    command that makes it. What is published already is not published twice.

    Its files are links to those that were rendered, and take no space; what damages one of both in place
    damages the other. With --copy they are files of their own. `flowsculpt verify` looks after them.
    """
    name = windowed(quality, crop, scale)
    project = Project(common.root, common.cores, variant, tuple(settings or ()), profile=common.profile)
    take = project.take(find_shot(shot), name)
    said = {"--crop": crop, "--scale": scale, "--variant": variant}
    words = ["flowsculpt", "render", shot, "-q", quality]
    words += [word for option, value in said.items() if value is not None for word in (option, value)]
    words += [word for setting in settings or () for word in ("--set", setting)]
    done = Release(take, project.store, shlex.join(words), note, version, copy).publish(common.dry_run)
    facts = {
        "shot": take.name,
        "version": done.version,
        "path": str(done.folder),
        "provenance": str(done.folder / FILE),
        "frames": len(take.poses),
        "published_before": done.before,
    }
    answer(_published(take.name, len(take.poses), done, common.dry_run), facts, common.json)


def _published(shot: str, frames: int, done: Any, dry: bool) -> str:
    if done.before:
        return f"{shot} is already published as {done.version}, with the same frames: {done.folder}"
    verb = "would be published" if dry else "published"
    return f"{shot} {done.version}: {verb}, {frames} frames and the movie, in {done.folder}"


def versions(
    common: Common,
    shot: Annotated[
        str | None, typer.Argument(metavar="SHOT", help="The shot's name; by default all that are published.")
    ] = None,
) -> None:
    """List what is published: each version's quality, frames, date, user and note."""
    home = common.root / PUBLISHED
    known = sorted(place.name for place in home.glob("*") if place.is_dir())
    name = None if shot is None else Path(shot).stem if shot.endswith((".yaml", ".yml")) else shot
    if name is not None and name not in known:
        there = f"published are {', '.join(known)}" if known else "nothing is, yet"
        raise MissingInputError(
            f"{name} is not published in {home}; {there}. flowsculpt publish {name} does it"
        )
    found, failed = [], []
    for each in known if name is None else [name]:
        for place, record in records(common.root / published(each)):
            if isinstance(record, Provenance):
                found.append((place, record))
            else:
                failed.append(record)
    for error in failed:
        complain(str(error))
    _tell_versions(found, common.json)
    if failed:
        raise typer.Exit(max(error.exit_code for error in failed))


def _tell_versions(found: Sequence[tuple[Path, Provenance]], as_json: bool) -> None:
    if as_json:
        answer("", [_facts(place, record) for place, record in found], as_json=True)
        return
    table = Table(box=None, pad_edge=False)
    for heading in ("shot", "version", "quality", "frames", "published (UTC)", "by", "note"):
        table.add_column(heading)
    for _, record in found:
        when = record.published.replace("T", " ").removesuffix("Z")
        frames = str(FrameRange.of(record.frames))
        row = (
            record.shot,
            record.version,
            record.quality,
            frames,
            when,
            record.user or "–",
            record.note or "–",
        )
        table.add_row(*(word.replace("[", r"\[") for word in row))
    out.print(table if found else "Nothing is published here; flowsculpt publish does it.")


def _facts(place: Path, record: Provenance) -> dict[str, Any]:
    names = ("shot", "version", "title", "quality", "variant", "published", "user", "note")
    return {
        **{name: getattr(record, name) for name in names},
        "frames": list(record.frames),
        "path": str(place),
        "provenance": str(place / FILE),
    }


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
