"""The command `publish`: freeze a rendered shot as a version."""

from __future__ import annotations

import shlex
from typing import Annotated, Any

import typer

from pipeline.cli.options import Common, PictureOptions, Quality, Shot
from pipeline.cli.output import print_result
from pipeline.production.request.lookup import find_shot
from pipeline.production.versions.provenance import FILE
from pipeline.production.versions.publish import Release
from render.base.plural import plural
from render.scene.quality import DEFAULT_QUALITY


def publish(
    common: Common,
    shot: Shot,
    options: PictureOptions,
    quality: Quality = DEFAULT_QUALITY,
    version: Annotated[
        str | None, typer.Option(metavar="V003", help="Name the version. Default: the next number.")
    ] = None,
    note: Annotated[str, typer.Option(metavar="TEXT", help="A note for the provenance.")] = "",
    copy: Annotated[
        bool, typer.Option("--copy", help="Copy the rendered files instead of linking them.")
    ] = False,
) -> None:
    """Freeze a shot's rendered frames and movie as its next version: v001, v002, …

    `flowsculpt publish A010_cube --note "approved"` writes renders/published/A010_cube/v001, which is never
    overwritten. All frames must be rendered from today's shot file; the command lists what is missing or
    stale. The same frames are not published twice.

    The provenance.json of a version holds the shot file, keys, seeds, packages, host and timings;
    `flowsculpt render --from FILE` reproduces the version from it.

    The files are links to the rendered ones and take no space; damage in place damages both. `--copy` avoids
    that. `flowsculpt verify` checks published files.
    """
    project = options.project(common)
    request = project.request(find_shot(shot), options.quality(quality))
    given = {"--crop": options.crop, "--scale": options.scale, "--variant": options.variant}
    words = ["flowsculpt", "render", shot, "-q", quality]
    words += [word for option, value in given.items() if value is not None for word in (option, value)]
    words += [word for setting in options.settings or () for word in ("--set", setting)]
    words += ["--allow-code"] * options.allow_code
    done = Release(request, project.store, shlex.join(words), note, version, copy).publish(common.dry_run)
    facts = {
        "shot": request.name,
        "version": done.version,
        "path": str(done.folder),
        "provenance": str(done.folder / FILE),
        "frames": len(request.angles),
        "published_before": done.before,
    }
    print_result(_published(request.name, len(request.angles), done, common.dry_run), facts, common.json)


def _published(shot: str, frames: int, done: Any, dry: bool) -> str:
    if done.before:
        return f"{shot} is already published as {done.version}, with the same frames: {done.folder}"
    verb = "would be published" if dry else "published"
    return f"{shot} {done.version}: {verb}, {plural(frames, 'frame')} and the movie, in {done.folder}"
