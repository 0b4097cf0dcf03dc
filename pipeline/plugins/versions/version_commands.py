"""The commands `publish`, `versions` and `reproduce`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from flowsculpt import MissingInputError, UsageError
from flowsculpt.api import plural
from flowsculpt.api.commands import (
    empty_table,
    execute,
    print_error,
    print_result,
    print_warning,
    report_plan,
)
from flowsculpt.api.frames import Folders, FrameRange, Show
from flowsculpt.api.options import (
    DEFAULT_QUALITY,
    Common,
    PictureOptions,
    Quality,
    Shot,
    ShotOptions,
    shared_option,
)
from flowsculpt.pipeline.plugins.versions.hooks import Hook, hooks_of, tell_published
from flowsculpt.pipeline.plugins.versions.provenance import FILE, Provenance, records
from flowsculpt.pipeline.plugins.versions.publishing import Patch, Release
from flowsculpt.pipeline.plugins.versions.reproduction import Comparison, Reproduction

FrameNumbers = Annotated[
    FrameRange | None,
    shared_option("frames", "Frames: 12, 1-48, 1-48x2, 1-24,30; 1-100:10 is coarse first. Default: all."),
]


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
    patch: Annotated[
        str | None, typer.Option(metavar="V002", help="Replace the frames of -f in this version.")
    ] = None,
    frames: FrameNumbers = None,
    hook: Annotated[
        list[str] | None,
        typer.Option(metavar="CMD", help="Run this with the version as JSON on standard input. Repeatable."),
    ] = None,
) -> None:
    """Freeze a shot's rendered frames and movie as its next version: v001, v002, …

    `flowsculpt publish A010_cube --note "approved"` writes renders/published/A010_cube/v001, which is never
    overwritten. All frames must be rendered from the current shot file; the command lists what is missing or
    stale. The same frames are not published twice.

    The provenance.json of a version contains the shot file, keys, seeds, packages, host and timings;
    `flowsculpt reproduce FILE` reproduces the version from it.

    `flowsculpt publish A010_cube --patch v002 -f 40-60` publishes v002 again with frames 40 to 60 as they are
    rendered now; the other frames need not be rendered.

    The files are links to the rendered ones and take no space; damage in place damages both. `--copy` avoids
    that. `flowsculpt verify` checks published files.

    `flowsculpt publish A010_cube --hook "python track.py"` writes the provenance and the folder as JSON to
    the standard input of that command, for a studio's tracker; see docs/versions.md.
    """
    hooks = [*map(Hook.of, hook or ()), *hooks_of(common.profile.folder, "version_published")]
    project = options.project(common)
    request = project.request(Show().find_shot(shot), options.quality(quality, project, [shot]))
    given = {"--crop": options.crop, "--scale": options.scale, "--variant": options.variant}
    words = ["flowsculpt", "render", shot, "-q", quality]
    words += [word for option, value in given.items() if value is not None for word in (option, value)]
    words += [word for setting in options.settings or () for word in ("--set", setting)]
    words += ["--allow-code"] * options.allow_code
    words += ["-f", str(frames)] if frames else []
    if (patch is None) != (frames is None):
        raise UsageError("--patch and -f go together: the version, and its frames that were rendered again")
    release = Release(request, project.store, shlex.join(words), note, version, copy)
    if patch is not None and frames is not None:
        release = Patch(**vars(release), base=patch, frames=frames)
    done = release.publish(common.dry_run)
    for each in () if common.dry_run else hooks:
        tell_published(each, done)
    facts = {
        "shot": request.name,
        "version": done.version,
        "path": str(done.folder),
        "provenance": str(done.folder / FILE),
        "frames": len(request.angles),
        "published_before": done.before,
    }
    files = f"{plural(len(request.angles), 'frame')} and the movie, in {done.folder}"
    message = f"{request.name} {done.version}: {common.done('published')}, {files}"
    if done.before:
        message = f"{request.name} is already published as {done.version}, same frames: {done.folder}"
    print_result(message, facts, common.json)


def versions(
    common: Common,
    shot: Annotated[
        str | None, typer.Argument(metavar="SHOT", help="A shot's name. Default: all published shots.")
    ] = None,
) -> None:
    """List published versions with quality, frames, date, user and note.

    `flowsculpt versions A010_cube` lists the versions that `flowsculpt publish A010_cube` made.
    """
    home = Folders.of_root(common.root).published
    known = sorted(folder.name for folder in home.glob("*") if folder.is_dir())
    name = None if shot is None else Path(shot).stem if shot.endswith((".yaml", ".yml")) else shot
    if name is not None and name not in known:
        there = f"published: {', '.join(known)}" if known else "nothing is, yet"
        raise MissingInputError(f"{name} is not published in {home}; {there}. flowsculpt publish does it")
    provenances, errors = [], []
    for each in known if name is None else [name]:
        for folder, record in records(common.root, each):
            if isinstance(record, Provenance):
                provenances.append((folder, record))
            else:
                errors.append(record)
                print_error(str(record))
    _report(provenances, common.json)
    raise typer.Exit(max((error.exit_code for error in errors), default=0))


def _report(provenances: Sequence[tuple[Path, Provenance]], as_json: bool) -> None:
    listing = empty_table("shot", "version", "quality", "frames", "published (UTC)", "by", "note")
    for _, record in provenances:
        when = record.published.replace("T", " ").removesuffix("Z")
        what = record.shot, record.version, record.quality, str(FrameRange.of(record.frames))
        listing.add_row(*what, when, record.user or "–", record.note or "–")
    words = listing if provenances else "Nothing is published here; flowsculpt publish does it."
    print_result(words, [_facts(folder, record) for folder, record in provenances], as_json)


def _facts(folder: Path, record: Provenance) -> dict[str, Any]:
    names = ("shot", "version", "title", "quality", "variant", "published", "user", "note")
    return {
        **{name: getattr(record, name) for name in names},
        "frames": list(record.frames),
        "path": str(folder),
        "provenance": str(folder / FILE),
    }


def reproduce(
    common: Common,
    provenance: Annotated[
        Path, typer.Argument(metavar="PROVENANCE", help="The provenance.json of a published version.")
    ],
    frames: FrameNumbers = None,
    variant: Annotated[str | None, shared_option("variant")] = None,
    allow_code: Annotated[bool, shared_option("allow_code")] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Render and finish the frames again, and replace what is stored.")
    ] = False,
) -> None:
    """Render a published version again, and compare it to the last bit.

    `flowsculpt reproduce renders/published/A010_cube/v001/provenance.json` renders the version in
    renders/repeated from its recorded shot file, and lists which frames are the same.
    """
    record, project = Provenance.read(provenance), ShotOptions(None, allow_code).project(common, variant)
    again = Reproduction(record, provenance, project.force_from("render") if force else project, frames)
    inside = common.with_own_root(again.home)
    plan = again.plan()
    for note in again.notes:
        print_warning(f"{record.shot} {record.version}: {note}")
    if common.dry_run:
        report_plan(inside, plan)
        return
    outcome = execute(inside, again.plan)
    comparisons = again.comparisons()
    unlike = [each for each in comparisons if not each.same]
    facts = {
        "shot": record.shot,
        "version": record.version,
        "path": str(again.home),
        "notes": again.notes,
        "identical": [each.what for each in comparisons if each.same],
        "different": {each.what: each.words for each in unlike if each.same is False},
        "not_made": [each.what for each in unlike if each.same is None],
    }
    print_result(_compared(record, again.home, comparisons), facts, common.json)
    raise typer.Exit(outcome.exit_code or (1 if unlike else 0))


def _compared(record: Provenance, home: Path, comparisons: Sequence[Comparison]) -> str:
    lines = [f"{each.what}: {each.words or 'differs'}" for each in comparisons if not each.same]
    same = [each.what.removeprefix("frame ") for each in comparisons if each.same]
    frames = FrameRange.of(int(what) for what in same if what != "movie")
    numbers = [f"frame{'s' * (len(frames) > 1)} {frames}"] if frames else []
    told = [*numbers, *(["the movie"] if "movie" in same else [])]
    whole = f"{' and '.join(told) or 'nothing'} identical to the published version, bit for bit"
    return "\n".join([*lines, f"{record.shot} {record.version}: {whole}. It lies in {home}"])
