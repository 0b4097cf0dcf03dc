"""The command `publish`: freeze a rendered shot as a version."""

from __future__ import annotations

import shlex
from typing import Annotated, Any

import typer

from pipeline.cli.options import Common, Crop, Quality, Scale, Settings, Variant
from pipeline.cli.output import answer
from pipeline.production.execution.project import Project
from pipeline.production.request.crop_and_scale import windowed
from pipeline.production.request.lookup import find_shot
from pipeline.production.versions.provenance import FILE
from pipeline.production.versions.publish import Release


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
